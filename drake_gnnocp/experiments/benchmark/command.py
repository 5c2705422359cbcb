"""Compare methods of planning from the command line: `python -m drake_gnnocp.benchmark [SCENARIO ...]`."""

from __future__ import annotations

import argparse
import logging
from collections.abc import Iterator
from pathlib import Path

from drake_gnnocp.command_line import OneLineParser, count, positive, reported, seconds
from drake_gnnocp.experiments.benchmark.benchmark import Benchmark
from drake_gnnocp.experiments.benchmark.methods import METHODS, Settings, check_methods, methods_named
from drake_gnnocp.experiments.benchmark.summary import summarise
from drake_gnnocp.experiments.benchmark.tasks import DATASET, TEST_MAPS, drawn_tasks, named_tasks
from drake_gnnocp.files import write_atomically

DEFAULTS = Settings()


def _parser() -> argparse.ArgumentParser:
    parser = OneLineParser(
        prog="python -m drake_gnnocp.benchmark",
        description="Plan scenarios with several methods, one thread each, and compare: runs.csv has a row a run, "
        "summary.md the tables. What is there is not run again; choose another --out when the code has changed.",
        epilog="Exit code: 0 done, however many plans failed; 2 bad input. Timings want an otherwise idle machine.",
    )
    add = parser.add_argument
    add("scenarios", nargs="*", metavar="SCENARIO", help="a bundled name, a .json or a TPCAP .csv file")
    most = len(TEST_MAPS) * DATASET.pairs
    tasks = f"and the first N of {most} random tasks on {len(TEST_MAPS)} maps that are in no training (default: 0)"
    add("--tasks", type=count, default=0, metavar="N", help=tasks)
    add(
        "--methods",
        nargs="+",
        choices=METHODS,
        default=list(METHODS),
        metavar="METHOD",
        help=f"some of {', '.join(METHODS)} (default: all)",
    )
    add("--repeat", type=positive, default=1, metavar="N", help="times that each is run (default: %(default)s)")
    add("--jobs", type=positive, default=1, metavar="N", help="processes; more than 1 blur timings (default: 1)")
    add(
        "--max-seconds",
        type=seconds,
        default=DEFAULTS.max_seconds,
        metavar="S",
        help="wall-clock budget of one plan in seconds (default: %(default)g)",
    )
    add("--seed", type=count, default=DEFAULTS.seed, metavar="N", help="seed of RRT* (default: %(default)s)")
    add("--weights", type=Path, metavar="FILE", help="weights of gnn, gnn_direct and auto (default: the package's)")
    out = Path("artifacts") / "benchmark"
    add("--out", type=Path, default=out, metavar="DIR", help="folder to write (default: %(default)s)")
    return parser


def main(argv: list[str] | None = None) -> int:
    """Parse the arguments, run what is missing and write the summary; returns the exit code."""
    arguments = _parser().parse_args(argv)
    logging.getLogger("drake").setLevel(logging.ERROR)  # it warns of every solve that hits a limit; rows say so
    return reported(_run(arguments), arguments.out)


def _run(arguments: argparse.Namespace) -> Iterator[str]:
    if not arguments.scenarios and not arguments.tasks:
        raise ValueError("SCENARIO or --tasks: nothing to plan; try map_a map_b map_c map_d --tasks 20")
    folder: Path = arguments.out
    settings = Settings(arguments.max_seconds, arguments.seed, arguments.weights)
    methods = methods_named(list(dict.fromkeys(arguments.methods)), settings)
    tasks = named_tasks(arguments.scenarios)
    check_methods(methods)
    folder.mkdir(parents=True, exist_ok=True)
    benchmark = Benchmark(folder, methods, arguments.repeat, settings)
    benchmark.run(tasks + drawn_tasks(arguments.tasks), arguments.jobs)
    summary = summarise(benchmark.runs)
    write_atomically(folder / "summary.md", summary)
    yield summary
