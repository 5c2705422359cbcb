"""The numbers of the problem that the peers solve: ours, around the same guess, before any refinement.

Which points are held off which convex polygon at which knot is as with us: pairs of a knot and a convex obstacle nearer
than `row_distance` at the guess; for each, the corners of the car nearest to the obstacle and the vertices of the
obstacle nearest to the car. The code is the peers' own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import shapely

from drake_gnnocp.scenario import Scenario
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import Vehicle
from drake_gnnocp.verification import min_clearance

N_STATES, N_KNOT = 5, 7  # x, y, theta, v, phi; and a, w
POINTS_PER_PAIR = 2  # as ours; with all corners and vertices the peer took 1.5 times as long
TOUCHING = 1e-3  # m, points nearer than this say nothing of the length their row is divided by
SHORTEST = 0.05  # m, least of these lengths


@dataclass(frozen=True)
class OurNumbers:
    """What the problem has in common with ours besides the scenario and the guess."""

    row_distance: float  # m, pairs nearer than this at the guess have rows, as have sides of the bounds
    margin: float  # m, of the pairs
    bounds_margin: float  # m, of the sides
    end_share: float  # of the clearance of start and goal: no margin asks for more
    lambda1: float  # weight of J1
    lambda2: float  # weight of J2
    gamma: float  # base of J2


@dataclass(frozen=True)
class SideRows:
    """Rows of one side of the bounds: sign * (coordinate - bound) >= margin of all corners."""

    axis: int  # 0: x, 1: y
    sign: float
    bound: float  # m
    knots: np.ndarray  # (K,) that come near the side at the guess


@dataclass(frozen=True)
class PairRows:
    """Rows of one convex polygon: sum_i S(point, A_i, A_{i+1}) >= S + margin * length."""

    ring: np.ndarray  # (M, 2) convex; the obstacle in the world, or the car in its own frame [m]
    of_car: bool  # whether the points are corners of the car (else: vertices of an obstacle, seen from the car)
    knot: np.ndarray  # (R,) knot of the row
    point: np.ndarray  # (R, 2) corner in the frame of the car, or vertex in the world [m]
    length: np.ndarray  # (R,) what makes the excess over S the distance of the point at the guess [m]


@dataclass(frozen=True)
class PeerProblem:
    """One program in numbers."""

    scenario: Scenario
    guess: Trajectory
    goal: np.ndarray  # (3,) with the turns of the guess [m, m, rad]
    pairs: list[PairRows]
    sides: list[SideRows]
    margin: float  # m, of the pairs
    bounds_margin: float  # m, of the sides
    limits: np.ndarray  # (4,) of |v|, |phi|, |a|, |w| [m/s, rad, m/s^2, rad/s]
    weights: OurNumbers
    centroids: np.ndarray  # (J, 2) [m]

    @property
    def step(self) -> float:
        """The time step h, fixed [s]."""
        return self.guess.duration / (len(self.guess) - 1)

    @property
    def n_rows(self) -> int:
        """Scalar constraints, bounds on variables aside."""
        dynamics = N_STATES * (len(self.guess) - 1)
        corners = sum(len(self.scenario.vehicle.corners) * len(side.knots) for side in self.sides)
        return dynamics + corners + sum(len(rows.knot) for rows in self.pairs)


@dataclass(frozen=True)
class PeerSolution:
    """What a peer's solver returned."""

    trajectory: Trajectory
    success: bool
    status: str
    iterations: int
    build_seconds: float  # s, the program, with its derivatives where they are made beforehand
    solve_seconds: float  # s


def peer_problem(scenario: Scenario, guess: Trajectory, ours: OurNumbers) -> PeerProblem:
    """The problem of a scenario near the origin around a guess."""
    vehicle, poses, distance = scenario.vehicle, guess.poses, ours.row_distance
    ends, footprints = vehicle.footprints(np.stack([scenario.start, scenario.goal])), vehicle.footprints(poses)
    turns = 2 * math.pi * round((poses[-1, 2] - scenario.goal[2]) / (2 * math.pi))
    sides = _sides(scenario)
    at_ends = [float((sign * (ends[..., axis] - bound)).min()) for axis, sign, bound in sides]
    return PeerProblem(
        scenario=scenario,
        guess=guess,
        goal=scenario.goal + [0.0, 0.0, turns],
        pairs=near_pair_rows(poses, scenario.convex_obstacles, vehicle, distance, POINTS_PER_PAIR),
        sides=[_near_side(footprints, *side, distance) for side in sides],
        margin=min(ours.margin, ours.end_share * min_clearance(scenario, ends)),
        bounds_margin=max(min([ours.bounds_margin, *(ours.end_share * clearance for clearance in at_ends)]), 0.0),
        limits=np.array([vehicle.v_max, vehicle.phi_max, vehicle.a_max, vehicle.w_max]),
        weights=ours,
        centroids=np.array([[p.centroid.x, p.centroid.y] for p in scenario.polygons]).reshape(-1, 2),
    )


