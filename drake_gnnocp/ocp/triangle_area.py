r"""Collision constraints by the triangle-area method (the paper's obstacle constraints).

The triangles that a point P spans with the edges of a convex polygon cover the polygon when P is inside, and more when
it is outside:  sum_i S(P, A_i, A_{i+1}) > S.  The excess is the area of the triangles on edges that P sees from
outside, for one edge its length times the distance. Every row is divided by what makes it the
distance of the point at the guess, and bounded below by a margin [m].

Both ways for every pair of a knot and a convex obstacle near it: corners of the car against the obstacle (rows "car")
and vertices of the obstacle against the car (rows "obstacle", in the car's frame).
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from pydrake.solvers import MathematicalProgram

from drake_gnnocp.ocp.rings import ConvexRings, padded
from drake_gnnocp.ocp.variables import Variables, add_block
from drake_gnnocp.vehicle import Vehicle

KNOTS_PER_BLOCK = 20  # in one callback: 10 took 1.2 times as long an iteration, 5 1.3 times
POINTS_PER_PAIR = 2  # corners (and vertices) of one knot and obstacle that get a row
TOUCHING = 1e-3  # m, points nearer than this say nothing of the length their row is divided by
SHORTEST = 0.05  # m, least of these lengths


@dataclass(frozen=True)
class Rows:
    """Triangle-area rows: points against convex rings, each seen from the frame of the car or of the world."""

    knot: np.ndarray  # (R,) knot of the row
    point: np.ndarray  # (R, 2) car rows: corner in the body frame; obstacle rows: vertex in the world [m]
    ring: np.ndarray  # (R, M, 2) car rows: obstacle in the world; obstacle rows: car in the body frame [m]
    is_car: np.ndarray  # (R,) bool
    distance: np.ndarray  # (R,) of the point from its ring at the guess, 0 inside [m]
    length: np.ndarray  # (R,) what the excess area is divided by [m]

    def __len__(self) -> int:
        return len(self.knot)

    def subset(self, which: np.ndarray) -> Rows:
        """Some of the rows."""
        return Rows(*(getattr(self, field.name)[which] for field in fields(Rows)))


def excess_area(points: np.ndarray, rings: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Area of the triangles on a convex ring's edges beyond the area of the ring.

    Args:
        points: (R, 2) [m].
        rings: (R, M, 2) convex, counter-clockwise; repeated vertices allowed [m].

    Returns:
        (R,) excess [m^2] and (R, 2) its gradient with respect to the point [m].
    """
    edges = np.roll(rings, -1, axis=1) - rings
    to_point = points[:, None] - rings
    cross = edges[..., 0] * to_point[..., 1] - edges[..., 1] * to_point[..., 0]  # twice the triangle, < 0 outside
    seen = cross < 0
    excess = -np.sum(cross, axis=1, where=seen)
    gradient = np.stack([np.sum(edges[..., 1], axis=1, where=seen), -np.sum(edges[..., 0], axis=1, where=seen)], 1)
    return excess, gradient


def _distance(points: np.ndarray, rings: np.ndarray) -> np.ndarray:
    """Distance of points (R, 2) to the outlines of rings (R, M, 2): (R,) [m]."""
    edges = np.roll(rings, -1, axis=1) - rings
    to_point = points[:, None] - rings
    squared = np.maximum(np.sum(edges**2, axis=2), 1e-18)  # repeated vertices
    along = np.clip(np.sum(to_point * edges, axis=2) / squared, 0.0, 1.0)
    return np.linalg.norm(to_point - along[..., None] * edges, axis=2).min(axis=1)


