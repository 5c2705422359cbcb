r"""RRT*: the paper's baseline, which knows nothing of steering (Karaman and Frazzoli 2011; OMPL's implementation).

It samples positions of the middle of the car's rectangle, and joins them by straight lines. A car that drives straight,
forwards or backwards, sweeps a rectangle as wide as it is and longer than the line by half a car at either end: one
exact test a line. Near the start and the goal the car stands across the line more often than not, so there a disc as
wide as the car is all that is asked to be free; and everywhere, where that gives no path: the rectangle does not get
around all bends that the car can take.

How long it goes on is counted in iterations, not in seconds: the same seed gives the same path.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import shapely

from drake_gnnocp.budget import Budget
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.search.collision import Box
from drake_gnnocp.search.regions import search_regions

LARGEST_SEED = 2**31  # OMPL's seeds begin at 1
LONGEST_LINE = 5.0  # m, that the tree grows by at once
END_RADIUS = 5.0  # m, around start and goal, within which the ends of lines are tested with the disc only
MOST_ITERATIONS = 15000  # of one search without a path; there are two collision tests, and up to two `regions`
IMPROVING_ITERATIONS = 1500  # after the first path


def is_available() -> bool:
    """Whether OMPL is installed."""
    try:
        import ompl.geometric  # noqa: F401
    except ImportError:
        return False
    return True


def rrt_star_path(scenario: Scenario, budget: Budget, seed: int = 0) -> np.ndarray | None:
    """Positions of the middle of the car's rectangle, joined by free lines (N, 2) [m]; None where none are found.

    Args:
        scenario: the task, near the origin.
        budget: when it is over, what there is by then is returned.
        seed: the same one gives the same path, unless the budget ends the search.
    """
    for disc_radius in (END_RADIUS, math.inf):
        for region in search_regions(scenario):
            if budget.is_over:
                return None
            path = _search(_Lines(scenario, region, disc_radius), region, seed, budget)
            if path is not None:
                return path
    return None


class _Lines:
    """The collision test of straight drives in one region.

    Args:
        scenario: the task.
        region: xmin, xmax, ymin, ymax that the car does not leave [m].
        disc_radius: around start and goal, within which the disc alone is tested [m].
    """

    def __init__(self, scenario: Scenario, region: Box, disc_radius: float) -> None:
        vehicle = scenario.vehicle
        self.start, self.goal = vehicle.footprints(np.stack([scenario.start, scenario.goal])).mean(axis=1)
        self._half_length, self._half_width = 0.5 * vehicle.length, 0.5 * vehicle.width
        self._disc_radius = disc_radius
        self._low, self._high = np.array(region[0::2]), np.array(region[1::2])
        self._blocked = shapely.union_all(scenario.polygons)
        shapely.prepare(self._blocked)

    def is_free(self, a: np.ndarray, b: np.ndarray) -> bool:
        """Whether the car can drive from a to b, (2,) each [m]."""
        ends = np.array([a, b])
        if shapely.dwithin(self._blocked, shapely.linestrings(ends), self._half_width):
            return False
        if not ((ends - self._half_width >= self._low) & (ends + self._half_width <= self._high)).all():
            return False
        for end in (self.start, self.goal):
            a, b = _outside(a, b, end, self._disc_radius)
        length = math.dist(a, b)
        if length == 0.0:
            return True
        along = (b - a) / length
        across = np.array([-along[1], along[0]]) * self._half_width
        rear, front = a - self._half_length * along, b + self._half_length * along
        swept = np.array([rear - across, front - across, front + across, rear + across])
        inside = ((swept >= self._low) & (swept <= self._high)).all()
        return bool(inside) and not shapely.intersects(self._blocked, shapely.polygons(swept))


def _outside(a: np.ndarray, b: np.ndarray, centre: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """The line from a to b without what lies at its ends in a circle; (b, b) where that is all of it."""
    starts, ends = math.dist(a, centre) < radius, math.dist(b, centre) < radius
    if starts and ends:
        return b, b
    if not starts and not ends:
        return a, b
    inner, outer = (a, b) if starts else (b, a)
    step, off = outer - inner, inner - centre
    # |off + t step| = radius, 0 < t < 1
    square, half = float(step @ step), float(step @ off)
    t = (-half + math.sqrt(half**2 + square * (radius**2 - float(off @ off)))) / square
    rim = inner + t * step
    return (rim, b) if starts else (a, rim)


def _search(lines: _Lines, region: Box, seed: int, budget: Budget) -> np.ndarray | None:
    """RRT* in one region."""
    from ompl import base, geometric, util

    util.setLogLevel(util.LOG_NONE)  # it reports on stdout, and dislikes a seed that is set a second time
    util.RNG.setSeed(1 + seed % LARGEST_SEED)
    space = base.RealVectorStateSpace(2)
    bounds = base.RealVectorBounds(2)
    for axis in (0, 1):
        bounds.setLow(axis, region[2 * axis])
        bounds.setHigh(axis, region[2 * axis + 1])
    space.setBounds(bounds)
    information = base.SpaceInformation(space)
    information.setStateValidityChecker(lambda state: lines.is_free(_position(state), _position(state)))

    class Motions(base.MotionValidator):
        def checkMotion(self, first: Any, second: Any, *_: Any) -> bool:  # noqa: N802 - OMPL's name
            return lines.is_free(_position(first), _position(second))

    information.setMotionValidator(Motions(information))
    information.setup()
    problem = base.ProblemDefinition(information)
    problem.setStartAndGoalStates(_state(space, lines.start), _state(space, lines.goal))
    planner = geometric.RRTstar(information)
    planner.setProblemDefinition(problem)
    planner.setRange(LONGEST_LINE)
    planner.setup()

    first: list[int] = []  # iteration of the first path

    def is_over() -> bool:
        done = planner.numIterations()
        # the problem learns of a path when the planner ends
        if not first and math.isfinite(planner.bestCost().value()):
            first.append(done)
        limit = first[0] + IMPROVING_ITERATIONS if first else MOST_ITERATIONS
        return done >= limit or budget.is_over

    planner.solve(base.PlannerTerminationCondition(is_over))
    if not problem.hasExactSolution():
        return None
    path = problem.getSolutionPath()
    return _straightened(np.array([_position(path.getState(i)) for i in range(path.getStateCount())]), lines)


def _straightened(path: np.ndarray, lines: _Lines) -> np.ndarray:
    """The path (N, 2) without the corners that a free line, whatever its length, can leave out."""
    kept, at = [0], 0
    while at < len(path) - 1:
        at = next((k for k in range(len(path) - 1, at + 1, -1) if lines.is_free(path[at], path[k])), at + 1)
        kept.append(at)
    return path[kept]


def _position(state: Any) -> np.ndarray:
    return np.array([state[0], state[1]])


def _state(space: Any, position: np.ndarray) -> Any:
    state = space.allocState()
    state[0], state[1] = float(position[0]), float(position[1])
    return state
