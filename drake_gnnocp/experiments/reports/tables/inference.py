"""How long a network takes to its first guess: features of the scene, network, ranking and interpolation."""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import partial

from tqdm import tqdm

from drake_gnnocp.experiments.benchmark.methods import Method, warm_up
from drake_gnnocp.experiments.benchmark.tasks import Task
from drake_gnnocp.experiments.ocp_benchmark.worker import Worker
from drake_gnnocp.experiments.reports.tables.report import CellRow, Report, percentile, report
from drake_gnnocp.experiments.reports.text import spread, table
from drake_gnnocp.guesses.sources import gnn_guesses

NOTE = """\
From a scenario to the first-ranked hypothesis on 120 knots, as the planner asks for it: features of the scene, network,
ranking and interpolation, on one thread. Milliseconds, median / 95th percentile: of every run, and of the quickest run
of each task, which is what the machine can do when nothing else is on it. The paper: 700 ms.
"""
TIMEOUT = 600.0  # s, for all runs on one task

Seconds = dict[str, list[list[float]]]  # by method, of each task's runs


def measure(tasks: Sequence[Task], methods: Sequence[Method], repeats: int) -> Seconds:
    """Seconds of the first guesses, methods and repeats in turn, in a process with one thread."""
    found: Seconds = {method.name: [] for method in methods}
    with Worker(partial(warm_up, methods)) as worker:
        for task in tqdm(tasks, unit="task"):
            runs = worker.call(first_guess_seconds, task, methods, repeats, timeout=TIMEOUT)
            for method, seconds in zip(methods, runs, strict=True):
                found[method.name].append(seconds)
    return found


def first_guess_seconds(task: Task, methods: Sequence[Method], repeats: int) -> list[list[float]]:
    """Seconds of each method's first guess, as often as wanted."""
    x0, y0, _ = task.scenario.start  # as the planner does: near the origin
    local = task.scenario.translated(-x0, -y0)
    found: list[list[float]] = [[] for _ in methods]
    for _ in range(repeats):
        for method, seconds in zip(methods, found, strict=True):
            begin = time.perf_counter()
            next(gnn_guesses(local, method.options.guess))
            seconds.append(time.perf_counter() - begin)
    return found


def inference_report(seconds: Seconds, on: str) -> Report:
    """The networks beside each other.

    Args:
        seconds: see `measure`.
        on: a line on the machine.
    """
    lines, rows = [], []
    for method, runs in seconds.items():
        every = [1e3 * each for of_task in runs for each in of_task]
        quickest = [1e3 * min(of_task) for of_task in runs]
        lines.append([method, str(len(runs)), str(len(every)), spread(every, 1), spread(quickest, 1)])
        row: CellRow = {"method": method, "tasks": len(runs), "runs": len(every)}
        for name, values in (("ms", every), ("quickest_ms", quickest)):
            row |= {f"{name}_median": percentile(values, 50), f"{name}_p95": percentile(values, 95)}
        rows.append(row)
    header = ["method", "tasks", "runs", "ms", "ms, the quickest of each task"]
    return report(["# Inference\n", NOTE, on, table(header, lines)], rows)