def row_values(rows: Rows, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Excess areas of the rows at the poses of their knots.

    Args:
        rows: R rows.
        poses: (R, 3) x, y, theta of the knot of every row [m, m, rad].

    Returns:
        (R,) excess [m^2] and (R, 3) derivatives with respect to x, y, theta [m, m, m^2].
    """
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    point = _points(rows, poses)
    excess, gradient = excess_area(point, rows.ring)
    gx, gy = gradient.T
    # car rows: d point / d theta = point - (x, y) turned by 90 degrees; obstacle rows: d point / d(x, y) = -R(-theta)
    car_theta = -gx * (point[:, 1] - poses[:, 1]) + gy * (point[:, 0] - poses[:, 0])
    derivative = np.column_stack(
        [
            np.where(rows.is_car, gx, -cos * gx + sin * gy),
            np.where(rows.is_car, gy, -sin * gx - cos * gy),
            np.where(rows.is_car, car_theta, gx * point[:, 1] - gy * point[:, 0]),
        ]
    )
    return excess, derivative


def _points(rows: Rows, poses: np.ndarray) -> np.ndarray:
    """The rows' points in the frames of their rings: (R, 2) [m]."""
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    px, py = rows.point.T
    relative_x, relative_y = px - poses[:, 0], py - poses[:, 1]
    x = np.where(rows.is_car, poses[:, 0] + cos * px - sin * py, cos * relative_x + sin * relative_y)
    y = np.where(rows.is_car, poses[:, 1] + sin * px + cos * py, cos * relative_y - sin * relative_x)
    return np.column_stack([x, y])


def near_rows(poses: np.ndarray, obstacles: ConvexRings, vehicle: Vehicle, near: float) -> Rows:
    """The rows that can become active near the guess.

    For every knot and obstacle nearer than `near` these are the two corners nearest to the obstacle and its two
    vertices nearest to the car: rows are what costs, and the others' turn comes when they are nearest in a later round.

    Args:
        poses: (N, 3) of the knots, the first and the last fixed and without rows [m, m, rad].
        obstacles: the convex obstacles.
        vehicle: the car.
        near: [m].
    """
    knot, obstacle = obstacles.pairs_within(vehicle.footprints(poses), near)
    car, rings, n = vehicle.corners, obstacles.vertices[obstacle], len(knot)
    most = max(len(car), rings.shape[1])
    corners, is_corner = np.broadcast_to(car, (n, *car.shape)), np.ones((n, len(car)), dtype=bool)
    cars = np.broadcast_to(padded(car, most), (n, most, 2))
    of_car = _nearest(knot, corners, is_corner, padded(rings, most), True, poses, near)
    of_obstacles = _nearest(knot, rings, obstacles.is_vertex[obstacle], cars, False, poses, near)
    return Rows(*(np.concatenate([getattr(part, f.name) for part in (of_car, of_obstacles)]) for f in fields(Rows)))


def _nearest(
    knot: np.ndarray,
    points: np.ndarray,
    is_point: np.ndarray,
    rings: np.ndarray,
    is_car: bool,
    poses: np.ndarray,
    near: float,
) -> Rows:
    """Of every pair the points nearest to its ring, where nearer than `near`; their lengths make the rows distances.

    Args:
        knot: (P,) of the pairs.
        points: (P, I, 2) of each, of which only those with is_point (P, I) count [m].
        is_point: see above.
        rings: (P, M, 2) [m].
        is_car: whether the points are the car's.
        poses: (N, 3) of the knots [m, m, rad].
        near: [m].
    """
    n = points.shape[1]
    rows = Rows(
        np.repeat(knot, n),
        points.reshape(-1, 2),
        np.repeat(rings, n, axis=0),
        np.full(len(knot) * n, is_car),
        np.zeros(len(knot) * n),
        np.ones(len(knot) * n),
    )
    seen = _points(rows, poses[rows.knot])
    excess, _ = excess_area(seen, rows.ring)
    distance = np.where(excess > 0, _distance(seen, rows.ring), 0.0)
    length = np.repeat(np.linalg.norm(rings.max(axis=1) - rings.min(axis=1), axis=1) / 2, n)
    np.divide(excess, distance, out=length, where=distance > TOUCHING)
    of_pair = np.where(is_point, distance.reshape(-1, n), np.inf)
    nth = np.sort(of_pair, axis=1)[:, [min(POINTS_PER_PAIR, n) - 1]]
    keep = np.flatnonzero((of_pair <= nth) & (of_pair < near))
    return replace(rows, distance=distance, length=np.maximum(length, SHORTEST)).subset(keep)


def add_triangle_areas(program: MathematicalProgram, variables: Variables, rows: Rows, margins: np.ndarray) -> None:
    """Require excess / length >= margin of every row, margins (R,) [m]."""
    for first in range(0, len(variables), KNOTS_PER_BLOCK):
        in_block = np.flatnonzero((rows.knot >= first) & (rows.knot < first + KNOTS_PER_BLOCK))
        if len(in_block):
            _add_block_of_rows(program, variables, rows.subset(in_block), margins[in_block])


def _add_block_of_rows(program: MathematicalProgram, variables: Variables, rows: Rows, margins: np.ndarray) -> None:
    knots, position = np.unique(rows.knot, return_inverse=True)
    scale = variables.state_scale / rows.length[:, None]

    def evaluate(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        poses = x.reshape(-1, 3) * variables.state_scale
        excess, derivative = row_values(rows, poses[position])
        return excess / rows.length, (derivative * scale).ravel()

    row = np.repeat(np.arange(len(rows)), 3)
    column = (3 * position[:, None] + np.arange(3)).ravel()
    upper = np.full(len(rows), np.inf)
    block = variables.knots[knots, :3].ravel()
    name = f"triangle areas at knots {knots[0]} to {knots[-1]}"
    add_block(program, evaluate, margins, upper, block, row, column, name)
