"""Make the paper's comparisons from the command line: `python -m drake_gnnocp.tables [NAME ...]`."""

from __future__ import annotations

import argparse
import logging
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from drake_gnnocp.command_line import OneLineParser, positive, reported, seconds
from drake_gnnocp.experiments.benchmark.benchmark import Benchmark
from drake_gnnocp.experiments.benchmark.methods import (
    GNN,
    GNN_DIRECT,
    GNN_PAPER,
    HYBRID_ASTAR,
    HYBRID_ASTAR_DIRECT,
    RRT_STAR,
    Method,
    Settings,
    check_methods,
    methods_named,
)
from drake_gnnocp.experiments.benchmark.summary import PACKAGES
from drake_gnnocp.experiments.benchmark.tasks import drawn_tasks, named_tasks
from drake_gnnocp.experiments.reports.tables import inference, raw_guesses
from drake_gnnocp.experiments.reports.tables.maps import MAPS, map_report
from drake_gnnocp.experiments.reports.tables.report import Report
from drake_gnnocp.experiments.reports.tables.unseen import unseen_report
from drake_gnnocp.experiments.reports.text import machine
from drake_gnnocp.guesses.sources import GuessUnavailable

PLANNERS = (GNN, HYBRID_ASTAR, RRT_STAR)
OPTIONAL = (GNN_PAPER, RRT_STAR)  # left out where their weights or OMPL are missing


@dataclass(frozen=True)
class Wanted:
    """What the command line asks for."""

    tasks: int
    repeats: int
    settings: Settings
    out: Path


@dataclass(frozen=True)
class Entry:
    """A table that can be made."""

    make: Callable[[Wanted, Path, list[Method]], Report]
    methods: tuple[str, ...]
    shows: str
    max_seconds: float = 20.0  # wall-clock budget of one plan, where none is asked for


def _map_table(wanted: Wanted, folder: Path, methods: list[Method]) -> Report:
    benchmark = Benchmark(folder, methods, wanted.repeats, wanted.settings)
    tasks = named_tasks(list(MAPS))
    benchmark.run(tasks)
    return map_report(benchmark.runs_of(tasks), machine(*PACKAGES))


def _test_tasks(wanted: Wanted, folder: Path, methods: list[Method]) -> Report:
    benchmark = Benchmark(folder, methods, 1, wanted.settings)
    tasks = drawn_tasks(wanted.tasks)
    benchmark.run(tasks)
    return unseen_report(benchmark.runs_of(tasks), machine(*PACKAGES))


def _raw_guesses(wanted: Wanted, folder: Path, methods: list[Method]) -> Report:
    rows = raw_guesses.measure(folder, drawn_tasks(wanted.tasks), methods, wanted.settings)
    return raw_guesses.raw_report(rows, machine(*PACKAGES))


def _inference(wanted: Wanted, _: Path, methods: list[Method]) -> Report:
    seconds = inference.measure(drawn_tasks(wanted.tasks), methods, wanted.repeats)
    return inference.inference_report(seconds, machine(*PACKAGES))


TABLES = {
    "table": Entry(_map_table, PLANNERS, "the performance comparison on the paper's four maps, and its disparities"),
    "test_tasks": Entry(
        _test_tasks, (*PLANNERS, GNN_PAPER, GNN_DIRECT, HYBRID_ASTAR_DIRECT), "the same methods on unseen test tasks"
    ),
    "raw_guesses": Entry(
        _raw_guesses, (*PLANNERS, GNN_PAPER), "guesses as they are, against the nearest optimum", max_seconds=5.0
    ),
    "inference": Entry(_inference, (GNN, GNN_PAPER), "milliseconds of a network's first guess, always measured anew"),
}


def _parser() -> argparse.ArgumentParser:
    parser = OneLineParser(
        prog="python -m drake_gnnocp.tables",
        description="Make the comparisons of the paper, one thread each: NAME.md and NAME.csv, from runs that are kept "
        "in runs/NAME. What is there is not run again; choose another --out when the code has changed. Methods whose "
        "weights are missing, or OMPL, are left out, with a line on stderr.",
        epilog="Exit code: 0 done, however many plans failed; 2 bad input. Timings want an otherwise idle machine.",
    )
    add = parser.add_argument
    names = "; ".join(f"{name}: {entry.shows}" for name, entry in TABLES.items())
    add("names", nargs="*", type=_name, metavar="NAME", help=f"which, default all. {names}")
    add("--tasks", type=positive, default=200, metavar="N", help="unseen test tasks (default: %(default)s)")
    repeats = "runs of each method on a map, and of an inference (default: %(default)s)"
    add("--repeat", type=positive, default=5, metavar="N", help=repeats)
    budgets = ", ".join(f"{name} {entry.max_seconds:g}" for name, entry in TABLES.items())
    budget = f"wall-clock budget of one plan in seconds (default: {budgets})"
    add("--max-seconds", type=seconds, metavar="S", help=budget)
    add("--weights", type=Path, metavar="FILE", help="weights of gnn and gnn_direct (default: the package's)")
    out = Path("artifacts") / "paper"
    add("--out", type=Path, default=out, metavar="DIR", help="folder to write (default: %(default)s)")
    return parser


def _name(text: str) -> str:
    if text not in TABLES:
        raise argparse.ArgumentTypeError(f"must be one of {', '.join(TABLES)}, not {text!r}")
    return text


def main(argv: list[str] | None = None) -> int:
    """Parse the arguments, run what is missing and write the tables; returns the exit code."""
    arguments = _parser().parse_args(argv)
    logging.basicConfig(format="%(message)s")
    logging.getLogger("drake").setLevel(logging.ERROR)  # it warns of every solve that hits a limit; rows say so
    wanted = {}
    for name in dict.fromkeys(arguments.names or TABLES):
        budget = arguments.max_seconds or TABLES[name].max_seconds
        settings = Settings(budget, weights=arguments.weights)
        wanted[name] = Wanted(arguments.tasks, arguments.repeat, settings, arguments.out)
    return reported((make_table(name, each) for name, each in wanted.items()), arguments.out)


def make_table(name: str, wanted: Wanted) -> str:
    """Run what is missing for a table and write it; returns its Markdown."""
    entry = TABLES[name]
    methods = available_methods(entry.methods, wanted.settings)
    folder = wanted.out / "runs" / name
    folder.mkdir(parents=True, exist_ok=True)
    made = entry.make(wanted, folder, methods)
    made.save(wanted.out, name)
    return made.markdown


def available_methods(names: tuple[str, ...], settings: Settings) -> list[Method]:
    """The methods that can be used here, with a line on stderr for each that is left out.

    Raises:
        GuessUnavailable: one that must not be left out cannot be used.
    """
    found = []
    for method in methods_named(names, settings):
        try:
            check_methods([method])
        except GuessUnavailable as error:
            if method.name not in OPTIONAL:
                raise
            print(f"{method.name}: left out: {' '.join(str(error).split())}", file=sys.stderr)
            continue
        found.append(method)
    return found
