"""The methods that are compared: where the guess comes from; what follows is the same planner for all.

- gnn: the network's best hypotheses, one after the other, and nothing else.
- gnn_paper: the same with the paper's network.
- hybrid_astar, rrt_star: the search with the speed planner.
- auto: gnn, then Hybrid A* where that gave no verified plan.
"""

from __future__ import annotations

import hashlib
import signal
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drake_gnnocp.benchmark.runs import Run, run_of_plan
from drake_gnnocp.benchmark.tasks import Task
from drake_gnnocp.plan.guess import GuessOptions, bundled_weights, check_available
from drake_gnnocp.plan.planner import PlanOptions, plan
from drake_gnnocp.scenario import Scenario

GNN, GNN_PAPER, HYBRID_ASTAR, RRT_STAR, AUTO = "gnn", "gnn_paper", "hybrid_astar", "rrt_star", "auto"
METHODS = (GNN, HYBRID_ASTAR, RRT_STAR, AUTO, GNN_PAPER)
LEARNED = (GNN, AUTO, GNN_PAPER)
SOURCES = {GNN_PAPER: GNN, AUTO: GNN}  # of the guess that a method asks for first, where its name is another
WARM_UP_SECONDS = 5.0  # s, most for one method


@dataclass(frozen=True)
class Settings:
    """What all runs of a folder have in common."""

    max_seconds: float = 60.0  # s, wall-clock budget of a plan
    seed: int = 0  # of RRT*; a repeat adds its number
    weights: Path | None = None  # of gnn and auto; None: those that come with the package

    def weights_of(self, method: str) -> Path | None:
        """The file that a method needs, None where it needs none."""
        if method not in LEARNED:
            return None
        return bundled_weights("paper") if method == GNN_PAPER else self.weights or bundled_weights()

    def to_dict(self, methods: list[str]) -> dict[str, object]:
        """What must be the same whenever a folder's runs go on; weights by their content.

        Raises:
            OSError: a file of weights cannot be read.
        """
        files = {f"weights of {method}": self.weights_of(method) for method in methods}
        digests = {key: hashlib.sha256(path.read_bytes()).hexdigest() for key, path in files.items() if path}
        return {"max_seconds": self.max_seconds, "seed": self.seed, **digests}


def check_methods(methods: list[str], settings: Settings) -> None:
    """Raise GuessUnavailable where a method needs what is not there; `auto` needs weights here as well."""
    for method in methods:
        check_available(SOURCES.get(method, method), GuessOptions(weights=settings.weights_of(method)))


def run_method(task: Task, method: str, repeat: int, settings: Settings) -> Run:
    """Plan a task with a method."""
    key = (*task.key, method, repeat)
    guess = GuessOptions(seed=settings.seed + repeat, weights=settings.weights_of(method))
    kind = GNN if method == GNN_PAPER else method
    result = plan(task.scenario, kind, max_seconds=settings.max_seconds, options=PlanOptions(guess=guess))
    return run_of_plan(key, SOURCES.get(method, method), result)


def warm_up(methods: list[str], settings: Settings) -> None:
    """Load what the methods load at their first call, so that no run pays for it; called once in every process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # an interrupted benchmark finishes the runs under way
    block = np.array([[4.0, 2.0], [8.0, 2.0], [8.0, 4.0], [4.0, 4.0]])
    task = Task(Scenario("warm up", np.zeros(3), np.array([12.0, 0.0, 0.0]), (block,)), "")
    short = Settings(min(settings.max_seconds, WARM_UP_SECONDS), settings.seed, settings.weights)
    for method in methods:
        run_method(task, method, 0, short)
