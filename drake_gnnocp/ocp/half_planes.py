r"""Obstacles as linear inequalities at every knot: what a convex program can keep clear of.

At a pose q = (x, y, theta) the signed distance of the car to a convex obstacle along its best separating axis is the
least of

    n . (c_i(q) - p)              n normal of the obstacle's edge through p, c_i the corners of the car, or
    R(theta) m . (p_i - c(q))     m normal of the car's side through c, p_i the vertices of the obstacle,

for the n or m where this is largest. The two nearest points on that axis get a row. Where the distance is negative the
two overlap, and neighbouring knots could be sent to opposite sides. So all knots of one visit (neighbours that overlap
the same obstacle) share one normal: the one with the least way out for all of them. Two neighbours that are clear with
the obstacle between them share one as well, in rows of their own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drake_gnnocp.ocp.formulation import Formulation
from drake_gnnocp.ocp.obstacles import SHORTEST_EDGE, Pairs, outward_normals
from drake_gnnocp.ocp.rows import POSE, RowBlock, Table, pose_pattern
from drake_gnnocp.vehicle import Vehicle

WITHIN = 0.8  # m, pairs that get rows
POINTS = 2  # of every knot and obstacle that get a row: a side can touch with both its ends
SWEPT_LOOKED_AT = 0.3  # m, distance of pairs whose motion to the next knot is looked at
SWEPT_WATCHED = 0.1  # m, distance of the hull of two neighbouring knots below which they get rows of their own
SWEPT_CLEARANCE = 0.03  # m, asked of these rows; less than what is watched, or they would come and go


@dataclass(frozen=True, eq=False)
class _Planes(Table):
    """The axes of P pairs: the edge's normal in the world with corners of the car, or the side's with vertices."""

    knot: np.ndarray  # (P,)
    obstacle: np.ndarray  # (P,)
    of_car: np.ndarray  # (P,) bool, whether the normal is that of a side of the car, in the body frame
    normal: np.ndarray  # (P, 2) away from the obstacle, or away from the car
    offset: np.ndarray  # (P,) of the edge or the side along the normal [m]
    points: np.ndarray  # (P, POINTS, 2) corners in the body frame, or vertices in the world [m]
    between: np.ndarray  # (P,) bool, whether the rows are there for the motion to the knot before or after


def half_planes(formulation: Formulation, poses: np.ndarray) -> list[RowBlock]:
    """Rows of all pairs of a knot and an obstacle that are near each other.

    No obstacle is asked for more than it leaves at start and goal: the knots next to them cannot have it.

    Args:
        formulation: the problem.
        poses: (N, 3) of the knots; ends that are fixed have no rows [m, m, rad].
    """
    vehicle = formulation.vehicle
    footprints = vehicle.footprints(poses)
    within = WITHIN + formulation.demand.clearance
    pairs = formulation.obstacles.pairs_within(
        footprints, formulation.reference.t, within, with_last=formulation.target is not None
    )
    if not len(pairs):
        return []
    planes = _chosen(pairs, footprints[pairs.knot], vehicle, within)
    if not len(planes.knot):
        return []
    margins = np.minimum(formulation.reference_share * formulation.end_clearances, formulation.margins)[planes.obstacle]
    margins[planes.between] = np.minimum(margins[planes.between], SWEPT_CLEARANCE)
    margins = np.maximum(margins, formulation.demand.at(poses)[planes.knot])
    knots, position, rows, columns = pose_pattern(planes.knot, POINTS)

    def evaluate(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        value, gradient = _values(planes, x.reshape(-1, 3)[position])
        return value.ravel(), gradient.ravel()

    lower = np.repeat(margins, POINTS)
    upper = np.full(len(lower), np.inf)
    return [RowBlock("half planes", evaluate, lower, upper, rows, columns, knots, POSE, group=POINTS)]


def _values(planes: _Planes, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances of the points along their axes (P, POINTS), and derivatives (P, POINTS, 3), at poses (P, 3).

    A corner turns about the rear axle under a normal that stands still, a normal of the car about a vertex that does:
    the derivative with respect to theta is the same.
    """
    cos, sin, position = np.cos(poses[:, 2]), np.sin(poses[:, 2]), poses[:, None, :2]
    of_car = planes.of_car[:, None]
    n = np.where(of_car, -_turned(planes.normal, cos, sin), planes.normal)
    arm = np.where(of_car[..., None], planes.points - position, _turned(planes.points, cos[:, None], sin[:, None]))
    along = np.sum(n[:, None] * arm, axis=2)
    value = np.where(of_car, -along, along + np.sum(n * poses[:, :2], axis=1)[:, None]) - planes.offset[:, None]
    gradient = np.empty((*value.shape, 3))
    gradient[..., :2] = n[:, None]
    gradient[..., 2] = n[:, None, 1] * arm[..., 0] - n[:, None, 0] * arm[..., 1]
    return value, gradient


def _turned(vectors: np.ndarray, cos: np.ndarray, sin: np.ndarray) -> np.ndarray:
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)


