"""The exact decomposition of polygons into convex parts, and covers of polygons with fewer vertices.

A cover is a little larger than its polygon: it leaves out vertices at which the outline turns away from the inside, as
long as no part of the new outline is farther from the old one than a tolerance. A wall at an angle on a grid of cells
has thousands of such vertices.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import shapely
from shapely.geometry.polygon import orient

from drake_gnnocp.polygons import SAME_POINT, SMALLEST_AREA, clean_ring, following, signed_area

MOST_VERTICES = 60  # of a convex part
CONVEX_TOLERANCE = 1e-12  # of the squared perimeter: turns above -this count as convex
PLAIN_TURN = 1e-6  # m^2: sharper ones are not convex, which is quick to see
SHORTEST = 1e-9  # m, shorter chords are none, and vertices that are no deeper are on a line
ROUNDS = 40  # of leaving out vertices


def convex_parts_of(polygons: np.ndarray) -> tuple[tuple[np.ndarray, ...], ...]:
    """What `convex_parts` gives for each of many polygons (B,); those that plainly are convex are seen at once."""
    if not len(polygons):
        return ()
    counts = shapely.get_num_points(shapely.get_exterior_ring(polygons)) - 1  # a ring's last point is its first one
    corners, owners = shapely.get_coordinates(shapely.get_exterior_ring(polygons), return_index=True)
    is_last = np.append(np.diff(owners) > 0, True)
    steps = np.diff(corners, axis=0)[~is_last[:-1]]
    corners, owners = corners[~is_last], owners[~is_last]
    after = steps[following(counts)]
    turns = steps[:, 0] * after[:, 1] - steps[:, 1] * after[:, 0]
    lowest, highest = np.full(len(polygons), np.inf), np.full(len(polygons), -np.inf)
    np.minimum.at(lowest, owners, turns)
    np.maximum.at(highest, owners, turns)
    is_plain = (
        ((lowest > 0) | (highest < 0)) & (counts <= MOST_VERTICES) & (shapely.get_num_interior_rings(polygons) == 0)
    )
    is_plain[owners[np.abs(steps).max(axis=1) <= SAME_POINT]] = False
    rings = np.split(corners, np.cumsum(counts)[:-1])
    return tuple(
        (ring if turn > 0 else ring[::-1],) if plain else tuple(convex_parts(polygon))
        for polygon, ring, plain, turn in zip(polygons, rings, is_plain, lowest, strict=True)
    )


def convex_parts(polygon: shapely.Polygon) -> list[np.ndarray]:
    """Split a polygon into convex parts that cover it exactly.

    The constrained Delaunay triangles of the polygon are merged across shared edges as long as the union stays convex
    (Hertel and Mehlhorn 1983: at most four times the least number of parts). No vertices are added.

    Returns:
        Convex rings, each (M, 2) and counter-clockwise [m].
    """
    ring = clean_ring(np.asarray(polygon.exterior.coords)[:-1])
    if not polygon.interiors and _is_convex(ring.tolist()):
        return _of_few_vertices(ring)
    triangles = shapely.get_coordinates(shapely.constrained_delaunay_triangles(polygon)).reshape(-1, 4, 2)[:, :3]
    vertices, ids = np.unique(triangles.reshape(-1, 2), axis=0, return_inverse=True)
    ids = ids.reshape(-1, 3)
    (x, y), (u, v) = (triangles[:, 1] - triangles[:, 0]).T, (triangles[:, 2] - triangles[:, 0]).T
    is_clockwise = x * v - y * u <= 0
    ids[is_clockwise] = ids[is_clockwise, ::-1]
    parts = ids.tolist()
    return [few for part in _merge_convex(parts, vertices) for few in _of_few_vertices(vertices[part])]


def _of_few_vertices(ring: np.ndarray) -> list[np.ndarray]:
    """A convex ring (N, 2) cut into such of at most MOST_VERTICES: arrays of many rings are as wide as the largest."""
    if len(ring) <= MOST_VERTICES:
        return [ring]
    cuts = np.append(np.arange(0, len(ring), MOST_VERTICES - 1), len(ring))
    closed = np.concatenate([ring, ring[:1]])
    segments = [closed[first : last + 1] for first, last in pairwise(cuts)]
    pieces = [*segments, *_of_few_vertices(ring[cuts[:-1]])]
    return [piece for piece in pieces if signed_area(piece) > SMALLEST_AREA]  # vertices may be on one line


def _merge_convex(parts: list[list[int]], vertices: np.ndarray) -> list[list[int]]:
    """Merge parts, counter-clockwise vertex ids each, across every inner edge that convexity does not need.

    One pass is enough: a merge only widens the angles at the ends of the edges that are left.
    """
    parts, points = list(parts), vertices.tolist()
    owner = {edge: i for i, part in enumerate(parts) for edge in _edges(part)}
    for u, v in [edge for edge in owner if edge[::-1] in owner and edge[0] < edge[1]]:
        i, j = owner[u, v], owner[v, u]
        turn = _sharpest_turn(parts[i], parts[j], (u, v), points)
        if turn < -PLAIN_TURN:
            continue
        union = _union_across_edge(parts[i], parts[j], (u, v))
        if turn >= 0 or _is_convex([points[k] for k in union]):
            owner.update({edge: i for edge in _edges(parts[j])})
            parts[i], parts[j] = union, []
    return [part for part in parts if part]


def _sharpest_turn(first: list[int], second: list[int], edge: tuple[int, int], points: list[list[float]]) -> float:
    """The smaller cross product of the edges that meet at both ends of one that is taken out of two parts."""
    turns = []
    for one, other, corner in ((first, second, edge[0]), (second, first, edge[1])):
        (ax, ay), (bx, by) = points[one[one.index(corner) - 1]], points[corner]
        cx, cy = points[other[(other.index(corner) + 1) % len(other)]]
        turns.append((bx - ax) * (cy - by) - (by - ay) * (cx - bx))
    return min(turns)


def _edges(part: list[int]) -> list[tuple[int, int]]:
    return list(zip(part, [*part[1:], part[0]], strict=True))


def _union_across_edge(first: list[int], second: list[int], edge: tuple[int, int]) -> list[int]:
    """Join two counter-clockwise rings of vertex ids; the edge (u, v) is one of the first, (v, u) of the second."""
    u, v = edge
    i, j = first.index(v), second.index(u)  # from v around the first to u, then around the second back to v
    return first[i:] + first[:i] + (second[j:] + second[:j])[1:-1]


def _is_convex(ring: list[list[float]]) -> bool:
    # numbers of Python: rings are short, and numpy takes four times as long for so few
    edges = [(bx - ax, by - ay) for (ax, ay), (bx, by) in pairwise([*ring, ring[0]])]
    scale = sum(math.hypot(x, y) for x, y in edges) ** 2
    return all(x * v - y * u >= -CONVEX_TOLERANCE * scale for (x, y), (u, v) in pairwise([*edges, edges[0]]))


def cover(polygon: shapely.Polygon, tolerance: float) -> shapely.Polygon:
    """A polygon that covers another one with fewer vertices, its outline within a tolerance of the other's [m]."""
    oriented = orient(polygon)
    outlines = (oriented.exterior, *oriented.interiors)
    rings = [_fewer_vertices(np.asarray(outline.coords)[:-1], tolerance) for outline in outlines]
    covering = shapely.Polygon(rings[0], [ring for ring in rings[1:] if len(ring) > 2])
    return covering if covering.is_valid else polygon  # an outline that nearly touches itself may cross itself then


