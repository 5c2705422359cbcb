"""Benchmark the optimal control problem from the command line: `python -m drake_gnnocp.ocp_benchmark`."""

from __future__ import annotations

import argparse
import importlib.util
import sys
from collections.abc import Iterator
from pathlib import Path

from drake_gnnocp.command_line import BAD_INPUT, OneLineParser, count, reported, seconds
from drake_gnnocp.experiments.ocp_benchmark.benchmark import Settings, library_tasks, random_tasks, run_benchmark
from drake_gnnocp.experiments.ocp_benchmark.methods import CASADI, DRAKE, METHODS, TUTORIAL
from drake_gnnocp.experiments.ocp_benchmark.runs import RunsError
from drake_gnnocp.experiments.ocp_benchmark.summary import summarise
from drake_gnnocp.files import write_atomically

DEFAULTS = Settings()


def _parser() -> argparse.ArgumentParser:
    parser = OneLineParser(
        prog="python -m drake_gnnocp.ocp_benchmark",
        description="Solve random tasks (40 m x 40 m, 10 obstacles) from the guesses of Hybrid A*, with this package "
        "and with CasADi, in one thread, and compare. Writes runs.csv and summary.md. What is there is not run again, "
        "and guesses once searched are kept in guesses/: choose another --out when the code has changed.",
        epilog="Exit code: 0 done, however many tasks failed; 2 bad input. Timings want an otherwise idle machine.",
    )
    add = parser.add_argument
    add("--tasks", type=count, default=100, metavar="N", help="number of random tasks (default: %(default)s)")
    add("--seed", type=count, default=0, metavar="N", help="seed of the random tasks (default: %(default)s)")
    add("--library", action="store_true", help="run the bundled scenarios instead of random tasks")
    add(
        "--methods",
        nargs="+",
        choices=METHODS,
        default=[DRAKE, *CASADI],
        metavar="METHOD",
        help=f"some of {', '.join(METHODS)} (default: {' '.join([DRAKE, *CASADI])})",
    )
    add("--tutorial", type=count, default=0, metavar="N", help="run the slow 'tutorial' on the first N tasks as well")
    add("--perturb", action="store_true", help="start ours from bad guesses as well, and from its own optimum")
    add(
        "--max-seconds",
        type=seconds,
        default=DEFAULTS.max_seconds,
        metavar="S",
        help="wall-clock limit of one method on one task in seconds (default: %(default)g)",
    )
    add(
        "--search-seconds",
        type=seconds,
        default=DEFAULTS.search_seconds,
        metavar="S",
        help="wall-clock limit of Hybrid A* on one task in seconds (default: %(default)g)",
    )
    add("--knots", type=_knots, default=DEFAULTS.n_knots, metavar="N", help="knots of a plan (default: %(default)s)")
    out = Path("artifacts") / "ocp_benchmark"
    add("--out", type=Path, default=out, metavar="DIR", help="folder to write (default: %(default)s)")
    return parser


def _knots(text: str) -> int:
    if (n := count(text)) < 4:
        raise argparse.ArgumentTypeError(f"must be at least 4, not {text!r}")
    return n


def main(argv: list[str] | None = None) -> int:
    """Parse the arguments, run what is missing and write the summary; returns the exit code."""
    arguments = _parser().parse_args(argv)
    folder: Path = arguments.out
    methods: list[str] = arguments.methods
    if any(method.startswith("casadi") for method in methods) and importlib.util.find_spec("casadi") is None:
        print("--methods: casadi is not installed: pip install -e .[bench], or choose --methods drake", file=sys.stderr)
        return BAD_INPUT

    def methods_of(i: int) -> list[str]:
        return list(dict.fromkeys([*methods, *([TUTORIAL] if i < arguments.tutorial else [])]))

    tasks = library_tasks() if arguments.library else random_tasks(arguments.seed, arguments.tasks)
    settings = Settings(arguments.knots, arguments.max_seconds, arguments.search_seconds)

    def run() -> Iterator[str]:
        folder.mkdir(parents=True, exist_ok=True)
        summary = summarise(run_benchmark(tasks, methods_of, arguments.perturb, settings, folder))
        write_atomically(folder / "summary.md", summary)
        yield summary

    return reported(run(), folder, RunsError)
