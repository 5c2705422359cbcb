"""Measure what the parameters are worth from the command line: `python -m drake_gnnocp.analysis [NAME ...]`."""

from __future__ import annotations

import argparse
import logging
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from drake_gnnocp.command_line import OneLineParser, positive, reported, seconds
from drake_gnnocp.experiments.benchmark.benchmark import Benchmark
from drake_gnnocp.experiments.benchmark.methods import Method, Settings, check_methods
from drake_gnnocp.experiments.benchmark.runs import Run
from drake_gnnocp.experiments.benchmark.summary import PACKAGES
from drake_gnnocp.experiments.benchmark.tasks import drawn_tasks
from drake_gnnocp.experiments.reports.analysis.curves import curve_rows, summary
from drake_gnnocp.experiments.reports.analysis.parameters import Parameter, parameters
from drake_gnnocp.experiments.reports.analysis.picture import analysis_figure
from drake_gnnocp.experiments.reports.tables.report import report
from drake_gnnocp.experiments.reports.text import machine
from drake_gnnocp.files import write_atomically
from drake_gnnocp.guesses.sources import GuessUnavailable, load_network
from drake_gnnocp.pictures.style import save_figure

NAMES = tuple(parameters(Path()))
FORMATS = ("png", "pdf")


def _parser() -> argparse.ArgumentParser:
    parser = OneLineParser(
        prog="python -m drake_gnnocp.analysis",
        description="Vary one parameter at a time and plan the same unseen tasks with all its values, one thread each. "
        "Writes NAME.csv (the curves of a parameter), analysis.png and .pdf, summary.md and runs.csv. What is there is "
        "not run again; choose another --out when the code has changed. Values whose network is missing are skipped, "
        "with a line on stderr.",
        epilog="Exit code: 0 done, however many plans failed; 2 bad input. Timings want an otherwise idle machine.",
    )
    add = parser.add_argument
    add("names", nargs="*", type=_name, metavar="NAME", help=f"some of {', '.join(NAMES)} (default: all)")
    add("--tasks", type=positive, default=50, metavar="N", help="unseen test tasks (default: %(default)s)")
    budget = "wall-clock budget of one plan in seconds (default: %(default)g)"
    add("--max-seconds", type=seconds, default=20.0, metavar="S", help=budget)
    training = Path("artifacts") / "training"
    networks = "folder of the trainings, for points and share: DIR/points_60/best.pt, ... (default: %(default)s)"
    add("--training", type=Path, default=training, metavar="DIR", help=networks)
    add("--weights", type=Path, metavar="FILE", help="weights for all others (default: the package's)")
    out = Path("artifacts") / "paper" / "analysis"
    add("--out", type=Path, default=out, metavar="DIR", help="folder to write (default: %(default)s)")
    return parser


def _name(text: str) -> str:
    if text not in NAMES:
        raise argparse.ArgumentTypeError(f"must be one of {', '.join(NAMES)}, not {text!r}")
    return text


def main(argv: list[str] | None = None) -> int:
    """Parse the arguments, run what is missing and write the curves; returns the exit code."""
    arguments = _parser().parse_args(argv)
    logging.basicConfig(format="%(message)s")
    logging.getLogger("drake").setLevel(logging.ERROR)  # it warns of every solve that hits a limit; rows say so
    return reported(_run(arguments), arguments.out)


def _run(arguments: argparse.Namespace) -> Iterator[str]:
    folder: Path = arguments.out
    if arguments.weights:
        load_network(arguments.weights)
    every = available(parameters(arguments.training, arguments.weights), arguments.names)
    names = list(dict.fromkeys(arguments.names or NAMES))
    wanted = [every[name] for name in names if name in every]
    if not wanted:
        raise ValueError(f"{', '.join(names)}: nothing to vary: no network is there")
    folder.mkdir(parents=True, exist_ok=True)
    methods: dict[str, Method] = {point.method.name: point.method for each in wanted for point in each.points}
    benchmark = Benchmark(folder, list(methods.values()), 1, Settings(arguments.max_seconds))
    benchmark.run(drawn_tasks(arguments.tasks))
    yield write_curves(every, benchmark.runs, folder)


def available(every: dict[str, Parameter], asked_for: list[str]) -> dict[str, Parameter]:
    """The parameters with those of their values that can be planned with here.

    A line on stderr says what is skipped of those that are asked for (none: all of them).
    """
    found = {}
    for name, parameter in every.items():
        points = []
        for point in parameter.points:
            try:
                check_methods([point.method])
            except GuessUnavailable as error:
                if not asked_for or name in asked_for:
                    print(f"{name} {point.value:g}: skipped: {' '.join(str(error).split())}", file=sys.stderr)
                continue
            points.append(point)
        if points:
            found[name] = replace(parameter, points=tuple(points))
    return found


def write_curves(every: dict[str, Parameter], runs: list[Run], folder: Path) -> str:
    """Write the curves of all parameters that have runs, those of earlier calls too; returns the summary."""
    curves = {name: (each, rows) for name, each in every.items() if (rows := curve_rows(each, runs))}
    for name, (_, rows) in curves.items():
        write_atomically(folder / f"{name}.csv", report([], rows).csv)
    text = summary(curves, machine(*PACKAGES))
    write_atomically(folder / "summary.md", text)
    if curves:
        figure = analysis_figure(list(curves.values()))
        for suffix in FORMATS:
            save_figure(figure, folder / f"analysis.{suffix}")
    return text
