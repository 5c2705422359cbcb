r"""Obstacles as linear inequalities at every knot: what a convex program can keep clear of.

At a pose q = (x, y, theta) the signed distance of the car to a convex obstacle along its best separating axis is the
least of

    n . (c_i(q) - p)              n normal of the obstacle's edge through p, c_i the corners of the car, or
    R(theta) m . (p_i - c(q))     m normal of the car's side through c, p_i the vertices of the obstacle,

for the n or m where this is largest. The two nearest points on that axis get a row, linearised at q. Where the distance
is negative the two overlap, and neighbouring knots could be sent to opposite sides. So all knots of one visit
(neighbours that overlap the same obstacle) share one normal: the one with the least way out for all of them. Two
neighbours that are clear with the obstacle between them share one as well, in rows of their own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drake_gnnocp.ocp.rings import SHORTEST_EDGE, ConvexRings, outward_normals
from drake_gnnocp.vehicle import Vehicle

POINTS = 2  # of every knot and obstacle that get a row: a side can touch with both its ends
SWEPT_NEAR = 0.3  # m, pairs whose motion in between is looked at
SWEPT_WATCHED = 0.1  # m, distance of the hull of two neighbouring knots below which they get rows of their own
SWEPT_GAP = 0.03  # m, to be asked of these rows; less than what is watched, or they would come and go


@dataclass(frozen=True)
class HalfPlanes:
    """Rows value + gradient . (q - q_0): the distances of points along their axes, to first order at the poses q_0."""

    knot: np.ndarray  # (P,) knot of every pair of a knot and an obstacle
    obstacle: np.ndarray  # (P,)
    value: np.ndarray  # (P, POINTS) [m]
    gradient: np.ndarray  # (P, POINTS, 3) with respect to x, y, theta [1, 1, m]
    between: np.ndarray  # (P,) whether the rows are there for the motion to the knot before or after

    def __len__(self) -> int:
        return len(self.knot)


def half_planes(poses: np.ndarray, obstacles: ConvexRings, vehicle: Vehicle, near: float) -> HalfPlanes:
    """Rows of all pairs of a knot and an obstacle nearer than `near`.

    Args:
        poses: (N, 3) x, y, theta of the knots; the first and the last are fixed and have no rows [m, m, rad].
        obstacles: the convex obstacles.
        vehicle: the car.
        near: [m].
    """
    footprints = vehicle.footprints(poses)
    knot, obstacle = obstacles.pairs_within(footprints, near)
    if not len(knot):
        return HalfPlanes(knot, obstacle, np.zeros((0, POINTS)), np.zeros((0, POINTS, 3)), obstacle == 0)
    corners, ring, pose = footprints[knot], obstacles.vertices[obstacle], poses[knot]

    n, m = obstacles.normals[obstacle], outward_normals(corners)
    of_corners = n @ corners.transpose(0, 2, 1) - np.sum(n * ring, axis=2)[..., None]  # (P, M, 4)
    of_vertices = m @ ring.transpose(0, 2, 1) - np.sum(m * corners, axis=2)[..., None]  # (P, 4, M)
    by_edge = np.where(np.any(n != 0, axis=2), of_corners.min(axis=2), -np.inf)
    by_side = of_vertices.min(axis=2)
    edge, side, pair = by_edge.argmax(axis=1), by_side.argmax(axis=1), np.arange(len(knot))
    distance = np.maximum(by_edge[pair, edge], by_side[pair, side])

    corner_rows = _rows(n[pair, edge], of_corners[pair, edge], corners, pose)
    vertex_rows = _rows(-m[pair, side], of_vertices[pair, side], ring, pose)
    seen_from_edge = by_edge[pair, edge] >= by_side[pair, side]
    rows = np.where(seen_from_edge[:, None, None], corner_rows, vertex_rows)
    for visit in _visits(distance < 0, knot, obstacle):
        common = _way_out(np.concatenate([n[visit[0]], m[visit[len(visit) // 2]]]), corners[visit], ring[visit[0]])
        normals = np.broadcast_to(common, (len(visit), 2))
        depth = corners[visit] @ common - (ring[visit[0]] @ common).max()
        rows[visit] = _rows(normals, depth, corners[visit], pose[visit])
    keep = np.flatnonzero(distance < near)
    left, common = _swept(distance, knot, obstacle, corners, ring, n, m)
    swept = np.concatenate([left, left + 1])
    normals, base = np.tile(common, (2, 1)), np.tile(np.max(ring[left] @ common[..., None], axis=1), (2, 1))
    extra = _rows(normals, (corners[swept] @ normals[..., None])[..., 0] - base, corners[swept], pose[swept])
    rows, pairs = np.concatenate([rows[keep], extra]), np.concatenate([keep, swept])
    between = np.arange(len(pairs)) >= len(keep)
    return HalfPlanes(knot[pairs], obstacle[pairs], rows[..., 0], rows[..., 1:], between)


def _rows(n: np.ndarray, value: np.ndarray, points: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """The nearest points' values and gradients: (P, POINTS, 4).

    A corner turns about the rear axle under a normal that stands still, a normal of the car about a vertex that does:
    the derivative with respect to theta is the same.

    Args:
        n: (P, 2) normals towards the car.
        value: (P, I) distances of the points.
        points: (P, I, 2) corners of the car or vertices [m].
        poses: (P, 3) of the car [m, m, rad].
    """
    nearest = np.argsort(value, axis=1)[:, :POINTS]
    pair = np.arange(len(n))[:, None]
    arm = points[pair, nearest] - poses[:, None, :2]
    rows = np.empty((len(n), POINTS, 4))
    rows[..., 0] = value[pair, nearest]
    rows[..., 1:3] = n[:, None]
    rows[..., 3] = n[:, None, 1] * arm[..., 0] - n[:, None, 0] * arm[..., 1]
    return rows


def _visits(overlaps: np.ndarray, knot: np.ndarray, obstacle: np.ndarray) -> list[np.ndarray]:
    """Indices of pairs that overlap, in runs of neighbouring knots at one obstacle."""
    found = np.flatnonzero(overlaps)
    if not len(found):
        return []
    breaks = (np.diff(knot[found]) != 1) | (np.diff(obstacle[found]) != 0)
    return np.split(found, np.flatnonzero(breaks) + 1)


def _way_out(candidates: np.ndarray, corners: np.ndarray, ring: np.ndarray) -> np.ndarray:
    """The normal with the least way out of the ring (M, 2) for footprints (K, 4, 2) in all."""
    candidates = candidates[np.any(candidates != 0, axis=1)]
    depth = (ring @ candidates.T).max(axis=0) - (corners @ candidates.T).min(axis=1)
    return candidates[np.argmin(np.maximum(depth, 0.0).sum(axis=0))]


def _swept(
    distance: np.ndarray,
    knot: np.ndarray,
    obstacle: np.ndarray,
    corners: np.ndarray,
    ring: np.ndarray,
    edges: np.ndarray,
    sides: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Pairs i where the car is clear at the knots of i and i + 1, but not their hull, and the hull's best normals."""
    following = (np.diff(knot) == 1) & (np.diff(obstacle) == 0)
    clear = (distance >= 0) & (distance < SWEPT_NEAR)
    left = np.flatnonzero(following & clear[:-1] & clear[1:])
    hull = np.concatenate([corners[left], corners[left + 1]], axis=1)
    chords = corners[left + 1] - corners[left]
    across = np.stack([chords[..., 1], -chords[..., 0]], axis=-1)
    across /= np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), SHORTEST_EDGE)
    candidates = np.concatenate([edges[left], -sides[left], -sides[left + 1], across, -across], axis=1)
    turned = candidates.transpose(0, 2, 1)
    gap = (hull @ turned).min(axis=1) - (ring[left] @ turned).max(axis=1)
    gap[~np.any(candidates != 0, axis=2)] = -np.inf
    best = gap.argmax(axis=1)
    pair = np.arange(len(left))
    hit = gap[pair, best] < SWEPT_WATCHED
    return left[hit], candidates[pair, best][hit]
