"""The plans that figures show: each is computed once a run, when the first figure asks for it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drake_gnnocp.experiments.benchmark.disparity import N_COMPARED
from drake_gnnocp.guesses.sources import GuessOptions, GuessUnavailable, check_available, load_network
from drake_gnnocp.planner import Plan, PlanOptions, plan
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.trajectory import Trajectory

SOURCES = {"hybrid_astar": "Hybrid A*", "rrt_star": "RRT*", "gnn": "GNN"}  # of guesses, with their names in print


class Skipped(Exception):
    """A figure, or a part of it, cannot be drawn here; the message says why."""


@dataclass(frozen=True, eq=False)
class Solved:
    """A plan that was solved: what the solver started from and what came out."""

    scenario: Scenario
    status: str  # "verified" or "unverified"
    guess: Trajectory
    optimum: Trajectory

    @property
    def verified(self) -> bool:
        """Whether the independent check passed."""
        return self.status == "verified"

    @property
    def compared(self) -> tuple[Trajectory, Trajectory]:
        """Guess and optimum at N_COMPARED equal steps of their durations."""
        return self.guess.resampled(N_COMPARED), self.optimum.resampled(N_COMPARED)

    @property
    def title(self) -> str:
        """The scenario's name, with a warning where the plan is not verified."""
        return self.scenario.name + ("" if self.verified else f" ({self.status})")


class Plans:
    """Plans of the bundled scenarios.

    Args:
        weights: of the network; None: those that come with the package.
        dense_weights: of a network that predicts as many points as a plan has knots, if there is one.
        max_seconds: budget of one plan [s].
    """

    def __init__(
        self, weights: Path | None = None, dense_weights: Path | None = None, max_seconds: float = 30.0
    ) -> None:
        self.weights = weights
        self.dense_weights = dense_weights
        self.max_seconds = max_seconds
        self._made: dict[tuple[str, str], Plan] = {}

    def solved(self, name: str, source: str = "gnn") -> Solved:
        """The plan of a bundled scenario from one source of guesses.

        Raises:
            Skipped: the source is not available, or nothing was solved.
        """
        made = self._plan(name, source)
        if made.trajectory is None or made.guess is None:
            reason = made.attempts[-1].reason if made.attempts else made.status
            raise Skipped(f"no plan of {name} from {SOURCES[source]}: {reason}")
        return Solved(made.scenario, made.status, made.guess, made.trajectory)

    def check(self, source: str) -> None:
        """Raise Skipped where a source of guesses is not available."""
        try:
            check_available(source, GuessOptions(weights=self.weights))
        except GuessUnavailable as error:
            raise Skipped(str(error)) from None

    def points(self, solved: Solved) -> Trajectory:
        """The network's predicted points of the hypothesis that a plan was solved from."""
        knots = self._hypotheses(self.weights, solved.scenario, len(solved.guess))
        farthest = [np.abs(each.states - solved.guess.states).max() for each in knots]
        n_points = load_network(self.weights).config.points
        return self._hypotheses(self.weights, solved.scenario, n_points)[int(np.argmin(farthest))]

    def dense_points(self, scenario: Scenario) -> Trajectory:
        """The points that the network of `dense_weights` predicts.

        Raises:
            Skipped: there is no such network.
        """
        if self.dense_weights is None:
            raise Skipped("no weights of a network with as many points as knots are given (--dense-weights)")
        n_points = load_network(self.dense_weights).config.points
        return self._hypotheses(self.dense_weights, scenario, n_points)[0]

    def _plan(self, name: str, source: str) -> Plan:
        if (name, source) not in self._made:
            self.check(source)
            options = PlanOptions(guess=GuessOptions(weights=self.weights))
            scenario = Scenario.load(name)
            self._made[name, source] = plan(scenario, source, max_seconds=self.max_seconds, options=options)
        return self._made[name, source]

    @staticmethod
    def _hypotheses(weights: Path | None, scenario: Scenario, n: int) -> list[Trajectory]:
        """All hypotheses at n points, the most promising first; n is the network's own for what it predicts."""
        from drake_gnnocp.learning.predict import guesses

        x0, y0, _ = scenario.start  # as in `plan`: near the origin
        found = guesses(load_network(weights), scenario.translated(-x0, -y0), n)
        return [each.translated(x0, y0) for each in found]
