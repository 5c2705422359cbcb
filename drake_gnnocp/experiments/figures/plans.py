"""The plans that figures show: each is computed once a run, when the first figure asks for it."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from drake_gnnocp.experiments.benchmark.disparity import N_COMPARED
from drake_gnnocp.guesses import GuessUnavailable
from drake_gnnocp.guesses.learned import load_network
from drake_gnnocp.ocp.refine import MOST_ANSWERS
from drake_gnnocp.planner import Plan, PlanOptions, plan
from drake_gnnocp.planner.options import source_named
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.trajectory import Trajectory

N_KNOTS = PlanOptions().knots  # that a guess is interpolated to
ROUNDS = MOST_ANSWERS  # of refinement, at most
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


@dataclass
class Plans:
    """Plans of the bundled scenarios."""

    weights: Path | None = None  # of the network; None: those that come with the package
    dense_weights: Path | None = None  # of a network that predicts as many points as a plan has knots, if there is one
    max_seconds: float = 30.0  # s, budget of one plan
    _made: dict[tuple[str, str], Plan] = field(default_factory=dict, init=False, repr=False)

    def solved(self, name: str, source: str = "gnn") -> Solved:
        """The plan of a bundled scenario from one source of guesses.

        Raises:
            Skipped: the source is not available, or nothing was solved.
        """
        if (name, source) not in self._made:
            self.check(source)
            options = PlanOptions(weights=self.weights)
            found = plan(Scenario.load(name), source, max_seconds=self.max_seconds, options=options)
            self._made[name, source] = found
        made = self._made[name, source]
        if made.trajectory is None or made.guess is None:
            reason = made.attempts[-1].reason if made.attempts else made.status
            raise Skipped(f"no plan of {name} from {SOURCES[source]}: {reason}")
        return Solved(made.scenario, made.status, made.guess, made.trajectory)

    def solved_or_none(self, name: str, source: str = "gnn") -> Solved | None:
        """The same, None where nothing was solved or the source is not available."""
        try:
            return self.solved(name, source)
        except Skipped:
            return None

    def check(self, source: str) -> None:
        """Raise Skipped where a source of guesses is not available."""
        try:
            source_named(source, PlanOptions(weights=self.weights))
        except GuessUnavailable as error:
            raise Skipped(str(error)) from None

    def points(self, solved: Solved) -> Trajectory:
        """The network's predicted points of the hypothesis that a plan was solved from."""
        knots = self._hypotheses(self.weights, solved.scenario, len(solved.guess))
        farthest = [np.abs(guess.states - solved.guess.states).max() for guess in knots]
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

    @staticmethod
    def _hypotheses(weights: Path | None, scenario: Scenario, n: int) -> list[Trajectory]:
        """All hypotheses at n points, the most promising first; n is the network's own for what it predicts."""
        from drake_gnnocp.learning.predict import guesses

        x0, y0, _ = scenario.start  # as in `plan`: near the origin
        found = guesses(load_network(weights), scenario.translated(-x0, -y0), n)
        return [guess.translated(x0, y0) for guess in found]
