"""First guesses of the optimal control problem: where a trajectory comes from before it is optimised."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from drake_gnnocp.scenario import Scenario
from drake_gnnocp.search.hybrid_astar import HybridAStarOptions, search
from drake_gnnocp.search.path import GearedPath, n_sections
from drake_gnnocp.search.speed_planner import FEWEST_INTERVALS, SpeedOptions, plan_speed
from drake_gnnocp.trajectory import Trajectory

GUESSES = ("auto", "gnn", "hybrid_astar", "rrt_star", "straight")
STRAIGHT_SPEED = 0.5  # of v_max, average along a straight guess
STRAIGHT_LEAST = 10.0  # s, shortest straight guess


class GuessUnavailable(ValueError):
    """The kind of guess asked for cannot be made here; the message says what is missing."""


@dataclass(frozen=True)
class Guess:
    """A guess, or the reason why there is none."""

    trajectory: Trajectory | None
    reason: str = ""
    path: GearedPath | None = None  # that the trajectory puts a time to


@dataclass(frozen=True)
class GuessOptions:
    """How guesses are made."""

    n_knots: int = 120
    search: HybridAStarOptions = field(default_factory=HybridAStarOptions)
    speed: SpeedOptions = field(default_factory=SpeedOptions)


def check_available(kind: str) -> None:
    """Raise where a kind of guess is unknown or cannot be made.

    Raises:
        GuessUnavailable: unknown kind, or one that needs what is not there.
    """
    if kind not in GUESSES:
        raise GuessUnavailable(f"guess: must be one of {', '.join(GUESSES)}, not {kind!r}")
    if kind == "gnn":
        raise GuessUnavailable("guess: 'gnn' needs trained weights, and this version has none; use hybrid_astar")
    if kind == "rrt_star":
        raise GuessUnavailable("guess: 'rrt_star' is not part of this version; use hybrid_astar")


def hybrid_astar_guess(scenario: Scenario, options: GuessOptions, deadline: float) -> Guess:
    """Hybrid A* and the speed planner; knots equally spaced in time.

    Args:
        scenario: near the origin.
        options: see `GuessOptions`.
        deadline: instant of `time.monotonic()` at which the search gives up [s].
    """
    found = search(scenario, options.search, deadline)
    if found.path is None:
        return Guess(None, f"Hybrid A*: {found.status} ({found.expansions} expansions)")
    n_knots = max(options.n_knots, FEWEST_INTERVALS * n_sections(found.path) + 1)
    return Guess(plan_speed(found.path, scenario.vehicle, n_knots, options.speed), path=found.path)


def straight_guess(scenario: Scenario, options: GuessOptions) -> Guess:
    """The straight line from start to goal at constant speed, the heading turning evenly, through whatever is there."""
    start, goal = scenario.start, scenario.goal
    turn = math.remainder(goal[2] - start[2], 2 * math.pi)
    change = np.array([goal[0] - start[0], goal[1] - start[1], turn])
    distance = float(np.hypot(change[0], change[1]))
    duration = max(distance / (STRAIGHT_SPEED * scenario.vehicle.v_max), STRAIGHT_LEAST)
    t = np.linspace(0.0, duration, options.n_knots)
    states = np.zeros((options.n_knots, 5))
    states[:, :3] = start + (t / duration)[:, None] * change
    return Guess(Trajectory(t, states, np.zeros((options.n_knots, 2))))

