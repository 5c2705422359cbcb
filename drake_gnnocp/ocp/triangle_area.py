r"""Collision constraints by the triangle-area method (the paper's obstacle constraints).

The triangles that a point P spans with the edges of a convex polygon cover the polygon when P is inside, and more when
it is outside:  sum_i S(P, A_i, A_{i+1}) > S.  The excess is the area of the triangles on edges that P sees from
outside: for one edge, its length times the distance. Every row is divided by the length of the edges seen at the guess,
which makes it a distance near the guess, and bounded below by a margin [m].

Both ways for every pair of a knot and a convex obstacle near it: corners of the car against the obstacle (rows "car")
and vertices of the obstacle against the car (rows "obstacle", in the car's frame).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydrake.solvers import MathematicalProgram

from drake_gnnocp.ocp.variables import STATE_SCALE, Variables, add_block
from drake_gnnocp.vehicle import Vehicle

KNOTS_PER_BLOCK = 10
SHORTEST_EDGE = 0.05  # m, least length a row is divided by


@dataclass(frozen=True)
class Rows:
    """Triangle-area rows: points against convex rings, each seen from the frame of the car or of the world."""

    knot: np.ndarray  # (R,) knot of the row
    point: np.ndarray  # (R, 2) car rows: corner in the body frame; obstacle rows: vertex in the world [m]
    ring: np.ndarray  # (R, M, 2) car rows: obstacle in the world; obstacle rows: car in the body frame [m]
    is_car: np.ndarray  # (R,) bool
    length: np.ndarray  # (R,) what the excess area is divided by [m]

    def __len__(self) -> int:
        return len(self.knot)

    def subset(self, which: np.ndarray) -> Rows:
        """Some of the rows."""
        return Rows(self.knot[which], self.point[which], self.ring[which], self.is_car[which], self.length[which])


def excess_area(points: np.ndarray, rings: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Area of the triangles on a convex ring's edges beyond the area of the ring.

    Args:
        points: (R, 2) [m].
        rings: (R, M, 2) convex, counter-clockwise; repeated vertices allowed [m].

    Returns:
        (R,) excess [m^2], (R, 2) its gradient with respect to the point [m], (R,) the length of the edges seen [m].
    """
    edges = np.roll(rings, -1, axis=1) - rings
    to_point = points[:, None] - rings
    cross = edges[..., 0] * to_point[..., 1] - edges[..., 1] * to_point[..., 0]  # twice the triangle, < 0 outside
    seen = cross < 0
    excess = -np.sum(cross, axis=1, where=seen)
    gradient = np.stack([np.sum(edges[..., 1], axis=1, where=seen), -np.sum(edges[..., 0], axis=1, where=seen)], 1)
    return excess, gradient, np.sum(np.linalg.norm(edges, axis=2), axis=1, where=seen)