def _chosen(pairs: Pairs, corners: np.ndarray, vehicle: Vehicle, within: float) -> _Planes:
    """The axes of the pairs nearer than `within` [m], whose cars have the corners (P, 4, 2) [m]."""
    ring, n, m = pairs.rings, pairs.normals, outward_normals(corners)
    of_corners = n @ corners.transpose(0, 2, 1) - np.sum(n * ring, axis=2)[..., None]  # (P, M, 4)
    of_vertices = m @ ring.transpose(0, 2, 1) - np.sum(m * corners, axis=2)[..., None]  # (P, 4, M)
    by_edge = np.where(np.any(n != 0, axis=2), of_corners.min(axis=2), -np.inf)
    by_side = of_vertices.min(axis=2)
    edge, side, pair = by_edge.argmax(axis=1), by_side.argmax(axis=1), np.arange(len(pairs))
    distance = np.maximum(by_edge[pair, edge], by_side[pair, side])

    of_car = by_edge[pair, edge] < by_side[pair, side]
    own_normals = outward_normals(vehicle.corners)
    nearest_corners = vehicle.corners[np.argsort(of_corners[pair, edge], axis=1)[:, :POINTS]]
    nearest_vertices = ring[pair[:, None], np.argsort(of_vertices[pair, side], axis=1)[:, :POINTS]]
    planes = _Planes(
        knot=pairs.knot,
        obstacle=pairs.obstacle,
        of_car=of_car,
        normal=np.where(of_car[:, None], own_normals[side], n[pair, edge]),
        offset=np.where(
            of_car,
            np.sum(own_normals[side] * vehicle.corners[side], axis=1),
            np.sum(n[pair, edge] * ring[pair, edge], axis=1),
        ),
        points=np.where(of_car[:, None, None], nearest_vertices, nearest_corners),
        between=np.zeros(len(pairs), dtype=bool),
    )
    for visit in _visits(distance < 0, pairs):
        candidates = np.concatenate([n[visit[0]], m[visit[len(visit) // 2]]])
        normal = _way_out(candidates, corners[visit], ring[visit[0]])
        shared = _common(pairs, visit, np.broadcast_to(normal, (len(visit), 2)), corners, ring[visit[0]][None], vehicle)
        for field in ("of_car", "normal", "offset", "points"):
            getattr(planes, field)[visit] = getattr(shared, field)
    left, normals = _swept(distance, pairs, corners, m)
    both, twice = np.concatenate([left, left + 1]), np.tile(normals, (2, 1))
    swept = _common(pairs, both, twice, corners, np.tile(ring[left], (2, 1, 1)), vehicle)
    return planes.subset(np.flatnonzero(distance < within)).joined(swept)


def _common(
    pairs: Pairs, which: np.ndarray, normals: np.ndarray, corners: np.ndarray, rings: np.ndarray, vehicle: Vehicle
) -> _Planes:
    """Planes through the rings (K, M, 2) with given normals (K, 2), for the pairs `which` (K,): they are between."""
    offset = np.max(rings @ normals[..., None], axis=1)[:, 0]
    height = (corners[which] @ normals[..., None])[..., 0] - offset[:, None]
    points = vehicle.corners[np.argsort(height, axis=1)[:, :POINTS]]
    n = len(which)
    of_car, between = np.zeros(n, dtype=bool), np.ones(n, dtype=bool)
    return _Planes(pairs.knot[which], pairs.obstacle[which], of_car, normals, offset, points, between)


def _visits(overlaps: np.ndarray, pairs: Pairs) -> list[np.ndarray]:
    """Indices of pairs that overlap, in runs of neighbouring knots at one obstacle."""
    found = np.flatnonzero(overlaps)
    if not len(found):
        return []
    breaks = (np.diff(pairs.knot[found]) != 1) | (np.diff(pairs.obstacle[found]) != 0)
    return np.split(found, np.flatnonzero(breaks) + 1)


def _way_out(candidates: np.ndarray, corners: np.ndarray, ring: np.ndarray) -> np.ndarray:
    """The normal with the least way out of the ring (M, 2) for footprints (K, 4, 2) in all."""
    candidates = candidates[np.any(candidates != 0, axis=1)]
    penetration = (ring @ candidates.T).max(axis=0) - (corners @ candidates.T).min(axis=1)
    return candidates[np.argmin(np.maximum(penetration, 0.0).sum(axis=0))]


def _swept(distance: np.ndarray, pairs: Pairs, corners: np.ndarray, sides: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pairs i where the car is clear at the knots of i and i + 1, but not their hull, and the hull's best normals."""
    following = (np.diff(pairs.knot) == 1) & (np.diff(pairs.obstacle) == 0)
    clear = (distance >= 0) & (distance < SWEPT_LOOKED_AT)
    left = np.flatnonzero(following & clear[:-1] & clear[1:])
    hull = np.concatenate([corners[left], corners[left + 1]], axis=1)
    chords = corners[left + 1] - corners[left]
    across = np.stack([chords[..., 1], -chords[..., 0]], axis=-1)
    across /= np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), SHORTEST_EDGE)
    candidates = np.concatenate([pairs.normals[left], -sides[left], -sides[left + 1], across, -across], axis=1)
    turned = candidates.transpose(0, 2, 1)
    clearance = (hull @ turned).min(axis=1) - (pairs.rings[left] @ turned).max(axis=1)
    clearance[~np.any(candidates != 0, axis=2)] = -np.inf
    best = clearance.argmax(axis=1)
    pair = np.arange(len(left))
    hit = clearance[pair, best] < SWEPT_WATCHED
    return left[hit], candidates[pair, best][hit]
