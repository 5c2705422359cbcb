"""What the tests of the benchmarks and of their reports share: runs with round numbers, and a look into tables."""

from __future__ import annotations

import csv
import re
from dataclasses import replace
from typing import Any

import numpy as np

from drake_gnnocp import Scenario
from drake_gnnocp.experiments.benchmark.runs import Run
from drake_gnnocp.experiments.benchmark.tasks import Task
from drake_gnnocp.experiments.benchmark.worker import Worker
from drake_gnnocp.experiments.reports.report import Report

PATIENT = 600.0  # s, a budget that no busy machine exceeds
MACHINE = "a machine\n"


def run_of(scenario: str, method: str, total: float, kind: str = "open", **changes: Any) -> Run:
    """A verified run of planning, of whose `total` seconds 0.1 went to the guess, 0.2 to building, 0.6 to solving."""
    times = {"guess_s": 0.1 * total, "build_s": 0.2 * total, "solve_s": 0.6 * total, "total_s": total}
    counts = {"convex_steps": 5, "first_iterations": 20, "iterations": 30, "rounds": 2}
    numbers = {"cost": 3.0, "clearance_m": 0.1, "duration_s": 12.0, "guess_blocked": 0.1, "guess_gap_m": 0.01}
    off = {"disparity_position": 4.0, "disparity_theta": 3.0, "disparity_v": 2.0, "disparity_phi": 1.0}
    run = Run(scenario, kind, "", method, 0, **times, **counts, **numbers, **off, verified=True)  # type: ignore[arg-type]
    return replace(run, **changes)


def cells(text: str, *first: str) -> list[str]:
    """The first line of a Markdown table that begins with some cells."""
    begin = "".join(f"| {cell} " for cell in first)
    line = re.search(f"^{re.escape(begin)}[|].*$", text, re.MULTILINE)
    assert line is not None, text
    return [cell.strip() for cell in line.group().strip("|").split("|")]


def csv_row(made: Report, **first: str) -> dict[str, str]:
    """The first row of a report's CSV with some cells."""
    rows = list(csv.DictReader(made.csv.splitlines()))
    return next(row for row in rows if all(row[name] == value for name, value in first.items()))


def here(_: Worker, function: Any, *arguments: Any, timeout: float) -> Any:
    """Takes the place of `Worker.call`: in this process."""
    return function(*arguments)


def refuse(*_: object, **__: object) -> Any:
    """Takes the place of what must not be called."""
    raise AssertionError("what is there was made again, or bad input was run")


def small_task() -> Task:
    """Six metres straight ahead, beside a block."""
    block = np.array([[0.0, 4.0], [5.0, 4.0], [5.0, 6.0]])
    return Task(Scenario("near", np.zeros(3), np.array([6.0, 0.0, 0.0]), (block,)), "open")