def row_values(rows: Rows, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Excess areas of the rows at the poses of their knots.

    Args:
        rows: R rows.
        poses: (R, 3) x, y, theta of the knot of every row [m, m, rad].

    Returns:
        (R,) excess [m^2], (R, 3) derivatives with respect to x, y, theta, (R,) length of the edges seen [m].
    """
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    px, py = rows.point.T
    relative_x, relative_y = px - poses[:, 0], py - poses[:, 1]
    world = np.column_stack([poses[:, 0] + cos * px - sin * py, poses[:, 1] + sin * px + cos * py])
    body = np.column_stack([cos * relative_x + sin * relative_y, cos * relative_y - sin * relative_x])
    point = np.where(rows.is_car[:, None], world, body)
    excess, gradient, seen = excess_area(point, rows.ring)
    gx, gy = gradient.T
    # car rows: d world / d theta = world - (x, y) turned by 90 degrees; obstacle rows: d body / d(x, y) = -R(-theta)
    car_theta = -gx * (world[:, 1] - poses[:, 1]) + gy * (world[:, 0] - poses[:, 0])
    derivative = np.column_stack(
        [
            np.where(rows.is_car, gx, -cos * gx + sin * gy),
            np.where(rows.is_car, gy, -sin * gx - cos * gy),
            np.where(rows.is_car, car_theta, gx * body[:, 1] - gy * body[:, 0]),
        ]
    )
    return excess, derivative, seen


def near_rows(poses: np.ndarray, obstacles: list[np.ndarray], vehicle: Vehicle, near: float) -> Rows:
    """The rows whose point is nearer than `near` [m] to its ring at the poses of the guess.

    Args:
        poses: (N, 3) of the knots, the first and the last fixed and without rows [m, m, rad].
        obstacles: convex rings (M_j, 2), counter-clockwise [m].
        vehicle: the car.
        near: [m].
    """
    most = max([4, *(len(ring) for ring in obstacles)])
    car = _padded(vehicle.corners, most)
    reach = near + float(np.linalg.norm(vehicle.corners, axis=1).max())
    found = []
    for ring in obstacles:
        low, high = ring.min(axis=0) - reach, ring.max(axis=0) + reach
        inside = np.all((poses[:, :2] >= low) & (poses[:, :2] <= high), axis=1)
        inside[[0, -1]] = False
        knots = np.flatnonzero(inside)
        for points, other, is_car in ((vehicle.corners, _padded(ring, most), True), (ring, car, False)):
            n = len(knots) * len(points)
            found.append(
                Rows(
                    np.repeat(knots, len(points)),
                    np.tile(points, (len(knots), 1)),
                    np.broadcast_to(other, (n, most, 2)),
                    np.full(n, is_car),
                    np.ones(n),
                )
            )
    if not found:
        empty = np.zeros(0)
        return Rows(empty.astype(int), np.zeros((0, 2)), np.zeros((0, most, 2)), empty.astype(bool), empty)
    rows = Rows(*(np.concatenate([getattr(part, name) for part in found]) for name in Rows.__dataclass_fields__))
    return _nearest(rows, poses, near)


def _nearest(rows: Rows, poses: np.ndarray, near: float) -> Rows:
    """Keep the rows nearer than `near`; their lengths are those of the edges seen."""
    excess, _, seen = row_values(rows, poses[rows.knot])
    perimeter = np.sum(np.linalg.norm(np.roll(rows.ring, -1, axis=1) - rows.ring, axis=2), axis=1)
    length = np.maximum(np.where(seen > 0, seen, perimeter / 4), SHORTEST_EDGE)
    rows = Rows(rows.knot, rows.point, rows.ring, rows.is_car, length)
    return rows.subset(np.flatnonzero(excess / length < near))


def _padded(ring: np.ndarray, n: int) -> np.ndarray:
    """The ring with its last vertex repeated to n vertices: repeated edges have no area."""
    return np.concatenate([ring, np.repeat(ring[-1:], n - len(ring), axis=0)])


def add_triangle_areas(program: MathematicalProgram, variables: Variables, rows: Rows, margin: float) -> None:
    """Require excess / length >= margin [m] of every row."""
    for first in range(0, len(variables), KNOTS_PER_BLOCK):
        in_block = (rows.knot >= first) & (rows.knot < first + KNOTS_PER_BLOCK)
        if np.any(in_block):
            _add_block_of_rows(program, variables, rows.subset(np.flatnonzero(in_block)), margin)


def _add_block_of_rows(program: MathematicalProgram, variables: Variables, rows: Rows, margin: float) -> None:
    knots, position = np.unique(rows.knot, return_inverse=True)
    scale = STATE_SCALE / rows.length[:, None]

    def evaluate(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        poses = x.reshape(-1, 3) * STATE_SCALE
        excess, derivative, _ = row_values(rows, poses[position])
        return excess / rows.length, (derivative * scale).ravel()

    row = np.repeat(np.arange(len(rows)), 3)
    column = (3 * position[:, None] + np.arange(3)).ravel()
    lower, upper = np.full(len(rows), margin), np.full(len(rows), np.inf)
    block = variables.knots[knots, :3].ravel()
    add_block(program, evaluate, lower, upper, block, row, column, f"triangle areas at knots {knots[0]} to {knots[-1]}")
