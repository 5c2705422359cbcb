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
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from tqdm import tqdm

from drake_gnnocp.experiments.benchmark.benchmark import GRACE, check_settings
from drake_gnnocp.experiments.benchmark.disparity import N_COMPARED, blocked_share, mean_gap
from drake_gnnocp.experiments.benchmark.methods import GNN, HYBRID_ASTAR, Method, Settings, warm_up
from drake_gnnocp.experiments.benchmark.row_files import append_row, read_rows
from drake_gnnocp.experiments.benchmark.tasks import Task
from drake_gnnocp.experiments.ocp_benchmark.guesses import search_guess
from drake_gnnocp.experiments.ocp_benchmark.worker import Worker, WorkerDied
from drake_gnnocp.experiments.reports.tables.report import Report, report
from drake_gnnocp.experiments.reports.text import spread, table
from drake_gnnocp.guesses.sources import gnn_guesses
from drake_gnnocp.planner.planner import plan
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
GUESSED = (GNN, HYBRID_ASTAR)  # kinds whose guesses are measured; other methods only add their optima


@dataclass(frozen=True)
class RawGuess:
    """The guess of one method for one task."""

    scenario: str
    kind: str  # of the map
    method: str
    optima: int  # known local optima
    position_error_m: float  # m, mean over the knots, to the nearest of them; NaN where there is none
    blocked: float  # share of the knots, NaN where there is no guess
    gap_m: float  # m, mean error of the kinematic model

    @property
    def key(self) -> tuple[str, str, str]:
        """What makes it this guess and no other."""
        return self.scenario, self.kind, self.method


def measure(folder: Path, tasks: Sequence[Task], methods: Sequence[Method], settings: Settings) -> list[RawGuess]:
    """The guesses of methods for tasks: those in a folder, and the others made and added to it.

    Raises:
        RunsError: the folder holds something else, or was made with other settings or methods.
        OSError: the folder cannot be written.
    """
    names = [method.name for method in methods]  # all of them find the optima, so the rows depend on which they are
    check_settings(folder / "settings.json", settings.to_dict(methods) | {"methods": names})
    path = folder / "guesses.csv"
    rows = {row.key: row for row in read_rows(path, RawGuess)}
    wanted = [method for method in methods if method.kind in GUESSED]
    missing = [task for task in tasks if any((*task.key, method.name) not in rows for method in wanted)]
    timeout = GRACE + 2 * settings.max_seconds * len(methods)
    with Worker(partial(warm_up, methods)) as worker:
        for task in tqdm(missing, unit="task"):
            try:
                found = worker.call(raw_guesses, task, methods, settings.max_seconds, timeout=timeout)
            except WorkerDied as error:  # the next call of the command tries it again
                logger.warning("%s: %s", task.scenario.name, error)
                continue
            for row in found:
                if row.key not in rows:
                    append_row(path, row)
                    rows[row.key] = row
    of_tasks = {task.key for task in tasks}
    return [row for row in rows.values() if row.key[:2] in of_tasks]


def raw_guesses(task: Task, methods: Sequence[Method], max_seconds: float) -> list[RawGuess]:
    """Plan a task with all methods, and measure their guesses against the plans."""
    optima = []
    for method in methods:
        result = plan(task.scenario, method.kind, max_seconds=max_seconds, options=method.options)
        if result.verified and result.trajectory is not None:
            optima.append(result.trajectory)
    rows = []
    for method in methods:
        if method.kind in GUESSED:
            guess = raw_guess(task, method, max_seconds)
            off, blocked = nearest(guess, optima), blocked_share(task.scenario, guess)
            gap = mean_gap(task.scenario, guess)
            rows.append(RawGuess(*task.key, method.name, len(optima), off, blocked, gap))
    return rows


def raw_guess(task: Task, method: Method, max_seconds: float) -> Trajectory | None:
    """The method's first guess at N_COMPARED knots, None where it finds none."""
    x0, y0, _ = task.scenario.start  # as the planner does: near the origin
    local = task.scenario.translated(-x0, -y0)
    if method.kind == GNN:
        found: Trajectory | None = next(gnn_guesses(local, method.options.guess))
    else:
        found = search_guess(local, method.options.guess.n_knots, max_seconds).trajectory
    return None if found is None else found.translated(x0, y0).resampled(N_COMPARED)


def nearest(guess: Trajectory | None, optima: Sequence[Trajectory]) -> float:
    """Mean distance of a guess from the nearest optimum [m], NaN where there is no guess or no optimum."""
    if guess is None or not optima:
        return math.nan
    places = [each.resampled(N_COMPARED).states[:, : State.THETA] for each in optima]
    here = guess.resampled(N_COMPARED).states[:, : State.THETA]
    return min(float(np.linalg.norm(here - there, axis=1).mean()) for there in places)


def raw_report(rows: Sequence[RawGuess], on: str) -> Report:
    """The methods beside each other.

    Args:
        rows: of several methods.
        on: a line on the machine.
    """
    lines, cells = [], []
    for method in dict.fromkeys(row.method for row in rows):
        of_method = [row for row in rows if row.method == method]
        made = [row for row in of_method if not math.isnan(row.gap_m)]
        known = [row for row in made if row.optima]
        errors, blocked = [row.position_error_m for row in known], [row.blocked for row in made]
        gaps, clear = [row.gap_m for row in made], sum(row.blocked == 0.0 for row in made)
        counts = [str(len(of_method)), str(len(made)), str(len(known))]
        measures = [spread(errors, 2), spread(blocked, 2), str(clear), spread(gaps, 3)]
        lines.append([method, *counts, *measures])
        cells.append(_cells(method, of_method, {"position_error_m": errors, "blocked": blocked, "gap_m": gaps}))
    header = ["method", "tasks", "guesses", "with a known optimum", "position error m", "blocked", "free of collision"]
    return report(["# Raw guesses\n", NOTE, on, table([*header, "gap m"], lines)], cells)


def _cells(method: str, rows: Sequence[RawGuess], measures: dict[str, list[float]]) -> dict[str, str | int | float]:
    cells: dict[str, str | int | float] = {"method": method, "tasks": len(rows)}
    for name, values in measures.items():
        cells[f"{name}_n"] = len(values)
        for text, p in (("mean", None), ("median", 50), ("p95", 95)):
            if not values:
                cells[f"{name}_{text}"] = math.nan
            else:
                cells[f"{name}_{text}"] = float(np.mean(values) if p is None else np.percentile(values, p))
    return cells
