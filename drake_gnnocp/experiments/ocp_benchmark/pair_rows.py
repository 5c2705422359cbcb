"""Triangle-area rows of the peers: which points are held off which convex polygon at which knot.

The problem is ours: pairs of a knot and a convex obstacle nearer than `near` at the guess; for each, the corners of the
car nearest to the obstacle and the vertices of the obstacle nearest to the car. The code is the peers' own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from drake_gnnocp.vehicle import Vehicle

TOUCHING = 1e-3  # m, points nearer than this say nothing of the length their row is divided by
SHORTEST = 0.05  # m, least of these lengths


@dataclass(frozen=True)
class PairRows:
    """Rows of one convex polygon: sum_i S(point, A_i, A_{i+1}) >= S + margin * length."""

    ring: np.ndarray  # (M, 2) convex; the obstacle in the world, or the car in its own frame [m]
    of_car: bool  # whether the points are corners of the car (else: vertices of an obstacle, seen from the car)
    knot: np.ndarray  # (R,) knot of the row
    point: np.ndarray  # (R, 2) corner in the frame of the car, or vertex in the world [m]
    length: np.ndarray  # (R,) what makes the excess over S the distance of the point at the guess [m]


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
    poses: np.ndarray, obstacles: tuple[np.ndarray, ...], vehicle: Vehicle, near: float, points_per_pair: int
) -> list[PairRows]:
    """The rows near a guess; the first and the last knot are fixed and have none.

    Args:
        poses: (N, 3) of the guess [m, m, rad].
        obstacles: convex rings (M_j, 2) [m].
        vehicle: the car.
        near: [m].
        points_per_pair: most rows of each of the two kinds for one knot and obstacle.
    """
    footprints = vehicle.footprints(poses)
    cars = shapely.polygons(footprints)
    car_ring = vehicle.corners
    found, seen_from_car = [], []
    for ring in obstacles:
        knots = np.flatnonzero(shapely.dwithin(shapely.Polygon(ring), cars, near))
        knots = knots[(knots > 0) & (knots < len(poses) - 1)]
        if len(knots):
            corners = np.broadcast_to(car_ring, (len(knots), *car_ring.shape))
            found.append(_nearest(ring, True, knots, corners, footprints[knots], near, points_per_pair))
            vertices = np.broadcast_to(ring, (len(knots), *ring.shape))
            seen = _in_car_frame(vertices, poses[knots])
            seen_from_car.append(_nearest(car_ring, False, knots, vertices, seen, near, points_per_pair))
    return [*found, *_joined(seen_from_car)]


def _in_car_frame(points: np.ndarray, poses: np.ndarray) -> np.ndarray:
    cos, sin = np.cos(poses[:, 2:]), np.sin(poses[:, 2:])
    x, y = points[..., 0] - poses[:, :1], points[..., 1] - poses[:, 1:2]
    return np.stack([cos * x + sin * y, cos * y - sin * x], axis=-1)


def _nearest(
    ring: np.ndarray, of_car: bool, knots: np.ndarray, points: np.ndarray, seen: np.ndarray, near: float, most: int
) -> PairRows:
    """At every knot the points (K, P, 2) nearest to the ring, as `seen` (K, P, 2) from its frame."""
    distance = shapely.distance(shapely.Polygon(ring), shapely.points(seen))
    excess = triangle_sum(seen, ring) - area(ring)
    length = np.full_like(distance, np.linalg.norm(np.ptp(ring, axis=0)) / 2)
    np.divide(excess, distance, out=length, where=distance > TOUCHING)
    rank = np.argsort(np.argsort(distance, axis=1), axis=1)
    row, which = np.nonzero((rank < most) & (distance < near))
    return PairRows(ring, of_car, knots[row], points[row, which], np.maximum(length[row, which], SHORTEST))


def _joined(parts: list[PairRows]) -> list[PairRows]:
    """All rows of the one polygon that they share, as one."""
    if not parts:
        return []
    knot, point, length = (
        np.concatenate([getattr(part, name) for part in parts]) for name in ("knot", "point", "length")
    )
    return [PairRows(parts[0].ring, parts[0].of_car, knot, point, length)]
