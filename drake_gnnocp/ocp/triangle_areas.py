r"""Collision constraints by the triangle-area method (the paper's obstacle constraints).

The triangles that a point P spans with the edges of a convex polygon cover the polygon when P is inside, and more when
it is outside:  sum_i S(P, A_i, A_{i+1}) > S.  The excess is the area of the triangles on edges that P sees from
outside, for one edge its length times the distance. Every row is divided by the length that makes it the distance of
the point at the reference, and bounded below by a margin [m]. Posts and the ends of thin walls have hardly any length
to be divided by: their rows are divided by SHORTEST, and the margin counts for as much less, so that the distance that
is asked for is the same.

Both ways for every pair of a knot and a convex obstacle near it: corners of the car against the obstacle (rows "car")
and vertices of the obstacle against the car (rows "obstacle", in the car's frame).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drake_gnnocp.ocp.formulation import Formulation
from drake_gnnocp.ocp.obstacles import Pairs, padded
from drake_gnnocp.ocp.rows import POSE, RowBlock, Table, pose_pattern
from drake_gnnocp.vehicle import Vehicle

KNOTS_PER_BLOCK = 20  # in one callback: 10 took 1.2 times as long an iteration, 5 1.3 times
POINTS_PER_PAIR = 2  # corners (and vertices) of one knot and obstacle that get a row
TOUCHING = 1e-3  # m, points nearer than this say nothing of the length their row is divided by
SHORTEST = 0.05  # m, least that a row is divided by: the slopes of others would be thousands


@dataclass(frozen=True, eq=False)
class AreaRows(Table):
    """Points against convex rings, each seen from the frame of the car or of the world."""

    knot: np.ndarray  # (R,) knot of the row
    obstacle: np.ndarray  # (R,)
    point: np.ndarray  # (R, 2) car rows: corner in the body frame; obstacle rows: vertex in the world [m]
    ring: np.ndarray  # (R, M, 2) car rows: obstacle in the world; obstacle rows: car in the body frame [m]
    is_car: np.ndarray  # (R,) bool
    distance: np.ndarray  # (R,) of the point from its ring at the reference, 0 inside [m]
    length: np.ndarray  # (R,) excess area over distance at the reference [m]

    def __len__(self) -> int:
        return len(self.knot)

    @property
    def divisor(self) -> np.ndarray:
        """What the excess area is divided by: (R,) [m]."""
        return np.maximum(self.length, SHORTEST)


def triangle_areas(formulation: Formulation) -> list[RowBlock]:
    """Excess >= margin times length of the rows that can become active near the reference, in blocks of knots."""
    rows = rows_near(formulation)
    demanded = formulation.demanded[rows.knot]
    least = np.maximum(formulation.least_margins[rows.obstacle], demanded)
    most = np.maximum(formulation.margins[rows.obstacle], demanded)
    margins = np.clip(formulation.reference_share * rows.distance, least, most)
    least_values = margins * (rows.length / rows.divisor)
    blocks = []
    for first in range(0, len(formulation.reference), KNOTS_PER_BLOCK):
        in_block = np.flatnonzero((rows.knot >= first) & (rows.knot < first + KNOTS_PER_BLOCK))
        if len(in_block):
            blocks.append(_block(rows.subset(in_block), least_values[in_block]))
    return blocks


def _block(rows: AreaRows, least: np.ndarray) -> RowBlock:
    knots, position, row, column = pose_pattern(rows.knot, group=1)
    divisor = rows.divisor
    per_length = 1.0 / divisor[:, None]

    def evaluate(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        excess, derivative = row_values(rows, x.reshape(-1, 3)[position])
        return excess / divisor, (derivative * per_length).ravel()

    name = f"triangle areas at knots {knots[0]} to {knots[-1]}"
    return RowBlock(name, evaluate, least, np.full(len(rows), np.inf), row, column, knots, POSE)


def rows_near(formulation: Formulation) -> AreaRows:
    """The rows that can become active near the reference.

    For every knot and obstacle near each other these are the two corners nearest to the obstacle and its two vertices
    nearest to the car: rows are what costs, and the others' turn comes when they are nearest in a later solve.
    """
    vehicle, reference, within = (
        formulation.vehicle,
        formulation.reference,
        formulation.rows_within + formulation.demand.clearance,
    )
    footprints, with_last = vehicle.footprints(reference.poses), formulation.target is not None
    pairs = formulation.obstacles.pairs_within(footprints, reference.t, within, with_last)
    of_car = _nearest_corners(pairs, vehicle, reference.poses, within)
    return of_car.joined(_nearest_vertices(pairs, vehicle, reference.poses, within))


def _nearest_corners(pairs: Pairs, vehicle: Vehicle, poses: np.ndarray, within: float) -> AreaRows:
    car = vehicle.corners
    corners = np.broadcast_to(car, (len(pairs), *car.shape))
    rings = padded(pairs.rings, max(len(car), pairs.rings.shape[1]))
    return _nearest(pairs, corners, np.ones(corners.shape[:2], dtype=bool), rings, True, poses, within)


def _nearest_vertices(pairs: Pairs, vehicle: Vehicle, poses: np.ndarray, within: float) -> AreaRows:
    most = max(len(vehicle.corners), pairs.rings.shape[1])
    cars = np.broadcast_to(padded(vehicle.corners, most), (len(pairs), most, 2))
    return _nearest(pairs, pairs.rings, pairs.is_vertex, cars, False, poses, within)


def _nearest(
    pairs: Pairs,
    points: np.ndarray,
    is_point: np.ndarray,
    rings: np.ndarray,
    is_car: bool,
    poses: np.ndarray,
    within: float,
) -> AreaRows:
    """Of every pair the points nearest to its ring, where nearer than `within`; their lengths make rows distances.

    Args:
        pairs: P pairs of a knot and an obstacle.
        points: (P, I, 2) of each, of which only those with is_point (P, I) count [m].
        is_point: see above.
        rings: (P, M, 2) [m].
        is_car: whether the points are the car's.
        poses: (N, 3) of the knots [m, m, rad].
        within: [m].
    """
    pair = np.nonzero(is_point)[0]  # of every point; most points of many triangles and one long ring are padding
    all_points, all_rings, all_knots = points[is_point], rings[pair], pairs.knot[pair]
    all_car = np.full(len(pair), is_car)
    seen = _seen(all_points, all_car, poses[all_knots])
    excess, _ = excess_area(seen, all_rings)
    distance = np.where(excess > 0, _distance(seen, all_rings), 0.0)
    length = np.linalg.norm(rings.max(axis=1) - rings.min(axis=1), axis=1)[pair] / 2
    np.divide(excess, distance, out=length, where=distance > TOUCHING)
    of_pair = np.full(is_point.shape, np.inf)
    of_pair[is_point] = distance
    nth = np.sort(of_pair, axis=1)[:, min(POINTS_PER_PAIR, points.shape[1]) - 1]
    keep = np.flatnonzero((distance <= nth[pair]) & (distance < within))
    return AreaRows(all_knots, pairs.obstacle[pair], all_points, all_rings, all_car, distance, length).subset(keep)


def row_values(rows: AreaRows, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Excess areas of the rows at the poses of their knots.

    Args:
        rows: R rows.
        poses: (R, 3) x, y, theta of the knot of every row [m, m, rad].

    Returns:
        (R,) excess [m^2] and (R, 3) derivatives with respect to x, y, theta [m, m, m^2].
    """
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    point = _seen(rows.point, rows.is_car, poses)
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


def _seen(points: np.ndarray, is_car: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """Points (R, 2) in the frames of their rings at the poses (R, 3): (R, 2) [m]."""
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    px, py = points.T
    relative_x, relative_y = px - poses[:, 0], py - poses[:, 1]
    x = np.where(is_car, poses[:, 0] + cos * px - sin * py, cos * relative_x + sin * relative_y)
    y = np.where(is_car, poses[:, 1] + sin * px + cos * py, cos * relative_y - sin * relative_x)
    return np.column_stack([x, y])


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
