"""The command line `python -m drake_gnnocp.plan [SCENARIO ...]`, and how commands are run."""

from __future__ import annotations

import argparse
import logging
import os
import sys
from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from drake_gnnocp.arguments import TASK, add_task_arguments, with_signed_numbers
from drake_gnnocp.batch import BAD_INPUT as BAD_ROW
from drake_gnnocp.batch import MARK, SUMMARY, UNWRITTEN, Batch, files_in, mark, sources_of, table
from drake_gnnocp.budget import Budget
from drake_gnnocp.console import (
    BAD_INPUT,
    DONE,
    INTERRUPTED,
    NOBODY_READS,
    NOT_VERIFIED,
    NOT_WRITTEN,
    OneLineParser,
    failed,
    positive,
)
from drake_gnnocp.drake_log import log_to_stderr
from drake_gnnocp.exports import EXPORTS, Exports, add_exports
from drake_gnnocp.files import check_writable, replaced_together, write_atomically
from drake_gnnocp.planner.horizon import LONGEST, Fixed, Horizon, horizon_of
from drake_gnnocp.planner.options import GUESSES, PlanOptions, source_named
from drake_gnnocp.planner.planner import PlanInterrupted, plan
from drake_gnnocp.planner.result import FILES, Plan
from drake_gnnocp.scenario import Scenario, bundled_scenarios

