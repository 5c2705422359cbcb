"""The data of one optimal control problem: what is asked for in one solve, around a reference."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from drake_gnnocp.ends import Target
from drake_gnnocp.ocp.costs import CostWeights, Proximity, proximity
from drake_gnnocp.ocp.obstacles import Obstacles
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import State, Vehicle

LEAST_MARGIN = 0.02  # m, asked of an obstacle even where the reference is nearer
BOUNDS_MARGIN = 0.02  # m
LINE_CLEARANCE = 0.02  # m
TRUST_REGION = (2.0, 2.0, 0.8)  # m, m, rad: keeps the solver from jumping over thin obstacles
REFERENCE_SHARE = 0.9  # of the reference's distance to an obstacle: no row asks for more but for the least margin
ROWS_WITHIN = 2.5  # m: rows farther from their obstacle at the reference are left out
END_SHARE = 0.4  # of the clearance of start and goal: no line or least margin asks for more
COMFORT = 0.1  # m
WALL = 20.0  # m, thickness of the walls around the bounds
# what is asked for over what must be, so that it can be proven; of the radius around an end, less than may be taken
DEMAND_RESERVE, END_RADIUS_SHARE = 1e-3, 0.95  # m, -


@dataclass(frozen=True, eq=False)
class Demand:
    """A clearance that is asked for at all times, with the exemption of both ends that `Scenario` states."""

    clearance: float  # m
    ends: np.ndarray  # (2, 2) positions of start and goal [m]
    end_clearances: np.ndarray  # (2,) what the car has there to obstacles and bounds [m]
    end_radius: float  # m, within which no more is asked for than the end has
    most: np.ndarray | None = None  # (N,) that is asked for at each knot [m]; None: there is no such limit

    def at(self, poses: np.ndarray) -> np.ndarray:
        """What is asked for at poses (N, 3) of the knots: (N,) [m]."""
        distance = np.linalg.norm(poses[:, None, :2] - self.ends, axis=2)
        at_ends = np.where(distance < self.end_radius, self.end_clearances, np.inf).min(axis=1)
        asked = np.minimum(self.clearance, at_ends)
        return asked if self.most is None else np.minimum(asked, self.most)


@dataclass(frozen=True)
class Line:
    """A swept separating line that is asked for."""

    interval: int  # between the knots interval and interval + 1
    obstacle: int
    clearance: float  # m, of the car's side


@dataclass(frozen=True, eq=False)
class Formulation:
    """One problem: where to, how, among what, and how far from the reference it may lead."""

    reference: Trajectory  # N equally spaced knots: gives the time step, the pairs that get rows, and the first iterate
    start: np.ndarray  # (5,) state
    goal: np.ndarray  # (5,) state, its heading in the turn in which the reference arrives
    vehicle: Vehicle
    obstacles: Obstacles  # J convex ones, those of the scenario and walls around its bounds
    end_clearances: np.ndarray  # (J,) distances of the obstacles from the car at start and goal, the smaller one [m]
    weights: CostWeights
    proximity: Proximity  # lambda2 J2
    margins: np.ndarray  # (J,) clearance asked of obstacles at the knots [m] ...
    least_margins: np.ndarray  # (J,) ... even where the reference is nearer [m]
    line_clearances: np.ndarray  # (J,) of a line that is added, and below which a pair gets one [m]
    demand: Demand  # of all obstacles alike, however far the reference is from it
    reference_share: float = REFERENCE_SHARE
    limits_margin: float = 0.0  # relative, of the vehicle's limits at the knots: v and phi can peak in between
    rows_within: float = ROWS_WITHIN
    trust_region: tuple[float, float, float] | None = TRUST_REGION  # around the reference's poses
    comfort: float = COMFORT  # m, clearance that a verified plan gets where that costs little
    lines: tuple[Line, ...] = ()
    minimum_time: bool = False  # whether the time step is a variable, with the weight on time
    target: Target | None = None  # around the goal, where the last pose is a variable; None where it is the goal

    @property
    def step(self) -> float:
        """The time step h of the reference [s]."""
        return self.reference.duration / (len(self.reference) - 1)

    @cached_property
    def demanded(self) -> np.ndarray:
        """The clearance that is asked for at the knots: (N,) [m]."""
        return self.demand.at(self.reference.poses)

    def between(self, intervals: np.ndarray, obstacles: np.ndarray) -> np.ndarray:
        """The clearance that pairs (P,) of an interval and an obstacle are to have between the knots: (P,) [m]."""
        demanded = np.maximum(self.demanded[:-1], self.demanded[1:])
        return np.maximum(self.line_clearances[obstacles], demanded[intervals])

    @property
    def knots(self) -> np.ndarray:
        """The reference's knots: (N, 7) x, y, theta, v, phi, a, w."""
        return np.hstack([self.reference.states, self.reference.inputs])


