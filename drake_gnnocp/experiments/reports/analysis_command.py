"""Measure what the parameters are worth from the command line: `python -m drake_gnnocp.analysis [NAME ...]`."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import pandas as pd

from drake_gnnocp.console import OneLineParser, positive, reported
from drake_gnnocp.drake_log import log_to_stderr
from drake_gnnocp.experiments.benchmark.methods import GNN, check_methods, why_unavailable
from drake_gnnocp.experiments.benchmark.planning import Settings, planning_engine, planning_jobs
from drake_gnnocp.experiments.benchmark.tasks import drawn_tasks
from drake_gnnocp.experiments.options import add_budget, add_out, measuring_parser, one_of
from drake_gnnocp.experiments.reports.curves import curve_rows, summary
from drake_gnnocp.experiments.reports.curves_picture import analysis_figure
from drake_gnnocp.experiments.reports.parameters import Parameter, parameters
from drake_gnnocp.experiments.reports.report import PACKAGES, Report, machine
from drake_gnnocp.files import locked, write_atomically
from drake_gnnocp.pictures.style import save_figure

NAMES = tuple(parameters(Path()))
FORMATS = ("png", "pdf")


def _parser() -> OneLineParser:
    parser = measuring_parser(
        "analysis",
        "Vary one parameter at a time and plan the same unseen tasks with all its values, one thread each. "
        "Writes NAME.csv (the curves of a parameter), analysis.png and .pdf, summary.md and runs.csv. What is there is "
        "not run again; choose another --out when the code has changed. Values whose network is missing are skipped, "
        "with a line on stderr.",
    )
    add = parser.add_argument
    add("names", nargs="*", type=one_of(NAMES), metavar="NAME", help=f"some of {', '.join(NAMES)} (default: all)")
    add("--tasks", type=positive, default=50, metavar="N", help="unseen test tasks (default: %(default)s)")
    add_budget(parser, 20.0, "budget of one plan")
    training = Path("artifacts") / "training"
    networks = (
        "folder of the trainings, for points and share: DIR/points_60/best.safetensors ... (default: %(default)s)"
    )
    add("--training", type=Path, default=training, metavar="DIR", help=networks)
    add("--weights", type=Path, metavar="FILE", help="weights for all others (default: the package's)")
    add_out(parser, "paper", "analysis")
    return parser


def main(argv: list[str] | None = None) -> int:
    """Parse the arguments, run what is missing and write the curves; returns the exit code."""
    given = _parser().parse_args(argv)
    log_to_stderr()
    settings = Settings(given.max_seconds, weights=given.weights)
    return reported(run(given.names, given.tasks, settings, given.training, given.out), given.out)


def run(names: Sequence[str], n_tasks: int, settings: Settings, training: Path, folder: Path) -> Iterator[str]:
    """Vary parameters (none named: all) on drawn tasks, with networks in a folder; yields the summary."""
    if settings.weights:
        check_methods(settings.methods([GNN]))
    every = available(parameters(training, settings.weights), names)
    asked_for = list(dict.fromkeys(names or NAMES))
    wanted = [every[name] for name in asked_for if name in every]
    if not wanted:
        raise ValueError(f"{', '.join(asked_for)}: nothing to vary: no network is there")
    methods = list({point.method.name: point.method for parameter in wanted for point in parameter.points}.values())
    with locked(folder):
        engine = planning_engine(folder, methods, settings)
        engine.run(planning_jobs(drawn_tasks(n_tasks), methods, 1, settings))
        text = write_curves(every, engine.file.table, folder)
    yield text


def available(every: dict[str, Parameter], asked_for: Sequence[str]) -> dict[str, Parameter]:
    """The parameters with those of their values that can be planned with here.

    A line on stderr says what is skipped of those that are asked for (none: all of them).
    """
    found = {}
    for name, parameter in every.items():
        points = []
        for point in parameter.points:
            if not (why := why_unavailable(point.method)):
                points.append(point)
            elif not asked_for or name in asked_for:
                print(f"{name} {point.value:g}: skipped: {why}", file=sys.stderr)
        if points:
            found[name] = replace(parameter, points=tuple(points))
    return found


def write_curves(every: dict[str, Parameter], runs: pd.DataFrame, folder: Path) -> str:
    """Write the curves of all parameters that have runs, those of earlier calls too; returns the summary."""
    rows_of = {name: curve_rows(parameter, runs) for name, parameter in every.items()}
    curves = {name: (every[name], rows) for name, rows in rows_of.items() if len(rows)}
    for name, (_, rows) in curves.items():
        write_atomically(folder / f"{name}.csv", Report("", rows).csv)
    text = summary(curves, machine(*PACKAGES))
    write_atomically(folder / "summary.md", text)
    if curves:
        figure = analysis_figure(list(curves.values()))
        for suffix in FORMATS:
            save_figure(figure, folder / f"analysis.{suffix}")
    return text