OUTPUTS = (*FILES, "plan.png", "states.png", "replay.html", *EXPORTS, MARK)


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
        "there is one). Of a batch: 2 where an input is bad (the rest is planned), else 4 where a plan could not be "
        "written, else 3 where one is not verified.",
    )
    parser.add_argument(
        "scenario",
        nargs="*",
        default=["map_a"],
        help="a bundled name (see --list), a .json, .geojson, .dxf or TPCAP .csv file, or the .yaml file of an "
        "occupancy map (docs/scenario.md; default: map_a); several of them, or a folder of files, are a batch, each in "
        f"a folder of its name in DIR, and {SUMMARY} of all",
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
    add_exports(parser)
    _add_batch(parser)
    parser.add_argument("--list", action="store_true", help="list the bundled scenarios and exit")
    parser.add_argument(
        "--verbose", action="store_true", help="log to stderr what is tried and what the solver says of it"
    )
    return parser


def _add_batch(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    cores = os.cpu_count() or 1
    add("--jobs", type=positive, metavar="N", help=f"processes of a batch (default: {cores}, the cores)")
    add("--dask", metavar="ADDRESS", help="plan a batch on a Dask cluster, such as tcp://host:8786, that sees DIR")
    add("--again", action="store_true", help="plan what the batch has planned already again")


def _horizon(text: str) -> Horizon:
    try:
        return horizon_of(text) if text in ("guess", "free") else Fixed(float(text))
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be guess, free or 0 to {LONGEST:g} seconds, not {text!r}") from None


def main(argv: list[str] | None = None) -> int:
    """Parse the arguments, plan, write the files and print a summary; returns the exit code."""
    argv = with_signed_numbers(sys.argv[1:] if argv is None else argv)
    arguments = _parser().parse_intermixed_args(argv)  # names may stand before and after options
    log_to_stderr(logging.INFO if arguments.verbose else logging.WARNING, logging.BASIC_FORMAT)
    if arguments.verbose:
        logging.getLogger("drake_gnnocp").setLevel(logging.DEBUG)
    if arguments.list:
        for name in bundled_scenarios():
            print(name)
        return DONE
    exports = Exports(arguments.rate, arguments.reference, arguments.format, arguments.gif, arguments.mp4)
    how = (arguments.guess, arguments.horizon, arguments.max_seconds)
    task = {key: getattr(arguments, key) for key in TASK}
    load, pictures = partial(_load, task, arguments.clearance), not arguments.no_pictures
    sources, plans = arguments.scenario, Path("artifacts") / "plans"
    if len(sources) > 1 or files_in(sources[0]) or arguments.jobs or arguments.dask or arguments.again:
        out = arguments.out or plans
        out = out.absolute() if arguments.dask else out
        options = {"guess": how[0], "horizon": repr(how[1]), "max_seconds": how[2], "pictures": pictures}
        job = partial(plan_into, how, exports, pictures)
        jobs = arguments.jobs or os.cpu_count() or 1
        batch = Batch(out, job, options | asdict(exports), jobs, arguments.dask, arguments.again)
        return _plan_batch(batch, sources, load, how, exports)
    return _plan_one(sources[0], load, how, exports, arguments.out, plans, pictures)


How = tuple[str, Horizon | str, float]  # guess, horizon, seconds of the budget


def _load(task: Mapping[str, Any], clearance: float | None, source: str) -> Scenario:
    """The scenario that is meant.

    Raises:
        ScenarioError: there is none; the message is one line.
    """
    scenario = Scenario.load(source, **task)
    return scenario if clearance is None else replace(scenario, clearance=clearance)


def _check(how: How, exports: Exports) -> Budget:
    """The budget, where all that is asked for can be done.

    Raises:
        ValueError: it cannot, or what it needs is not there.
    """
    guess, _, max_seconds = how
    if not max_seconds > 0:
        raise ValueError(f"--max-seconds: must be positive, not {max_seconds:g}")
    exports.check()
    budget = Budget.of(max_seconds)
    with budget.standing_still():
        source_named(guess, PlanOptions())  # raises where it needs what is not there
    return budget


def _plan_one(
    source: str,
    load: Callable[[str], Scenario],
    how: How,
    exports: Exports,
    out: Path | None,
    plans: Path,
    pictures: bool,
) -> int:
    """Plan one scenario into `out`, or a folder of its name in `plans`; returns the exit code."""
    try:
        budget = _check(how, exports)
        scenario = load(source)
        plans = out or plans / scenario.name
        check_writable(plans, OUTPUTS)  # raises before anything is computed that could then not be written
    except (ValueError, OSError) as error:
        return failed(error, out or plans)
    interrupted = False
    try:
        try:
            result = plan(scenario, *how[:2], budget)
        except PlanInterrupted as interruption:
            if interruption.plan is None:
                raise
            result, interrupted = interruption.plan, True
            exports, pictures = replace(exports, gif=False, mp4=False), False
        result, note = exports.resampled(result)
        print(result.summary, flush=True)  # pictures take longer than many a plan
        _write(result, note, plans, exports, pictures)
    except OSError as error:
        return failed(error, plans)
    print(f"written to {plans}")
    if note:
        print(note, file=sys.stderr)
    if interrupted:
        print("interrupted: this is the best plan so far", file=sys.stderr)
        return INTERRUPTED
    return DONE if result.verified and not note else NOT_VERIFIED


def _plan_batch(batch: Batch, sources: list[str], load: Callable[[str], Scenario], how: How, exports: Exports) -> int:
    """Plan several scenarios, and print a table of them; returns the exit code."""
    try:
        _check(how, exports)
        sources = sources_of(sources)
        rows, interrupted = batch.run(sources, load)
    except (ValueError, OSError) as error:
        return failed(error, batch.out)
    print("\n".join(table(rows)))
    print(f"written to {batch.out}")
    if interrupted:
        print(f"interrupted: {len(rows)} of {len(sources)} are done; the same command goes on", file=sys.stderr)
        return INTERRUPTED
    if any(row.status == BAD_ROW for row in rows):
        return BAD_INPUT
    if any(row.status == UNWRITTEN for row in rows):
        return NOT_WRITTEN
    return DONE if all(row.is_as_asked for row in rows) else NOT_VERIFIED


def plan_into(
    how: How, exports: Exports, pictures: bool, scenario: Scenario, folder: Path, options: Mapping[str, Any]
) -> None:
    """Plan a scenario of a batch and write its files.

    Raises:
        OSError: they could not be written.
    """
    result, note = exports.resampled(plan(scenario, *how))
    _write(result, note, folder, exports, pictures, options)


def _write(
    result: Plan, note: str, out: Path, exports: Exports, pictures: bool, options: Mapping[str, Any] | None = None
) -> None:
    """Write a plan and its pictures; with the options of a batch also that it is done, and a note on it."""
    with replaced_together(out, OUTPUTS) as stage:
        result.save(stage)
        exports.save(result, stage)
        if pictures:
            _save_pictures(result, stage)
        if options is not None:
            write_atomically(stage / MARK, mark(options, [path.name for path in stage.iterdir()], note))


def _save_pictures(result: Plan, folder: Path) -> None:
    from drake_gnnocp.pictures import save_plan_picture, save_replay, save_states_picture  # matplotlib takes its time

    scenario, trajectory, guess = result.scenario, result.trajectory, result.guess
    title = f"{scenario.name}: {result.status.replace('_', ' ')}"
    save_plan_picture(folder / "plan.png", scenario, trajectory, guess, title, result.first_fault, result.no_path)
    if trajectory is not None:
        save_states_picture(folder / "states.png", trajectory, scenario.vehicle, guess, title)
        save_replay(folder / "replay.html", scenario, trajectory)
