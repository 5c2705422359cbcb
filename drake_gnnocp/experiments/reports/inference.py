"""How long a network takes to its first guess: features of the scene, network, ranking and interpolation."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial

import pandas as pd
from tqdm import tqdm

from drake_gnnocp.experiments.benchmark.guesses import network_guess
from drake_gnnocp.experiments.benchmark.methods import Method, warm_up_planners
from drake_gnnocp.experiments.benchmark.runs import Run, table_of
from drake_gnnocp.experiments.benchmark.tasks import Task
from drake_gnnocp.experiments.benchmark.worker import Worker
from drake_gnnocp.experiments.reports.report import SPREAD, Report, percentiles, table

NOTE = """\
From a scenario to the first-ranked hypothesis on 120 knots, as the planner asks for it: features of the scene, network,
ranking and interpolation, on one thread. Milliseconds, median / 95th percentile: of every run, and of the quickest run
of each task, which is what the machine can do when nothing else is on it. The paper: 700 ms.
"""
TIMEOUT = 600.0  # s, for all runs on one task
COLUMNS = (
    "method: {method} | tasks: {tasks} | runs: {runs} | ms: <ms:1> | ms, the quickest of each task: <quickest_ms:1>"
)


def measure(tasks: Sequence[Task], methods: Sequence[Method], repeats: int) -> pd.DataFrame:
    """Runs with the seconds of the first guesses, methods and repeats in turn, in a process with one thread."""
    runs: list[Run] = []
    with Worker(partial(warm_up_planners, methods)) as worker:
        for task in tqdm(tasks, unit="task"):
            runs += worker.call(first_guesses, task, methods, repeats, timeout=TIMEOUT)
    return table_of(runs)


def first_guesses(
    task: Task, methods: Sequence[Method], repeats: int, clock: Callable[[], float] = time.perf_counter
) -> list[Run]:
    """The runs of each method's first guess, as often as wanted; `clock` says the time [s]."""
    local, runs = task.local, []
    for repeat in range(repeats):
        for method in methods:
            begin = clock()
            network_guess(local, method.options.knots, method.weights)
            runs.append(Run(*task.key, "", method.name, repeat, guess_s=clock() - begin))
    return runs


def inference_report(runs: pd.DataFrame, on: str) -> Report:
    """The networks beside each other.

    Args:
        runs: see `measure`.
        on: a line on the machine.
    """
    runs = runs.assign(ms=1e3 * runs.guess_s)
    quickest = runs.groupby(["method", "scenario"], sort=False).ms.min().rename("quickest_ms").reset_index()
    rows = runs.groupby("method", sort=False).agg(tasks=("scenario", "nunique"), runs=("ms", "size"))
    spreads = [percentiles(of, ["method"], [name], SPREAD) for of, name in ((runs, "ms"), (quickest, "quickest_ms"))]
    rows = rows.join(spreads).reset_index()
    return Report("\n".join(["# Inference\n", NOTE, on, table(rows, COLUMNS)]), rows)
