"""The benchmark: which runs there are, each in the worker, and what is done already.

A task's methods run one after the other, so that a machine that is busy for a while slows all of them.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from tqdm import tqdm

from drake_gnnocp.experiments.ocp_benchmark.guesses import (
    BAD_GUESSES,
    HYBRID_ASTAR,
    MadeGuess,
    bad_guess,
    load_guess,
    save_guess,
    search_guess,
)
from drake_gnnocp.experiments.ocp_benchmark.methods import DRAKE, Outcome, run_method, warm_up
from drake_gnnocp.experiments.ocp_benchmark.runs import Run, RunsError, append_run, read_runs
from drake_gnnocp.experiments.ocp_benchmark.worker import Worker, WorkerDied
from drake_gnnocp.experiments.tasks.open_maps import random_task, task_name
from drake_gnnocp.files import write_atomically
from drake_gnnocp.ocp.cost import CostWeights, evaluate_cost
from drake_gnnocp.scenario import Scenario, bundled_scenarios
from drake_gnnocp.verification import verify

logger = logging.getLogger(__name__)

NO_METHOD = "-"  # the method of the row that says how the guess was found
LIBRARY = "library"


@dataclass(frozen=True)
class Settings:
    """What all runs of a folder have in common."""

    n_knots: int = 120
    max_seconds: float = 60.0  # s, for one method on one task
    search_seconds: float = 5.0  # s, for Hybrid A*


@dataclass(frozen=True)
class Task:
    """A scenario by name: the bundled one, or task `index` of a seed."""

    name: str
    seed: int | None = None  # None: bundled
    index: int = 0

    @property
    def group(self) -> str:
        """Where the task is from."""
        return LIBRARY if self.seed is None else f"random, seed {self.seed}"

    def scenario(self) -> Scenario:
        """The scenario, with its start at the origin."""
        scenario = Scenario.load(self.name) if self.seed is None else random_task(self.seed, self.index)
        x0, y0, _ = scenario.start
        return scenario.translated(-x0, -y0)


@dataclass(frozen=True)
class Job:
    """One run to be made."""

    task: Task
    guess: str
    method: str

    @property
    def key(self) -> tuple[str, str, str, str]:
        """That of the `Run` it will be."""
        return self.task.group, self.task.name, self.guess, self.method


def random_tasks(seed: int, n: int) -> list[Task]:
    """The first n tasks of a seed."""
    return [Task(task_name(seed, i), seed, i) for i in range(n)]


def library_tasks() -> list[Task]:
    """All bundled scenarios."""
    return [Task(name) for name in bundled_scenarios()]


def run_benchmark(
    tasks: list[Task],
    methods_of: Callable[[int], Iterable[str]],
    perturb: bool,
    settings: Settings,
    folder: Path,
) -> list[Run]:
    """Make the runs that are not in DIR/runs.csv yet.

    Args:
        tasks: to run.
        methods_of: the methods to run on the task of an index.
        perturb: whether to start ours from bad guesses as well.
        settings: common to all runs of the folder.
        folder: existing one that holds everything.

    Returns:
        All runs in the file, the older ones too.

    Raises:
        RunsError: the folder holds something else.
        OSError: the folder cannot be read or written.
    """
    _check_settings(folder / "settings.json", settings)
    path = folder / "runs.csv"
    runs = {run.key: run for run in read_runs(path)}

    def run(worker: Worker, job: Job) -> Run:
        if job.key not in runs:
            runs[job.key] = _in_worker(worker, job, settings, folder)
            append_run(path, runs[job.key])
        return runs[job.key]

    with Worker(warm_up) as worker:
        for i, task in enumerate(tqdm(tasks, unit="task")):
            if not run(worker, Job(task, HYBRID_ASTAR, NO_METHOD)).converged:
                continue
            for method in methods_of(i):
                run(worker, Job(task, HYBRID_ASTAR, method))
            if perturb and run(worker, Job(task, HYBRID_ASTAR, DRAKE)).verified:
                for kind in BAD_GUESSES:
                    run(worker, Job(task, kind, DRAKE))
    return list(runs.values())


def _check_settings(path: Path, settings: Settings) -> None:
    text = json.dumps(asdict(settings), indent=1) + "\n"
    if not path.exists():
        write_atomically(path, text)
    elif path.read_text(encoding="utf-8", errors="replace") != text:
        raise RunsError(f"{path}: the runs here were made with other settings; choose another --out or remove it")


def _in_worker(worker: Worker, job: Job, settings: Settings, folder: Path) -> Run:
    # what stops by itself stops well before
    timeout = 60.0 + 2 * max(settings.max_seconds, settings.search_seconds)
    try:
        run: Run = worker.call(perform, job, settings, folder, timeout=timeout)
    except WorkerDied as error:
        logger.warning("%s: %s", " ".join(job.key), error)
        nan = float("nan")
        limit = settings.max_seconds  # counted as if it had used all of it
        return Run(*job.key, 0.0, limit, limit, 0, 0, 0, 0, 0, nan, nan, False, False, "crashed", str(error))
    return run


def perform(job: Job, settings: Settings, folder: Path) -> Run:
    """Make one run; called in the worker."""
    scenario = job.task.scenario()
    guess = _guess(job.task, scenario, settings, folder)
    plan_path = folder / "plans" / f"{job.task.name}.npz"
    if job.method == NO_METHOD:
        return _run_of_guess(job, scenario, guess)
    start = guess.trajectory
    if job.guess != HYBRID_ASTAR:
        optimum = load_guess(plan_path).trajectory
        assert optimum is not None
        start = bad_guess(job.guess, scenario, optimum)
    assert start is not None
    outcome = run_method(job.method, scenario, start, settings.max_seconds)
    if job.guess == HYBRID_ASTAR and job.method == DRAKE:
        save_guess(plan_path, MadeGuess(outcome.trajectory, "", outcome.wall_seconds))
    return _run_of(job, scenario, outcome)


def _guess(task: Task, scenario: Scenario, settings: Settings, folder: Path) -> MadeGuess:
    path = folder / "guesses" / f"{task.name}.npz"
    if not path.exists():
        save_guess(path, search_guess(scenario, settings.n_knots, settings.search_seconds))
    return load_guess(path)


def _run_of_guess(job: Job, scenario: Scenario, guess: MadeGuess) -> Run:
    trajectory, status = guess.trajectory, guess.reason or "found"
    if trajectory is None:
        nan = float("nan")
        return Run(*job.key, 0.0, 0.0, guess.seconds, 0, 0, 0, 0, 0, nan, nan, False, False, status, "")
    return _run_of(job, scenario, Outcome(trajectory, 0.0, 0.0, guess.seconds, 0, 0, 0, 0, 0, True, status))


def _run_of(job: Job, scenario: Scenario, outcome: Outcome) -> Run:
    """The row of an outcome: cost and verification are computed here, for all methods alike."""
    centroids = np.array([[p.centroid.x, p.centroid.y] for p in scenario.polygons]).reshape(-1, 2)
    check = verify(scenario, outcome.trajectory)
    return Run(
        *job.key,
        build_s=outcome.build_seconds,
        solve_s=outcome.solve_seconds,
        wall_s=outcome.wall_seconds,
        convex_steps=outcome.convex_steps,
        first_iterations=outcome.first_iterations,
        iterations=outcome.iterations,
        rounds=outcome.rounds,
        rows=outcome.rows,
        cost=evaluate_cost(outcome.trajectory, centroids, CostWeights()).J,
        clearance_m=check.min_clearance_m,
        converged=outcome.converged,
        verified=check.verified,
        status=outcome.status,
        faults="; ".join(check.faults),
    )
