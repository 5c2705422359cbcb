"""Polygons: cleaning, validity, and the exact decomposition of concave ones into convex parts.

A ring is an (N, 2) array of vertices [m], not closed: the last vertex is joined to the first.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
import shapely

SAME_POINT = 1e-9  # m, neighbouring vertices nearer than this are one vertex
SMALLEST_AREA = 1e-9  # m^2, polygons below have no inside to speak of
PLAIN_DEPTH, PLAIN_ROUNDING = 1e-6, 1e-15  # m, and of the coordinates: deeper crossings are no matter of rounding
CHUNK = 4  # edges that are looked at together: each may cross all the others
NO_AREA, CROSSES = "has no area, or runs back along one of its own edges", "crosses itself"
TOO_FEW = "has fewer than 3 different vertices"
SPECK = 1e-8  # m, the longest outline of a piece that rounding may leave and that nobody misses
AREA_TOLERANCE = 1e-9  # relative: a ring and its repaired polygon enclose the same area
MOST_VERTICES = 60  # of a convex part
CONVEX_TOLERANCE = 1e-12  # of the squared perimeter: turns above -this count as convex


def signed_area(ring: np.ndarray) -> float:
    """Area of a ring (N, 2), positive when counter-clockwise [m^2]."""
    if len(ring) < 3:
        return 0.0
    x, y = (ring - ring[0]).T  # relative: coordinates far from the origin keep their precision
    return 0.5 * float(x @ _following(y) - y @ _following(x))


def clean_ring(ring: np.ndarray) -> np.ndarray:
    """Drop repeated neighbours (and a closing vertex) of a ring (N, 2) and turn it counter-clockwise."""
    ring = np.asarray(ring, dtype=float)
    ring = ring[np.linalg.norm(np.diff(ring, axis=0, prepend=ring[-1:]), axis=1) > SAME_POINT]
    return ring if signed_area(ring) >= 0 else ring[::-1]


def polygons_of(ring: np.ndarray) -> list[shapely.Polygon]:
    """The region a ring bounds: one polygon, or several where the ring touches itself.

    Args:
        ring: (N, 2) vertices, either orientation, neighbours may repeat [m].

    Raises:
        ValueError: the ring has fewer than three vertices, no area, or crosses itself.
    """
    ring = np.asarray(ring, dtype=float)
    if not np.isfinite(ring).all():
        raise ValueError("has a vertex that is not finite")
    ring = clean_ring(ring)
    if len(ring) < 3:
        raise ValueError(TOO_FEW)
    polygon = shapely.Polygon(ring)
    if polygon.is_valid and polygon.area > SMALLEST_AREA:
        return [polygon]
    return _pieces(ring)


def simple_polygons(rings: Sequence[np.ndarray]) -> Iterator[shapely.Polygon | None]:
    """What `polygons_of` gives for each of many rings (N, 2) where that is one plain polygon, at once; else None."""
    if not rings:
        return iter(())
    counts = np.array([len(ring) for ring in rings])
    corners = np.concatenate(rings)
    owners = np.repeat(np.arange(len(rings)), counts)
    first = np.cumsum(counts) - counts
    following = np.arange(1, len(corners) + 1)
    following[(first + counts - 1)[counts > 0]] = first[counts > 0]
    steps = np.linalg.norm(corners[following] - corners, axis=1)
    is_odd = (counts < 3) | ~np.isfinite(np.bincount(owners, np.abs(corners).sum(axis=1), len(rings)))
    is_odd[owners[~(steps > SAME_POINT)]] = True
    relative = corners - corners[np.minimum(first, len(corners) - 1)][owners]
    doubled = relative[:, 0] * relative[following, 1] - relative[:, 1] * relative[following, 0]
    is_clockwise = np.bincount(owners, doubled, len(rings)) < 0
    kept = ~is_odd[owners]
    turned = (2 * first + counts - 1)[owners] - np.arange(len(corners))  # the same ring from its end
    order = np.where(is_clockwise[owners], turned, np.arange(len(corners)))[kept]
    found = np.full(len(rings), None, dtype=object)
    if not is_odd.all():
        indices = np.repeat(np.arange(np.count_nonzero(~is_odd)), counts[~is_odd])
        plain = shapely.polygons(shapely.linearrings(corners[order], indices=indices))
        plain[~(shapely.is_valid(plain) & (shapely.area(plain) > SMALLEST_AREA))] = None
        found[~is_odd] = plain
    return iter(found)


def _pieces(ring: np.ndarray) -> list[shapely.Polygon]:
    """The polygons of a clean ring that is not simple, where it is at least free of crossings.

    Let S_k be the area that the ring winds around k times. It encloses sum k S_k, the even-odd region has S_-1 + S_1,
    and the region of all that is wound around has S_-1 + S_1 + S_2: all three agree only without S_-1 and S_2, which
    every crossing brings about.
    """
    _refuse_plain_faults(ring)  # repairing a ring of many crossings takes minutes
    origin = ring[0]  # relative to it, coordinates far from the origin keep their precision
    polygon = shapely.Polygon(ring - origin)
    even_odd = shapely.make_valid(polygon)
    # twice: a collection may hold a multipolygon
    parts = shapely.get_parts(shapely.get_parts(even_odd))
    pieces = [piece for part in parts if _has_inside(part) and _has_inside(piece := moved(part, origin))]
    # rounding leaves lines of no length, and specks, where a vertex touches an edge
    spikes = sum(part.length for part in parts if not _has_inside(part) and part.length > SPECK)
    if spikes > SAME_POINT or even_odd.area <= SMALLEST_AREA:
        raise ValueError(NO_AREA)
    wound = shapely.make_valid(polygon, method="structure", keep_collapsed=False)
    same = all(abs(even_odd.area - area) <= AREA_TOLERANCE * even_odd.area for area in (signed_area(ring), wound.area))
    if not same or not all(piece.is_valid for piece in pieces):  # rounding makes thin ones cross themselves
        raise ValueError(CROSSES)
    return pieces


def _refuse_plain_faults(ring: np.ndarray) -> None:
    """Raise a ValueError where two edges of a ring (N, 2) cross or overlap by more than rounding explains."""
    ends = np.stack([ring, _following(ring)], axis=1)  # (N, 2, 2)
    edges, along = shapely.linestrings(ends), ends[:, 1] - ends[:, 0]
    tree = shapely.STRtree(edges)
    depth = max(PLAIN_DEPTH, PLAIN_ROUNDING * float(np.abs(ring).max()))
    for chunk in np.array_split(np.arange(len(ring)), math.ceil(len(ring) / CHUNK)):
        one, other = tree.query(edges[chunk], predicate="intersects")
        one = chunk[one]
        one, other = one[one != other], other[one != other]
        overlap = shapely.length(shapely.intersection(edges[one], edges[other])) > depth
        if (overlap & (np.sum(along[one] * along[other], axis=1) < 0)).any():
            raise ValueError(NO_AREA)
        crossing = shapely.crosses(edges[one], edges[other])
        for a, b in ((one, other), (other, one)):
            crossing &= _distances_from_line(ends[a], ends[b]).min(axis=1) > depth
        if (overlap | crossing).any():
            raise ValueError(CROSSES)


def _distances_from_line(points: np.ndarray, line: np.ndarray) -> np.ndarray:
    """Of points (P, 2, 2) from lines, each through two points (P, 2, 2): (P, 2) [m]."""
    along = line[:, 1] - line[:, 0]
    from_line = points - line[:, :1]
    across = along[:, :1] * from_line[..., 1] - along[:, 1:] * from_line[..., 0]
    return np.abs(across) / np.linalg.norm(along, axis=1, keepdims=True)


def _has_inside(part: shapely.Geometry) -> bool:
    return isinstance(part, shapely.Polygon) and len(clean_ring(np.asarray(part.exterior.coords)[:-1])) > 2


def moved(shape: shapely.Geometry, offset: np.ndarray) -> shapely.Geometry:
    """A shape moved by an offset (2,) [m]."""
    return shapely.transform(shape, lambda points: points + offset)


def merged(polygons: Sequence[shapely.Polygon]) -> list[shapely.Polygon]:
    """The region that polygons cover, as polygons that do not overlap: those that touch others become one with them.

    How an obstacle is cut into pieces makes no difference then. Vertices move by SAME_POINT at most.
    """
    if len(polygons) < 2:
        return list(polygons)
    array = np.array(polygons, dtype=object)
    one, other = shapely.STRtree(array).query(array, predicate="dwithin", distance=SAME_POINT)
    touching = np.unique(one[one != other])
    if not len(touching):
        return list(polygons)
    union = shapely.get_parts(shapely.union_all(array[touching]))
    # rounding leaves slits between neighbours, which snapping closes
    union = shapely.simplify(shapely.union_all(union, grid_size=SAME_POINT), SAME_POINT)
    alone = np.delete(np.arange(len(polygons)), touching)
    return [*array[alone], *shapely.get_parts(union)]


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
    triangles = [np.asarray(t.exterior.coords)[:-1] for t in shapely.constrained_delaunay_triangles(polygon).geoms]
    vertices, ids = np.unique(np.concatenate(triangles), axis=0, return_inverse=True)
    parts = []
    for corner_ids, triangle in zip(ids.reshape(-1, 3).tolist(), triangles, strict=True):
        parts.append(corner_ids if signed_area(triangle) > 0 else corner_ids[::-1])
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
        union = _union_across_edge(parts[i], parts[j], (u, v))
        if _is_convex([points[k] for k in union]):
            owner.update({edge: i for edge in _edges(parts[j])})
            parts[i], parts[j] = union, []
    return [part for part in parts if part]


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


def _following(values: np.ndarray) -> np.ndarray:
    """What comes next to every row around the ring; `np.roll` takes five times as long for so few."""
    return np.concatenate([values[1:], values[:1]])
