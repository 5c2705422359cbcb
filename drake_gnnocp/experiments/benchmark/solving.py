"""The benchmark of the optimal control problem: a folder of runs, each of a solver on a task from a guess.

The guess of Hybrid A* is searched once a task and kept for all solvers, and so is our plan, which bad guesses are made
from. Where there is no guess, or no verified plan to make bad ones from, the runs that need it are left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

from drake_gnnocp.experiments.benchmark.engine import Engine, Job
from drake_gnnocp.experiments.benchmark.guesses import (
    BAD_GUESSES,
    SEARCHED,
    MadeGuess,
    bad_guess,
    load_guess,
    save_guess,
    search_guess,
)
from drake_gnnocp.experiments.benchmark.methods import DRAKE, checked, run_solver, warm_up_solvers
from drake_gnnocp.experiments.benchmark.runs import SOLVED, Key, Run, RunFile, check_settings
from drake_gnnocp.experiments.benchmark.tasks import Task

NO_METHOD = "-"  # the method of the row that says how the guess was found


@dataclass(frozen=True)
class Settings:
    """What all runs of a folder have in common."""

    n_knots: int = 120
    max_seconds: float = 60.0  # s, for one method on one task
    search_seconds: float = 5.0  # s, for Hybrid A*


def solving_engine(folder: Path, settings: Settings) -> Engine:
    """The engine for the runs in an existing folder.

    Raises:
        RunsError: the folder holds something else, or runs with other settings.
        OSError: the folder cannot be read or written.
    """
    check_settings(folder / "settings.json", asdict(settings))
    file = RunFile(folder / "runs.csv", SOLVED)
    return Engine(file, warm_up_solvers, settings.max_seconds, settings.search_seconds)


def solving_jobs(task: Task, methods: Sequence[str], perturb: bool, settings: Settings, folder: Path) -> list[Job]:
    """The runs of a task: its guess, the methods from it, and where wanted ours from bad guesses."""

    def job(guess: str, method: str, needs: tuple[Key, str] | None) -> Job:
        key = (*task.key, guess, method, 0)
        return Job(key, partial(run_from_guess, key, task, settings, folder), needs)

    found = job(SEARCHED, NO_METHOD, None)
    used = dict.fromkeys([*methods, DRAKE] if perturb else methods)
    jobs = [found, *(job(SEARCHED, method, (found.key, "converged")) for method in used)]
    ours = ((*task.key, SEARCHED, DRAKE, 0), "verified")
    return jobs + [job(kind, DRAKE, ours) for kind in BAD_GUESSES if perturb]


def run_from_guess(key: Key, task: Task, settings: Settings, folder: Path) -> Run:
    """Make one run; its guess is kept in guesses/, and our plan from it in plans/."""
    _, _, guess_kind, method, _ = key
    scenario, name = task.local, f"{task.scenario.name}.npz"
    guess_path, plan_path = folder / "guesses" / name, folder / "plans" / name
    if not guess_path.exists():
        save_guess(guess_path, search_guess(scenario, settings.n_knots, settings.search_seconds))
    guess = load_guess(guess_path)
    start = guess.trajectory
    if method == NO_METHOD:
        run = Run(*key, total_s=guess.seconds, converged=start is not None, status=guess.reason or "found")
        return run if start is None else checked(run, scenario, start)
    if guess_kind != SEARCHED:
        optimum = load_guess(plan_path).trajectory
        assert optimum is not None
        start = bad_guess(guess_kind, scenario, optimum)
    assert start is not None
    run, trajectory = run_solver(key, scenario, start, settings.max_seconds)
    if guess_kind == SEARCHED and method == DRAKE:
        save_guess(plan_path, MadeGuess(trajectory, "", run.total_s))
    return run