def _fewer_vertices(ring: np.ndarray, tolerance: float) -> np.ndarray:
    """A ring (N, 2) with its inside on the left, less some of the vertices at which it turns right, or not at all."""
    errors = np.zeros(len(ring))  # of the edges that begin at the vertices: how far they are from the old outline
    for _ in range(ROUNDS):
        before, after = np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0)
        chord = after - before
        length = np.linalg.norm(chord, axis=1)
        turn = (
            chord[:, 0] * (ring - before)[:, 1] - chord[:, 1] * (ring - before)[:, 0]
        )  # positive where it turns right
        depth = turn / np.maximum(length, SHORTEST)
        error = depth + np.maximum(errors, np.roll(errors, 1))
        may_go = (depth >= -SHORTEST) & (error <= tolerance) & (length > SHORTEST)
        # neighbours do not go at once: where several may, the shallowest goes first
        rank = np.where(may_go, error + 1e-12 * np.arange(len(ring)), np.inf)
        goes = may_go & (rank < np.roll(rank, 1)) & (rank < np.roll(rank, -1))
        if not goes.any() or len(ring) - goes.sum() < 3:
            return ring
        errors[np.flatnonzero(goes) - 1] = error[goes]  # of the edge that takes the places of two
        ring, errors = ring[~goes], errors[~goes]
    return ring
