"""The command line `python -m drake_gnnocp.plan [SCENARIO]`, and what it shares with those of the experiments.

Bad input is one line on stderr and exit code 2; output that cannot be written is one line and 4.
"""

from __future__ import annotations

import argparse
import logging
import os
import sys
from collections.abc import Callable, Iterable
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import NoReturn

from drake_gnnocp.arguments import add_task_arguments, with_signed_numbers
from drake_gnnocp.budget import Budget
from drake_gnnocp.drake_log import log_to_stderr
from drake_gnnocp.files import check_writable, replaced_together
from drake_gnnocp.pictures import save_plan_picture, save_replay, save_states_picture
from drake_gnnocp.planner.horizon import LONGEST, Fixed, Horizon, horizon_of
from drake_gnnocp.planner.options import GUESSES, PlanOptions, source_named
from drake_gnnocp.planner.planner import PlanInterrupted, plan
from drake_gnnocp.planner.result import FILES, Plan
from drake_gnnocp.scenario import Scenario, bundled_scenarios

DONE, BAD_INPUT, NOT_VERIFIED, NOT_WRITTEN, INTERRUPTED, NOBODY_READS = 0, 2, 3, 4, 130, 141  # exit codes
OUTPUTS = (*FILES, "plan.png", "states.png", "replay.html")


class OneLineParser(argparse.ArgumentParser):
    """An argument parser whose errors are one line."""

    def error(self, message: str) -> NoReturn:
        """Exit with one line instead of argparse's usage and message."""
        self.exit(BAD_INPUT, f"{self.prog}: {message}\n")


def count(text: str) -> int:
    """An argument that is a whole number of 0 or more."""
    if not text.isdecimal() or len(text) > 9:
        raise argparse.ArgumentTypeError(f"must be a number of 0 or more, not {text!r}")
    return int(text)


def positive(text: str) -> int:
    """An argument that is a whole number of 1 or more."""
    if (n := count(text)) == 0:
        raise argparse.ArgumentTypeError(f"must be a number of 1 or more, not {text!r}")
    return n


def seconds(text: str) -> float:
    """An argument that is a time in (0, 100000] [s]."""
    return _at_most(1e5, "0 to 100000 seconds", text)


def share(text: str) -> float:
    """An argument that is a number in (0, 1]."""
    return _at_most(1.0, "above 0 and at most 1", text)


