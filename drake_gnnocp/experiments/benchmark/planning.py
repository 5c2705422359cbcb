"""The benchmark of planning: a folder of runs, each of a planner on a task."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from drake_gnnocp.experiments.benchmark.engine import Engine, Job
from drake_gnnocp.experiments.benchmark.methods import Method, method_named, run_planner, warm_up_planners
from drake_gnnocp.experiments.benchmark.runs import PLANNED, RunFile, check_settings
from drake_gnnocp.experiments.benchmark.tasks import Task


@dataclass(frozen=True)
class Settings:
    """What all runs of a folder have in common."""

    max_seconds: float = 60.0  # s, wall-clock budget of a plan
    seed: int = 0  # of RRT*; a repeat adds its number
    weights: Path | None = None  # of gnn, gnn_direct and auto; None: those that come with the package

    def methods(self, names: Sequence[str]) -> list[Method]:
        """Planners by name, with the seed and the weights."""
        return [method_named(name, self.seed, self.weights) for name in names]

    def to_dict(self, methods: Sequence[Method]) -> dict[str, object]:
        """What must be the same whenever a folder's runs go on; weights by their content.

        Raises:
            OSError: a file of weights cannot be read.
        """
        files = {f"weights of {method.name}": method.weights for method in methods}
        digests = {key: hashlib.sha256(path.read_bytes()).hexdigest() for key, path in files.items() if path}
        return {"max_seconds": self.max_seconds, "seed": self.seed, **digests}


def planning_engine(folder: Path, methods: Sequence[Method], settings: Settings) -> Engine:
    """The engine for the runs in an existing folder.

    Raises:
        RunsError: the folder holds something else, or runs with other settings.
        OSError: the folder, or a file of weights, cannot be read or written.
    """
    check_settings(folder / "settings.json", settings.to_dict(methods))
    file = RunFile(folder / "runs.csv", PLANNED)
    return Engine(file, partial(warm_up_planners, methods), settings.max_seconds)


def planning_jobs(
    tasks: Sequence[Task], methods: Sequence[Method], repeats: int, settings: Settings
) -> list[list[Job]]:
    """The runs of every task: all methods, and then all of them again."""
    return [
        [
            Job((*task.key, "", method.name, n), partial(run_planner, task, method, n, settings.max_seconds))
            for n in range(repeats)
            for method in methods
        ]
        for task in tasks
    ]
