"""The data of one optimal control problem: what is asked for in one solve, around a reference."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

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
WALL = 20.0  # m, thickness of the walls around the bounds


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
    reference_share: float = REFERENCE_SHARE
    limits_margin: float = 0.0  # relative, of the vehicle's limits at the knots: v and phi can peak in between
    rows_within: float = ROWS_WITHIN
    trust_region: tuple[float, float, float] | None = TRUST_REGION  # around the reference's poses
    lines: tuple[Line, ...] = ()
    minimum_time: bool = False  # whether the time step is a variable, with the weight on time

    @property
    def step(self) -> float:
        """The time step h of the reference [s]."""
        return self.reference.duration / (len(self.reference) - 1)

    @property
    def knots(self) -> np.ndarray:
        """The reference's knots: (N, 7) x, y, theta, v, phi, a, w."""
        return np.hstack([self.reference.states, self.reference.inputs])


def formulate(
    scenario: Scenario, reference: Trajectory, weights: CostWeights, margin: float, minimum_time: bool = False
) -> Formulation:
    """The problem of a scenario around a reference, with margins no larger than what start and goal allow.

    Args:
        scenario: the task, near the origin.
        reference: equally spaced knots, any quality.
        weights: of the cost.
        margin: clearance asked of obstacles at the knots [m].
        minimum_time: whether the duration is minimised; knots slide far along the path then, so that no trust region
            can be set around the reference.
    """
    walls = bounding_walls(scenario.bounds)
    n, n_walls = len(scenario.convex_obstacles), len(walls)
    inside = np.full(n_walls, _distance_inside(scenario))
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
        trust_region=None if minimum_time else TRUST_REGION,
        minimum_time=minimum_time,
    )


def bounding_walls(bounds: tuple[float, float, float, float] | None) -> list[np.ndarray]:
    """Walls around bounds xmin, xmax, ymin, ymax [m]: rings (4, 2), counter-clockwise; none without bounds."""
    if bounds is None:
        return []
    xmin, xmax, ymin, ymax = bounds
    (left, low), (right, high) = (xmin - WALL, ymin - WALL), (xmax + WALL, ymax + WALL)
    boxes = ((left, low, xmin, high), (xmax, low, right, high), (left, low, right, ymin), (left, ymax, right, high))
    return [np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]) for x0, y0, x1, y1 in boxes]


def _distance_inside(scenario: Scenario) -> float:
    """How far inside the bounds the car is at start and goal; infinite without bounds [m]."""
    if scenario.bounds is None:
        return math.inf
    ends = scenario.vehicle.footprints(np.stack([scenario.start, scenario.goal]))
    (low, high), (xmin, xmax, ymin, ymax) = (ends.min(axis=(0, 1)), ends.max(axis=(0, 1))), scenario.bounds
    return max(0.0, float(min(low[0] - xmin, xmax - high[0], low[1] - ymin, ymax - high[1])))