def _sides(scenario: Scenario) -> list[tuple[int, float, float]]:
    """(axis, sign, bound) of xmin, xmax, ymin, ymax."""
    if scenario.bounds is None:
        return []
    xmin, xmax, ymin, ymax = scenario.bounds
    return [(0, 1.0, xmin), (0, -1.0, xmax), (1, 1.0, ymin), (1, -1.0, ymax)]


def _near_side(footprints: np.ndarray, axis: int, sign: float, bound: float, row_distance: float) -> SideRows:
    distance = (sign * (footprints[..., axis] - bound)).min(axis=1)
    distance[[0, -1]] = np.inf  # fixed
    return SideRows(axis, sign, bound, np.flatnonzero(distance < row_distance))


def area(ring: np.ndarray) -> float:
    """Area of a convex ring (M, 2) [m^2]."""
    return float(shapely.Polygon(ring).area)


def triangle_sum(points: np.ndarray, ring: np.ndarray) -> np.ndarray:
    """The paper's left-hand side, the sum of the triangles that points (..., 2) span with the edges: (...) [m^2]."""
    to_first = ring - points[..., None, :]
    to_second = np.roll(ring, -1, axis=0) - points[..., None, :]
    cross = to_first[..., 0] * to_second[..., 1] - to_first[..., 1] * to_second[..., 0]
    return np.abs(cross).sum(axis=-1) / 2


def near_pair_rows(
    poses: np.ndarray, obstacles: tuple[np.ndarray, ...], vehicle: Vehicle, row_distance: float, points_per_pair: int
) -> list[PairRows]:
    """The rows near a guess; the first and the last knot are fixed and have none.

    Args:
        poses: (N, 3) of the guess [m, m, rad].
        obstacles: convex rings (M_j, 2) [m].
        vehicle: the car.
        row_distance: pairs nearer than this have rows [m].
        points_per_pair: most rows of each of the two kinds for one knot and obstacle.
    """
    footprints = vehicle.footprints(poses)
    cars = shapely.polygons(footprints)
    car_ring = vehicle.corners
    found, seen_from_car = [], []
    for ring in obstacles:
        knots = np.flatnonzero(shapely.dwithin(shapely.Polygon(ring), cars, row_distance))
        knots = knots[(knots > 0) & (knots < len(poses) - 1)]
        if len(knots):
            corners = np.broadcast_to(car_ring, (len(knots), *car_ring.shape))
            found.append(_nearest(ring, True, knots, corners, footprints[knots], row_distance, points_per_pair))
            vertices = np.broadcast_to(ring, (len(knots), *ring.shape))
            seen = _in_car_frame(vertices, poses[knots])
            seen_from_car.append(_nearest(car_ring, False, knots, vertices, seen, row_distance, points_per_pair))
    return [*found, *_joined(seen_from_car)]


def _in_car_frame(points: np.ndarray, poses: np.ndarray) -> np.ndarray:
    cos, sin = np.cos(poses[:, 2:]), np.sin(poses[:, 2:])
    x, y = points[..., 0] - poses[:, :1], points[..., 1] - poses[:, 1:2]
    return np.stack([cos * x + sin * y, cos * y - sin * x], axis=-1)


def _nearest(
    ring: np.ndarray,
    of_car: bool,
    knots: np.ndarray,
    points: np.ndarray,
    seen: np.ndarray,
    row_distance: float,
    most: int,
) -> PairRows:
    """At every knot the points (K, P, 2) nearest to the ring, as `seen` (K, P, 2) from its frame."""
    distance = shapely.distance(shapely.Polygon(ring), shapely.points(seen))
    excess = triangle_sum(seen, ring) - area(ring)
    length = np.full_like(distance, np.linalg.norm(np.ptp(ring, axis=0)) / 2)
    np.divide(excess, distance, out=length, where=distance > TOUCHING)
    rank = np.argsort(np.argsort(distance, axis=1), axis=1)
    row, which = np.nonzero((rank < most) & (distance < row_distance))
    return PairRows(ring, of_car, knots[row], points[row, which], np.maximum(length[row, which], SHORTEST))


def _joined(parts: list[PairRows]) -> list[PairRows]:
    """All rows of the one polygon that they share, as one."""
    if not parts:
        return []
    knot, point, length = (
        np.concatenate([getattr(part, name) for part in parts]) for name in ("knot", "point", "length")
    )
    return [PairRows(parts[0].ring, parts[0].of_car, knot, point, length)]
