"""Polygons: cleaning, validity, and what many of them cover together.

A ring is an (N, 2) array of vertices [m], not closed: the last vertex is joined to the first.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
import shapely

SAME_POINT = 1e-9  # m, neighbouring vertices nearer than this are one vertex
SMALLEST_AREA = 1e-9  # m^2, polygons below have no inside to speak of
PLAIN_DEPTH, PLAIN_ROUNDING = 1e-6, 1e-15  # m, and of the coordinates: deeper crossings are no matter of rounding
CHUNK = 4  # edges that are looked at together: each may cross all the others
NO_AREA, CROSSES = "has no area, or runs back along one of its own edges", "crosses itself"
TOO_FEW = "has fewer than 3 different vertices"
POINTS_IN_COMMON = "FF*F0****"  # of two polygons: single points of their outlines, and nothing else
SPECK = 1e-8  # m, the longest outline of a piece that rounding may leave and that nobody misses
AREA_TOLERANCE = 1e-9  # relative: a ring and its repaired polygon enclose the same area


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


def polygons_from(rings: Sequence[np.ndarray]) -> np.ndarray:
    """Rings (N, 2) of at least three vertices as polygons, at once."""
    if not len(rings):
        return np.empty(0, dtype=object)
    owners = np.repeat(np.arange(len(rings)), [len(ring) for ring in rings])
    return np.asarray(shapely.polygons(shapely.linearrings(np.concatenate(rings), indices=owners)))


def padded_rings(rings: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """J rings (N, 2) as arrays: vertices, the last of each repeated to M, (J, M, 2); which are not repeated, (J, M)."""
    counts = np.array([len(ring) for ring in rings], dtype=int)
    place = np.arange(counts.max(initial=1))
    if not len(rings):
        return np.empty((0, 1, 2)), np.empty((0, 1), dtype=bool)
    vertex = (np.cumsum(counts) - counts)[:, None] + np.minimum(place, counts[:, None] - 1)
    return np.concatenate(rings)[vertex], place < counts[:, None]


def edges_of(rings: Sequence[np.ndarray]) -> np.ndarray:
    """The edges of one or more rings (N, 2) ring by ring: (E, 2, 2) from and to [m]."""
    corners = np.concatenate(rings)
    return np.stack([corners, corners[following(np.array([len(ring) for ring in rings]))]], axis=1)


def following(counts: np.ndarray) -> np.ndarray:
    """Where the next corner is of every corner, of rings of so many corners one after another: (N,)."""
    last, has_any = np.cumsum(counts) - 1, counts > 0
    after = np.arange(1, last[-1] + 2)
    after[last[has_any]] = (last - counts + 1)[has_any]
    return after


def simple_polygons(rings: Sequence[np.ndarray]) -> Iterator[shapely.Polygon | None]:
    """What `polygons_of` gives for each of many rings (N, 2) where that is one plain polygon, at once; else None."""
    if not rings:
        return iter(())
    counts = np.array([len(ring) for ring in rings])
    corners = np.concatenate(rings)
    owners = np.repeat(np.arange(len(rings)), counts)
    first = np.cumsum(counts) - counts
    after = following(counts)
    steps = np.linalg.norm(corners[after] - corners, axis=1)
    is_odd = (counts < 3) | ~np.isfinite(np.bincount(owners, np.abs(corners).sum(axis=1), len(rings)))
    is_odd[owners[~(steps > SAME_POINT)]] = True
    relative = corners - corners[np.minimum(first, len(corners) - 1)][owners]
    doubled = relative[:, 0] * relative[after, 1] - relative[:, 1] * relative[after, 0]
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
    """The region that polygons cover, as polygons that do not overlap: those that share an edge, or more, become one.

    How an obstacle is cut into pieces makes no difference then. Vertices move by SAME_POINT at most.
    """
    if len(polygons) < 2:
        return list(polygons)
    array = _joined_to_rows(np.array(polygons, dtype=object))
    one, other = shapely.STRtree(array).query(array, predicate="dwithin", distance=SAME_POINT)
    one, other = one[one < other], other[one < other]
    share_more = ~shapely.relate_pattern(array[one], array[other], POINTS_IN_COMMON)
    touching = np.unique([one[share_more], other[share_more]])
    if not len(touching):
        return list(array)
    union = shapely.get_parts(shapely.union_all(array[touching]))
    # rounding leaves slits between neighbours, which snapping closes
    union = shapely.simplify(shapely.union_all(union, grid_size=SAME_POINT), SAME_POINT)
    return [*np.delete(array, touching), *shapely.get_parts(union)]


def _joined_to_rows(polygons: np.ndarray) -> np.ndarray:
    """Polygons, those that are cells of a grid joined to rows of cells: the union of thousands takes long."""
    has_five = np.flatnonzero(shapely.get_num_coordinates(polygons) == 5)
    boxes = shapely.bounds(polygons[has_five])  # (K, 4) xmin, ymin, xmax, ymax
    corners = shapely.get_coordinates(polygons[has_five]).reshape(-1, 5, 2)
    is_cell = ((corners == boxes[:, None, :2]) | (corners == boxes[:, None, 2:])).all(axis=(1, 2))
    cells, boxes = has_five[is_cell], boxes[is_cell]
    if len(cells) < 2:
        return polygons
    order = np.lexsort([boxes[:, 0], boxes[:, 3], boxes[:, 1]])
    cells, boxes = cells[order], boxes[order]
    is_beside = np.abs(np.diff(boxes[:, 1::2], axis=0)).max(axis=1) <= SAME_POINT
    is_beside &= (boxes[:-1, 0] <= boxes[1:, 0]) & (boxes[1:, 0] <= boxes[:-1, 2] + SAME_POINT)
    first = np.flatnonzero(np.append(True, ~is_beside))  # of each row
    lengths = np.diff(first, append=len(cells))
    low, high = np.minimum.reduceat(boxes[:, :2], first), np.maximum.reduceat(boxes[:, 2:], first)
    rows = shapely.box(*low[lengths > 1].T, *high[lengths > 1].T)
    return np.append(np.delete(polygons, cells[np.repeat(lengths > 1, lengths)]), rows)


def _following(values: np.ndarray) -> np.ndarray:
    """What comes next to every row around the ring; `np.roll` takes five times as long for so few."""
    return np.concatenate([values[1:], values[:1]])
