"""Make the paper's comparisons from the command line: `python -m drake_gnnocp.tables [NAME ...]`."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import pandas as pd

from drake_gnnocp.console import OneLineParser, positive, reported
from drake_gnnocp.drake_log import log_to_stderr
from drake_gnnocp.experiments.benchmark.methods import (
    GNN,
    GNN_DIRECT,
    GNN_PAPER,
    HYBRID_ASTAR,
    HYBRID_ASTAR_DIRECT,
    RRT_STAR,
    Method,
    check_methods,
    why_unavailable,
)
from drake_gnnocp.experiments.benchmark.planning import Settings, planning_engine, planning_jobs
from drake_gnnocp.experiments.benchmark.tasks import Task, drawn_tasks, named_tasks
from drake_gnnocp.experiments.options import add_budget, add_out, measuring_parser, one_of
from drake_gnnocp.experiments.reports import inference, raw_guesses
from drake_gnnocp.experiments.reports.comparison import MAPS, map_report, unseen_report
from drake_gnnocp.experiments.reports.report import PACKAGES, Report, machine
from drake_gnnocp.files import locked

PLANNERS = (GNN, HYBRID_ASTAR, RRT_STAR)
OPTIONAL = (GNN_PAPER, RRT_STAR)  # left out where their weights or OMPL are missing


@dataclass(frozen=True)
class Wanted:
    """What the command line asks for, and the methods that can be used."""

    tasks: int
    repeats: int
    settings: Settings
    out: Path
    methods: Sequence[Method] = ()


@dataclass(frozen=True)
class Entry:
    """A table that can be made."""

    make: Callable[[Wanted, Path], Report]  # from runs in a folder, of which those that are missing are made
    methods: tuple[str, ...]
    shows: str
    max_seconds: float = 20.0  # wall-clock budget of one plan, where none is asked for


def _map_table(wanted: Wanted, folder: Path) -> Report:
    return map_report(_planned(named_tasks(list(MAPS)), wanted.repeats, wanted, folder), machine(*PACKAGES))


def _test_tasks(wanted: Wanted, folder: Path) -> Report:
    return unseen_report(_planned(drawn_tasks(wanted.tasks), 1, wanted, folder), machine(*PACKAGES))


def _planned(tasks: list[Task], repeats: int, wanted: Wanted, folder: Path) -> pd.DataFrame:
    jobs = planning_jobs(tasks, wanted.methods, repeats, wanted.settings)
    with locked(folder):
        engine = planning_engine(folder, wanted.methods, wanted.settings)
        engine.run(jobs)
    return engine.file.table_of(job.key for task in jobs for job in task)


def _raw_guesses(wanted: Wanted, folder: Path) -> Report:
    runs = raw_guesses.measure(folder, drawn_tasks(wanted.tasks), wanted.methods, wanted.settings)
    return raw_guesses.raw_report(runs, machine(*PACKAGES))


def _inference(wanted: Wanted, _: Path) -> Report:
    runs = inference.measure(drawn_tasks(wanted.tasks), wanted.methods, wanted.repeats)
    return inference.inference_report(runs, machine(*PACKAGES))


UNSEEN = (*PLANNERS, GNN_PAPER, GNN_DIRECT, HYBRID_ASTAR_DIRECT)
RAW = "guesses as they are, against the nearest optimum"
TABLES = {
    "table": Entry(_map_table, PLANNERS, "the performance comparison on the paper's four maps, and its disparities"),
    "test_tasks": Entry(_test_tasks, UNSEEN, "the same methods on unseen test tasks"),
    "raw_guesses": Entry(_raw_guesses, (*PLANNERS, GNN_PAPER), RAW, max_seconds=5.0),
    "inference": Entry(_inference, (GNN, GNN_PAPER), "milliseconds of a network's first guess, always measured anew"),
}


def _parser() -> OneLineParser:
    parser = measuring_parser(
        "tables",
        "Make the comparisons of the paper, one thread each: NAME.md and NAME.csv, from runs that are kept "
        "in runs/NAME. What is there is not run again; choose another --out when the code has changed. Methods whose "
        "weights are missing, or OMPL, are left out, with a line on stderr.",
    )
    add = parser.add_argument
    names = "; ".join(f"{name}: {entry.shows}" for name, entry in TABLES.items())
    add("names", nargs="*", type=one_of(TABLES), metavar="NAME", help=f"which, default all. {names}")
    add("--tasks", type=positive, default=200, metavar="N", help="unseen test tasks (default: %(default)s)")
    repeats = "runs of each method on a map, and of an inference (default: %(default)s)"
    add("--repeat", type=positive, default=5, metavar="N", help=repeats)
    budgets = ", ".join(f"{name} {entry.max_seconds:g}" for name, entry in TABLES.items())
    add_budget(parser, None, "budget of one plan", budgets)
    add("--weights", type=Path, metavar="FILE", help="weights of gnn and gnn_direct (default: the package's)")
    add_out(parser, "paper")
    return parser


def main(argv: list[str] | None = None) -> int:
    """Parse the arguments, run what is missing and write the tables; returns the exit code."""
    given = _parser().parse_args(argv)
    log_to_stderr()
    wanted = {}
    for name in dict.fromkeys(given.names or TABLES):
        settings = Settings(given.max_seconds or TABLES[name].max_seconds, weights=given.weights)
        wanted[name] = Wanted(given.tasks, given.repeat, settings, given.out)
    return reported((make_table(name, what) for name, what in wanted.items()), given.out)


def make_table(name: str, wanted: Wanted) -> str:
    """Run what is missing for a table and write it; returns its Markdown."""
    entry = TABLES[name]
    methods = available_methods(entry.methods, wanted.settings)
    folder = wanted.out / "runs" / name
    folder.mkdir(parents=True, exist_ok=True)
    made = entry.make(replace(wanted, methods=methods), folder)
    made.save(wanted.out, name)
    return made.markdown


def available_methods(names: tuple[str, ...], settings: Settings) -> list[Method]:
    """The methods that can be used here, with a line on stderr for each that is left out.

    Raises:
        GuessUnavailable: one that must not be left out cannot be used.
    """
    methods = settings.methods(names)
    missing = {method.name: why for method in methods if method.name in OPTIONAL and (why := why_unavailable(method))}
    for name, why in missing.items():
        print(f"{name}: left out: {why}", file=sys.stderr)
    found = [method for method in methods if method.name not in missing]
    check_methods(found)
    return found
