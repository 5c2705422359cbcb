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
    """Split each of many polygons (B,) into convex parts that cover it exactly.

    The constrained Delaunay triangles of a polygon are merged across shared edges as long as the union stays convex
    (Hertel and Mehlhorn 1983: at most four times the least number of parts). No vertices are added.

    Returns:
        Of each polygon, convex rings, each (M, 2) and counter-clockwise [m].
    """
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
    has_holes = shapely.get_num_interior_rings(polygons) > 0
    is_plain = ((lowest > 0) | (highest < 0)) & (counts <= MOST_VERTICES) & ~has_holes
    is_plain[owners[np.abs(steps).max(axis=1) <= SAME_POINT]] = False
    plainly = np.maximum(PLAIN_TURN, CONVEX_TOLERANCE * shapely.length(polygons) ** 2)
    is_split = has_holes | (np.minimum(highest, -lowest) > plainly)  # turns both ways
    rings = np.split(corners, np.cumsum(counts[:-1]))
    convex: dict[int, tuple[np.ndarray, ...]] = {}
    for i in np.flatnonzero(is_plain).tolist():
        convex[i] = (rings[i] if lowest[i] > 0 else rings[i][::-1],)
    for i in np.flatnonzero(~is_plain & ~is_split).tolist():
        ring = clean_ring(rings[i])
        if _is_convex(ring.tolist()):
            convex[i] = tuple(_of_few_vertices(ring))
    others = iter(_split(np.delete(polygons, list(convex))))
    return tuple(convex[i] if i in convex else next(others) for i in range(len(polygons)))


def convex_parts(polygon: shapely.Polygon) -> list[np.ndarray]:
    """Split a polygon into convex parts: what `convex_parts_of` gives for one."""
    return list(convex_parts_of(np.array([polygon]))[0])


def _split(polygons: np.ndarray) -> list[tuple[np.ndarray, ...]]:
    """The convex parts of polygons (B,) that are not convex."""
    triangles, owners = shapely.get_parts(shapely.constrained_delaunay_triangles(polygons), return_index=True)
    corners = shapely.get_coordinates(triangles).reshape(-1, 4, 2)[:, :3]
    vertices, ids = _numbered(corners.reshape(-1, 2), np.repeat(owners, 3))
    ids = ids.reshape(-1, 3)
    (x, y), (u, v) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
    is_clockwise = x * v - y * u <= 0
    ids[is_clockwise] = ids[is_clockwise, ::-1]
    parts: list[list[np.ndarray]] = [[] for _ in polygons]
    for triangle, part in _merge_convex(ids, vertices):
        parts[owners[triangle]] += _of_few_vertices(vertices[part])
    return [tuple(those) for those in parts]


def _numbered(points: np.ndarray, owners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The different points (N, 2) of every owner (N,), in their order: (V, 2), and which of them each is: (N,)."""
    order = np.lexsort([points[:, 1], points[:, 0], owners])
    ordered = np.column_stack([owners, points])[order]
    is_new = np.append(True, (np.diff(ordered, axis=0) != 0).any(axis=1))[: len(points)]
    numbers = np.empty(len(points), dtype=np.intp)
    numbers[order] = np.cumsum(is_new) - 1
    return points[order[is_new]], numbers


def _of_few_vertices(ring: np.ndarray) -> list[np.ndarray]:
    """A convex ring (N, 2) cut into such of at most MOST_VERTICES: arrays of many rings are as wide as the largest."""
    if len(ring) <= MOST_VERTICES:
        return [ring]
    cuts = np.append(np.arange(0, len(ring), MOST_VERTICES - 1), len(ring))
    closed = np.concatenate([ring, ring[:1]])
    segments = [closed[first : last + 1] for first, last in pairwise(cuts)]
    pieces = [*segments, *_of_few_vertices(ring[cuts[:-1]])]
    return [piece for piece in pieces if signed_area(piece) > SMALLEST_AREA]  # vertices may be on one line


def _merge_convex(triangles: np.ndarray, vertices: np.ndarray) -> list[tuple[int, list[int]]]:
    """Merge triangles (T, 3), counter-clockwise, across every inner edge that convexity does not need.

    One pass is enough: a merge only widens the angles at the ends of the edges that are left. Every triangle has three
    half edges, each of which knows the next and the previous one around its part, and its twin in the part beyond.

    Returns:
        Of every part one triangle, and its vertices, counter-clockwise; both by number.
    """
    tails, points = triangles.ravel().tolist(), vertices.tolist()
    heads, twin_of = triangles[:, [1, 2, 0]].ravel(), _twins(triangles, len(vertices))
    twins, inner = twin_of.tolist(), np.flatnonzero((twin_of >= 0) & (triangles.ravel() < heads)).tolist()
    around = np.arange(len(tails)).reshape(-1, 3)
    nexts, befores = around[:, [1, 2, 0]].ravel().tolist(), around[:, [2, 0, 1]].ravel().tolist()
    taken_by = list(range(len(triangles)))  # the part that took a triangle's, or a triangle whose part did
    firsts = list(range(0, len(tails), 3))  # the half edge that a part begins with

    def part_of(triangle: int) -> int:
        while taken_by[triangle] != triangle:
            taken_by[triangle] = triangle = taken_by[taken_by[triangle]]
        return triangle

    def others(edge: int) -> list[int]:
        """The tails of the other half edges of a part, from the next one on."""
        found, other = [], nexts[edge]
        while other != edge:
            found.append(tails[other])
            other = nexts[other]
        return found

    for edge in inner:
        twin = twins[edge]
        joined = ((befores[edge], nexts[twin]), (befores[twin], nexts[edge]))
        sharpest = math.inf  # cross product of the edges that would meet
        for one, other in joined:
            (ax, ay), (bx, by), (cx, cy) = points[tails[one]], points[tails[other]], points[tails[nexts[other]]]
            sharpest = min(sharpest, (bx - ax) * (cy - by) - (by - ay) * (cx - bx))
        if sharpest >= 0 or (
            sharpest >= -PLAIN_TURN and _is_convex([points[vertex] for vertex in others(edge) + others(twin)])
        ):
            for one, other in joined:
                nexts[one], befores[other] = other, one
            part = part_of(edge // 3)
            taken_by[part_of(twin // 3)], firsts[part] = part, nexts[edge]
    return [
        (part, [tails[first], *others(first)])
        for part, (owner, first) in enumerate(zip(taken_by, firsts, strict=True))
        if owner == part
    ]


def _twins(triangles: np.ndarray, n: int) -> np.ndarray:
    """Of every half edge of triangles (T, 3) of n vertices the one that runs back along it: (3 T,), -1 without one."""
    tails, heads = triangles.ravel(), triangles[:, [1, 2, 0]].ravel()
    edges = np.minimum(tails, heads) * n + np.maximum(tails, heads)
    order = np.argsort(edges, kind="stable")
    pairs = np.flatnonzero(np.diff(edges[order]) == 0)
    twins = np.full(len(edges), -1)
    twins[order[pairs]], twins[order[pairs + 1]] = order[pairs + 1], order[pairs]
    return twins


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