def formulate(
    scenario: Scenario,
    reference: Trajectory,
    weights: CostWeights,
    margin: float,
    minimum_time: bool = False,
    comfort: float = COMFORT,
) -> Formulation:
    """The problem of a scenario around a reference, with margins no larger than what start and goal allow.

    Args:
        scenario: the task with one goal, near the origin.
        reference: equally spaced knots, any quality.
        weights: of the cost.
        margin: clearance asked of obstacles at the knots [m].
        minimum_time: whether the duration is minimised; knots slide far along the path then, so that no trust region
            can be set around the reference, and clearance is no matter of comfort.
        comfort: clearance that a verified plan gets where that costs little [m].
    """
    target = None if scenario.exact is scenario else scenario.targets[0]
    walls = bounding_walls(scenario.bounds if isinstance(scenario.bounds, tuple) else None)
    n, n_walls = len(scenario.convex_obstacles), len(walls)
    inside = np.full(n_walls, _distances_inside(scenario).min())
    allowed = END_SHARE * float(scenario.end_clearances.min(initial=math.inf))
    of_walls = np.minimum(BOUNDS_MARGIN, END_SHARE * inside)
    turns = 2 * np.pi * np.round((reference.poses[-1, State.THETA] - scenario.goal[State.THETA]) / (2 * np.pi))
    at_rest = np.zeros(2)
    return Formulation(
        reference=reference,
        start=np.append(scenario.start, at_rest),
        goal=np.append(scenario.goal + [0.0, 0.0, turns], at_rest),
        vehicle=scenario.vehicle,
        obstacles=Obstacles.of([*scenario.convex_obstacles, *walls]),
        end_clearances=np.append(scenario.end_clearances, inside),
        weights=weights,
        proximity=proximity(scenario, reference.poses, weights),
        margins=np.append(np.full(n, margin), of_walls),
        least_margins=np.append(np.full(n, min(LEAST_MARGIN, margin, allowed)), of_walls),
        line_clearances=np.append(np.full(n, min(LINE_CLEARANCE, allowed)), of_walls),
        demand=demand_of(scenario, scenario.clearance),
        trust_region=None if minimum_time else TRUST_REGION,
        comfort=0.0 if minimum_time else comfort,
        minimum_time=minimum_time,
        target=target,
    )


def demand_of(scenario: Scenario, clearance: float) -> Demand:
    """A clearance [m] asked of a scenario's motion."""
    ends = np.stack([scenario.start, scenario.goal])[:, :2]
    at_ends = np.minimum(scenario.nearest_at_ends, _distances_inside(scenario))
    asked = clearance + DEMAND_RESERVE if clearance else 0.0
    return Demand(asked, ends, at_ends, END_RADIUS_SHARE * scenario.vehicle.length)


def bounding_walls(bounds: tuple[float, float, float, float] | None) -> list[np.ndarray]:
    """Walls around bounds xmin, xmax, ymin, ymax [m]: rings (4, 2), counter-clockwise; none without bounds."""
    if bounds is None:
        return []
    xmin, xmax, ymin, ymax = bounds
    (left, low), (right, high) = (xmin - WALL, ymin - WALL), (xmax + WALL, ymax + WALL)
    boxes = ((left, low, xmin, high), (xmax, low, right, high), (left, low, right, ymin), (left, ymax, right, high))
    return [np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]) for x0, y0, x1, y1 in boxes]


def _distances_inside(scenario: Scenario) -> np.ndarray:
    """How far inside the bounds the car is at start and goal: (2,), infinite without bounds [m]."""
    if not isinstance(scenario.bounds, tuple):
        return np.full(2, math.inf)
    ends = scenario.vehicle.footprints(np.stack([scenario.start, scenario.goal]))
    low, high = np.reshape(scenario.bounds, (2, 2)).T
    room = np.minimum(ends.min(axis=1) - low, high - ends.max(axis=1)).min(axis=1)
    return np.maximum(room, 0.0)
