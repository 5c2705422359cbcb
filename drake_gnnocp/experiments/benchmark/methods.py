"""The methods that are compared: where the guess comes from; what follows is the same planner for all.

- gnn: the network's best hypotheses, one after the other, and nothing else.
- gnn_paper: the same with the paper's network.
- hybrid_astar, rrt_star: the search with the speed planner.
- auto: gnn, then Hybrid A* where that gave no verified plan.
- gnn_direct, hybrid_astar_direct: what the guess is worth to Ipopt alone. The first guess goes straight to it, without
  convex steps before it; no other hypothesis is looked at, and no second attempt made.
"""

from __future__ import annotations

import hashlib
import signal
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from drake_gnnocp.experiments.benchmark.runs import Run, run_of_plan
from drake_gnnocp.experiments.benchmark.tasks import Task
from drake_gnnocp.guesses.sources import GuessOptions, bundled_weights, check_available
from drake_gnnocp.planner.planner import PlanOptions, plan
from drake_gnnocp.scenario import Scenario

GNN, GNN_PAPER, HYBRID_ASTAR, RRT_STAR, AUTO = "gnn", "gnn_paper", "hybrid_astar", "rrt_star", "auto"
GNN_DIRECT, HYBRID_ASTAR_DIRECT = "gnn_direct", "hybrid_astar_direct"
METHODS = (GNN, HYBRID_ASTAR, RRT_STAR, AUTO, GNN_PAPER, GNN_DIRECT, HYBRID_ASTAR_DIRECT)
DIRECT = {GNN_DIRECT: GNN, HYBRID_ASTAR_DIRECT: HYBRID_ASTAR}
KINDS = {GNN_PAPER: GNN, **DIRECT}  # of the guess that the planner is asked for, where the method's name is another
DIRECT_SHARE = 0.4  # of the time, for the network's guess: what the planner gives to the first of a search
WARM_UP_SECONDS = 5.0  # s, most for one method


@dataclass(frozen=True)
class Method:
    """A way to plan."""

    name: str  # in the rows
    kind: str  # of guess that the planner is asked for
    options: PlanOptions = PlanOptions()

    @property
    def source(self) -> str:
        """The guess that is asked for first."""
        return GNN if self.kind == AUTO else self.kind

    @property
    def weights(self) -> Path | None:
        """The file of the network, None where there is none in this method."""
        return (self.options.guess.weights or bundled_weights()) if self.source == GNN else None


@dataclass(frozen=True)
class Settings:
    """What all runs of a folder have in common."""

    max_seconds: float = 60.0  # s, wall-clock budget of a plan
    seed: int = 0  # of RRT*; a repeat adds its number
    weights: Path | None = None  # of gnn, gnn_direct and auto; None: those that come with the package

    def to_dict(self, methods: Sequence[Method]) -> dict[str, object]:
        """What must be the same whenever a folder's runs go on; weights by their content.

        Raises:
            OSError: a file of weights cannot be read.
        """
        files = {f"weights of {method.name}": method.weights for method in methods}
        digests = {key: hashlib.sha256(path.read_bytes()).hexdigest() for key, path in files.items() if path}
        return {"max_seconds": self.max_seconds, "seed": self.seed, **digests}


def methods_named(names: Sequence[str], settings: Settings) -> list[Method]:
    """Some of METHODS, with the seed and the weights of the settings."""
    return [_method_named(name, settings) for name in names]


def _method_named(name: str, settings: Settings) -> Method:
    weights = bundled_weights("paper") if name == GNN_PAPER else settings.weights
    options = PlanOptions(guess=GuessOptions(seed=settings.seed, weights=weights))
    return Method(name, KINDS.get(name, name), direct(options) if name in DIRECT else options)


def direct(options: PlanOptions) -> PlanOptions:
    """Options with which the first guess goes straight to Ipopt, and nothing else is tried."""
    refine = replace(options.refine, convex=replace(options.refine.convex, most_steps=0))
    return replace(options, refine=refine, hypotheses=1, learned_share=DIRECT_SHARE, most_attempts=1)


def check_methods(methods: Sequence[Method]) -> None:
    """Raise GuessUnavailable where a method needs what is not there; `auto` needs weights here as well."""
    for method in methods:
        check_available(method.source, method.options.guess)


def run_method(task: Task, method: Method, repeat: int, max_seconds: float) -> Run:
    """Plan a task with a method; `max_seconds` is the wall-clock budget [s]."""
    guess = replace(method.options.guess, seed=method.options.guess.seed + repeat)
    options = replace(method.options, guess=guess)
    result = plan(task.scenario, method.kind, max_seconds=max_seconds, options=options)
    return run_of_plan((*task.key, method.name, repeat), method.source, result)


def warm_up(methods: Sequence[Method]) -> None:
    """Load what the methods load at their first call, so that no run pays for it; called once in every process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # an interrupted benchmark finishes the runs under way
    block = np.array([[4.0, 2.0], [8.0, 2.0], [8.0, 4.0], [4.0, 4.0]])
    task = Task(Scenario("warm up", np.zeros(3), np.array([12.0, 0.0, 0.0]), (block,)), "")
    for method in {(each.kind, each.weights): each for each in methods}.values():  # options load nothing else
        run_method(task, method, 0, WARM_UP_SECONDS)
