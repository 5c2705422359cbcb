"""First guesses of the optimal control problem: where a trajectory comes from before it is optimised.

torch is imported when a learned guess is first asked for: it takes a second that other plans need not wait for.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from drake_gnnocp.scenario import Scenario
from drake_gnnocp.search.hybrid_astar import HybridAStarOptions, search
from drake_gnnocp.search.path import GearedPath, n_sections
from drake_gnnocp.search.polyline import geared
from drake_gnnocp.search.rrt_star import RrtStarOptions, is_available, rrt_star_path
from drake_gnnocp.timing.speed_planner import FEWEST_INTERVALS, SpeedOptions, plan_speed
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import State

if TYPE_CHECKING:
    from drake_gnnocp.learning.checkpoint import Network

logger = logging.getLogger(__name__)

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
    rrt_star: RrtStarOptions = field(default_factory=RrtStarOptions)
    seed: int = 0  # of RRT*
    weights: Path | None = None  # of the network; None: those that come with the package


def check_available(kind: str, options: GuessOptions | None = None) -> None:
    """Raise where a kind of guess is unknown or cannot be made; load what it needs.

    Raises:
        GuessUnavailable: unknown kind, or one that needs what is not there ("auto" needs no weights but those named).
    """
    if kind not in GUESSES:
        raise GuessUnavailable(f"guess: must be one of {', '.join(GUESSES)}, not {kind!r}")
    if kind in ("auto", "gnn"):
        weights = options.weights if options else None
        try:
            load_network(weights)
        except GuessUnavailable:
            if kind == "gnn" or weights:
                raise
    if kind == "rrt_star" and not is_available():
        raise GuessUnavailable("guess: 'rrt_star' needs OMPL: pip install ompl, or pip install -e .[rrt_star]")


def load_network(weights: Path | None) -> Network:
    """The trained network in a file, or the one that comes with the package; read once, and again when it changes.

    Raises:
        GuessUnavailable: there is none.
    """
    path = weights or bundled_weights()
    return _load_network(path, path.stat().st_mtime_ns if path.exists() else 0)


@lru_cache(maxsize=8)
def _load_network(path: Path, _changed: int) -> Network:
    """The network in a file, warmed up."""
    from drake_gnnocp.learning.checkpoint import WeightsError, load_weights
    from drake_gnnocp.learning.predict import guesses

    try:
        network = load_weights(path)[0]
        list(guesses(network, Scenario("warm-up", np.zeros(3), np.array([9.0, 3.0, 1.0])), n_knots=2))
        return network
    except WeightsError as error:
        raise GuessUnavailable(f"guess: 'gnn' needs trained weights: {error}") from None


def has_network(options: GuessOptions) -> bool:
    """Whether there is a trained network; where not, a warning says so."""
    try:
        load_network(options.weights)
    except GuessUnavailable as error:
        logger.warning("%s; going on with Hybrid A*", error)
        return False
    return True


def bundled_weights(config: str = "default") -> Path:
    """The file of the weights that come with the package, of one of the networks' configurations."""
    return Path(str(resources.files("drake_gnnocp") / "weights" / f"{config}.pt"))


def gnn_guesses(scenario: Scenario, options: GuessOptions) -> Iterator[Trajectory]:
    """The network's hypotheses, the most promising first; knots equally spaced in time.

    The first takes the network's time; so does the one with which it begins to look at other views of the scene.
    """
    from drake_gnnocp.learning.predict import guesses

    return guesses(load_network(options.weights), scenario, options.n_knots)


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
    return _driven(found.path, scenario, options)


def rrt_star_guess(scenario: Scenario, options: GuessOptions, deadline: float) -> Guess:
    """RRT*, gears and headings for its path, and the speed planner; knots equally spaced in time.

    Args:
        scenario: near the origin.
        options: see `GuessOptions`.
        deadline: instant of `time.monotonic()` at which the search gives up [s].
    """
    line = rrt_star_path(scenario, options.seed, deadline=deadline, options=options.rrt_star)
    if line is None:
        reason = "out of time" if time.monotonic() > deadline else "no path"
        return Guess(None, f"RRT*: {reason} ({options.rrt_star.most_iterations} iterations at most in each search)")
    return _driven(geared(line, scenario.start, scenario.goal, scenario.vehicle), scenario, options)


def _driven(path: GearedPath, scenario: Scenario, options: GuessOptions) -> Guess:
    n_knots = max(options.n_knots, FEWEST_INTERVALS * n_sections(path) + 1)
    return Guess(plan_speed(path, scenario.vehicle, n_knots, options.speed), path=path)


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
    along = change[0] * np.cos(states[:, State.THETA]) + change[1] * np.sin(states[:, State.THETA])
    states[1:-1, State.V] = along[1:-1] / duration
    return Guess(Trajectory(t, states, np.zeros((options.n_knots, 2))))
