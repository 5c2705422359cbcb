r"""Guesses as they are, whether or not they lead to a plan.

Of a task's methods, each makes one guess: the network's is its first-ranked hypothesis as predicted, that of Hybrid A*
has the timing with which the planner gives it to the solver (but for paths of many gear changes, which get a finer one
there). Known local optima P* are the verified plans that any of the methods found for the task. At k = 1..N, N = 120
equal steps of their durations, the error of a guess is that to the nearest of them:

    min over P* of  1/N sum_k |p_k - p*_k|
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from tqdm import tqdm

from drake_gnnocp.experiments.benchmark.disparity import N_COMPARED
from drake_gnnocp.experiments.benchmark.engine import GRACE
from drake_gnnocp.experiments.benchmark.guesses import blocked_share, first_guess, mean_defect
from drake_gnnocp.experiments.benchmark.methods import GNN, HYBRID_ASTAR, Method, planned, warm_up_planners
from drake_gnnocp.experiments.benchmark.planning import Settings
from drake_gnnocp.experiments.benchmark.runs import GUESSED, Run, RunFile, check_settings
from drake_gnnocp.experiments.benchmark.tasks import Task
from drake_gnnocp.experiments.benchmark.worker import Worker, WorkerDied
from drake_gnnocp.experiments.reports.report import SPREAD, Report, percentiles, table
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import State

logger = logging.getLogger(__name__)

NOTE = f"""\
Guesses as they are made, whether or not they lead to a plan: the network's first-ranked hypothesis as predicted, and
the path of Hybrid A* with the timing the solver is given. At {N_COMPARED} knots, median / 95th percentile over the
tasks. *Position error*: mean over the knots of the distance to the nearest known local optimum, which are the verified
plans that any of the methods found for the task. *Blocked*: share of the knots at which the car touches an obstacle.
*Gap*: mean distance by which the guess misses the kinematic model from knot to knot.
"""
MEASURES = {"position_error_m": "position_error_m", "guess_blocked": "blocked", "guess_gap_m": "gap_m"}  # as reported
COLUMNS = """method: {method} | tasks: {tasks} | guesses: {gap_m_n} | with a known optimum: {position_error_m_n} |
    position error m: <position_error_m:2> | blocked: <blocked:2> | free of collision: {clear} | gap m: <gap_m:3>"""
GUESSED_KINDS = (GNN, HYBRID_ASTAR)  # whose guesses are measured; other methods only add their optima


def measure(folder: Path, tasks: Sequence[Task], methods: Sequence[Method], settings: Settings) -> pd.DataFrame:
    """The guesses of methods for tasks: those in a folder, and the others made and added to it.

    Raises:
        RunsError: the folder holds something else, or was made with other settings or methods.
        OSError: the folder cannot be written.
    """
    names = [method.name for method in methods]  # all of them find the optima, so the rows depend on which they are
    check_settings(folder / "settings.json", settings.to_dict(methods) | {"methods": names})
    file = RunFile(folder / "guesses.csv", GUESSED)
    keys = {task.key: [(*task.key, "", m.name, 0) for m in methods if m.kind in GUESSED_KINDS] for task in tasks}
    missing = [task for task in tasks if any(key not in file for key in keys[task.key])]
    timeout = GRACE + 2 * settings.max_seconds * len(methods)
    with Worker(partial(warm_up_planners, methods)) as worker:
        for task in tqdm(missing, unit="task"):
            try:
                runs = worker.call(raw_guesses, task, methods, settings.max_seconds, timeout=timeout)
            except WorkerDied as error:  # the next call of the command tries it again
                logger.warning("%s: %s", task.scenario.name, error)
                continue
            for run in runs:
                if run.key not in file:
                    file.add(run)
    everything = file.table
    return everything[[key in keys for key in zip(everything.scenario, everything.kind, strict=True)]]


def raw_guesses(task: Task, methods: Sequence[Method], max_seconds: float) -> list[Run]:
    """Plan a task with all methods, and measure their guesses against the plans."""
    plans = [planned(task, method, max_seconds) for method in methods]
    optima = [plan.trajectory for plan in plans if plan.verified and plan.trajectory is not None]
    runs = []
    for method in methods:
        if method.kind in GUESSED_KINDS:
            guess = raw_guess(task, method, max_seconds)
            run = Run(
                *(*task.key, "", method.name, 0),
                optima=len(optima),
                position_error_m=nearest(guess, optima),
                guess_blocked=blocked_share(task.scenario, guess),
                guess_gap_m=mean_defect(task.scenario, guess),
            )
            runs.append(run)
    return runs


def raw_guess(task: Task, method: Method, max_seconds: float) -> Trajectory | None:
    """The method's first guess at N_COMPARED knots, None where it finds none."""
    x0, y0, _ = task.scenario.start
    found = first_guess(task.local, method.kind, method.options.knots, method.weights, max_seconds)
    return None if found is None else found.translated(x0, y0).resampled(N_COMPARED)


def nearest(guess: Trajectory | None, optima: Sequence[Trajectory]) -> float:
    """Mean distance of a guess from the nearest optimum [m], NaN where there is no guess or no optimum."""
    if guess is None or not optima:
        return math.nan
    here = guess.resampled(N_COMPARED).states[:, : State.THETA]
    places = [optimum.resampled(N_COMPARED).states[:, : State.THETA] for optimum in optima]
    return min(float(np.linalg.norm(here - there, axis=1).mean()) for there in places)


def raw_report(runs: pd.DataFrame, on: str) -> Report:
    """The methods beside each other.

    Args:
        runs: with the measures of the guesses of several methods.
        on: a line on the machine.
    """
    runs = runs.rename(columns=MEASURES)
    runs["position_error_m"] = runs.position_error_m.where(runs.gap_m.notna() & (runs.optima > 0))
    groups, by, names = runs.groupby("method", sort=False), ["method"], list(MEASURES.values())
    parts = [groups[names].count().add_suffix("_n"), groups[names].mean().add_suffix("_mean")]
    cells = pd.concat([*parts, percentiles(runs, by, names, SPREAD)], axis=1)
    cells = cells[[f"{name}_{of}" for name in names for of in ("n", "mean", "median", "p95")]]
    rows = groups.agg(tasks=("scenario", "size")).join(cells).reset_index()
    clear = rows.method.map((runs.blocked == 0.0).groupby(runs.method).sum())
    markdown = "\n".join(["# Raw guesses\n", NOTE, on, table(rows.assign(clear=clear), COLUMNS)])
    return Report(markdown, rows)