def _at_most(most: float, meaning: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 < value <= most:
        raise argparse.ArgumentTypeError(f"must be {meaning}, not {text!r}")
    return value


def reported(texts: Iterable[str], out: Path, wrong: type[Exception] = ValueError) -> int:
    """Print the texts that a command makes, as they come; what is wrong with its input is one line on stderr.

    Args:
        texts: their making is the command's work, which writes into the folder `out`.
        out: see above.
        wrong: the errors that name what is wrong with the input.

    Returns:
        The exit code.
    """
    try:
        for text in texts:
            print(text)
    except (wrong, OSError) as error:
        return failed(error, out)
    print(f"written to {out}")
    return DONE


def failed(error: Exception, out: Path) -> int:
    """Say in one line on stderr what is wrong with the input or with the folder `out`; returns the exit code."""
    if not isinstance(error, OSError):
        print(" ".join(str(error).split()), file=sys.stderr)
        return BAD_INPUT
    print(f"--out: {error.filename or out}: {error.strerror or error}", file=sys.stderr)
    return BAD_INPUT if isinstance(error, FileExistsError | NotADirectoryError) else NOT_WRITTEN


def run_command(main: Callable[[], int]) -> int:
    """Run the `main` of a command; Ctrl-C is one line on stderr, and a closed pipe nothing. Returns the exit code."""
    try:
        exit_code = main()
        sys.stdout.flush()
        return exit_code
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:  # whoever read what is printed has gone; Python would complain of it at its end
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return NOBODY_READS


def command_of(module: str) -> int:
    """Run the `main` of a module that reads runs as tables, and so needs what the extra `experiments` installs.

    Args:
        module: its full name.

    Returns:
        The exit code.
    """
    try:
        main: Callable[[], int] = import_module(module).main
    except ModuleNotFoundError as error:
        if error.name != "pandas":
            raise
        print("pandas is not installed: pip install -e .[experiments]", file=sys.stderr)
        return BAD_INPUT
    return run_command(main)


def _parser() -> argparse.ArgumentParser:
    parser = OneLineParser(
        prog="python -m drake_gnnocp.plan",
        description="Plan a trajectory for a car among polygons, verify it, and draw it.",
        epilog="Exit code: 0 a verified plan, 2 bad input, 3 no verified plan (the best attempt is written, unless "
        "there is no path), 4 the output could not be written, 130 interrupted (the best plan so far is written, where "
        "there is one).",
    )
    parser.add_argument(
        "scenario",
        nargs="?",
        default="map_a",
        help="a bundled name (see --list), a .json, .geojson, .dxf or TPCAP .csv file, or the .yaml file of an "
        "occupancy map (docs/scenario.md; default: %(default)s)",
    )
    add_task_arguments(parser)
    parser.add_argument(
        "--guess", choices=GUESSES, default="auto", help="where the first guess comes from (default: %(default)s)"
    )
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder to write (default: artifacts/plans/NAME)")
    parser.add_argument(
        "--max-seconds",
        type=float,
        default=60.0,
        metavar="S",
        help="wall-clock budget of planning in seconds (default: %(default)g)",
    )
    parser.add_argument(
        "--horizon",
        type=_horizon,
        default="guess",
        metavar="{guess,free,SECONDS}",
        help="duration: the guess's, optimised with a weight on time, or a constant in seconds (default: %(default)s)",
    )
    parser.add_argument(
        "--clearance",
        type=float,
        metavar="M",
        help="clearance in m that is kept at all times, but where start or goal leaves less (default: the scenario's)",
    )
    parser.add_argument("--no-pictures", action="store_true", help="write no plan.png, states.png and replay.html")
    parser.add_argument("--list", action="store_true", help="list the bundled scenarios and exit")
    parser.add_argument(
        "--verbose", action="store_true", help="log to stderr what is tried and what the solver says of it"
    )
    return parser


def _horizon(text: str) -> Horizon:
    try:
        return horizon_of(text) if text in ("guess", "free") else Fixed(float(text))
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be guess, free or 0 to {LONGEST:g} seconds, not {text!r}") from None


def main(argv: list[str] | None = None) -> int:
    """Parse the arguments, plan, write the files and print a summary; returns the exit code."""
    arguments = _parser().parse_args(with_signed_numbers(sys.argv[1:] if argv is None else argv))
    log_to_stderr(logging.INFO if arguments.verbose else logging.WARNING, logging.BASIC_FORMAT)
    if arguments.verbose:
        logging.getLogger("drake_gnnocp").setLevel(logging.DEBUG)
    if arguments.list:
        for name in bundled_scenarios():
            print(name)
        return DONE
    out = arguments.out or Path("artifacts") / "plans"
    try:
        if not arguments.max_seconds > 0:
            raise ValueError(f"--max-seconds: must be positive, not {arguments.max_seconds:g}")
        budget = Budget.of(arguments.max_seconds)
        scenario = Scenario.load(
            arguments.scenario,
            unknown=arguments.unknown,
            layers=arguments.layers,
            start=arguments.start,
            goal=arguments.goal,
            vehicle=arguments.vehicle,
        )
        if arguments.clearance is not None:
            scenario = replace(scenario, clearance=arguments.clearance)
        with budget.standing_still():
            source_named(arguments.guess, PlanOptions())  # raises where it needs what is not there
        out = arguments.out or out / scenario.name
        check_writable(out, OUTPUTS)  # raises before anything is computed that could then not be written
    except (ValueError, OSError) as error:
        return failed(error, out)
    interrupted = False
    try:
        try:
            result = plan(scenario, arguments.guess, arguments.horizon, budget)
        except PlanInterrupted as interruption:
            if interruption.plan is None:
                raise
            result, interrupted = interruption.plan, True
        with replaced_together(out, OUTPUTS) as stage:
            result.save(stage)
            if not arguments.no_pictures and not interrupted:
                _save_pictures(result, stage)
    except OSError as error:
        return failed(error, out)
    print(result.summary)
    print(f"written to {out}")
    if interrupted:
        print("interrupted: this is the best plan so far", file=sys.stderr)
        return INTERRUPTED
    return DONE if result.verified else NOT_VERIFIED


def _save_pictures(result: Plan, folder: Path) -> None:
    scenario, trajectory, guess = result.scenario, result.trajectory, result.guess
    title = f"{scenario.name}: {result.status.replace('_', ' ')}"
    save_plan_picture(folder / "plan.png", scenario, trajectory, guess, title, result.first_fault, result.no_path)
    if trajectory is not None:
        save_states_picture(folder / "states.png", trajectory, scenario.vehicle, guess, title)
        save_replay(folder / "replay.html", scenario, trajectory)
