"""Polygons: cleaning, validity, and the exact decomposition of concave ones into convex parts.

A ring is an (N, 2) array of vertices [m], not closed: the last vertex is joined to the first.
"""

from __future__ import annotations

import numpy as np
import shapely

SAME_POINT = 1e-9  # m, neighbouring vertices nearer than this are one vertex
SMALLEST_AREA = 1e-9  # m^2, polygons below have no inside to speak of
AREA_TOLERANCE = 1e-9  # relative: a ring and its repaired polygon enclose the same area
CONVEX_TOLERANCE = 1e-12  # of the squared perimeter: turns above -this count as convex


def signed_area(ring: np.ndarray) -> float:
    """Area of a ring (N, 2), positive when counter-clockwise [m^2]."""
    if len(ring) < 3:
        return 0.0
    x, y = (ring - ring[0]).T  # relative: coordinates far from the origin keep their precision
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


def clean_ring(ring: np.ndarray) -> np.ndarray:
    """Drop repeated neighbours (and a closing vertex) of a ring (N, 2) and turn it counter-clockwise."""
    ring = np.asarray(ring, dtype=float)
    ring = ring[np.linalg.norm(ring - np.roll(ring, 1, axis=0), axis=1) > SAME_POINT]
    return ring if signed_area(ring) >= 0 else ring[::-1]


def polygons_of(ring: np.ndarray) -> list[shapely.Polygon]:
    """The region a ring bounds: one polygon, or several where the ring touches itself.

    Args:
        ring: (N, 2) vertices, either orientation, neighbours may repeat [m].

    Raises:
        ValueError: the ring has fewer than three vertices, no area, or crosses itself.
    """
    ring = clean_ring(ring)
    if len(ring) < 3:
        raise ValueError(f"needs at least 3 different vertices, has {len(ring)}")
    polygon = shapely.Polygon(ring)
    if polygon.is_valid and polygon.area > SMALLEST_AREA:
        return [polygon]
    repaired = shapely.make_valid(polygon)
    pieces = [piece for piece in shapely.get_parts(repaired) if isinstance(piece, shapely.Polygon)]
    if len(pieces) < len(shapely.get_parts(repaired)):
        raise ValueError("has no area, or runs back along one of its own edges")
    if abs(repaired.area - signed_area(ring)) > AREA_TOLERANCE * repaired.area:
        raise ValueError("crosses itself")
    if repaired.area <= SMALLEST_AREA:
        raise ValueError("has no area")
    return pieces


def convex_parts(polygon: shapely.Polygon) -> list[np.ndarray]:
    """Split a polygon into convex parts that cover it exactly.

    The constrained Delaunay triangles of the polygon are merged across shared edges as long as the union stays convex
    (Hertel and Mehlhorn 1983: at most four times the least number of parts). No vertices are added.

    Returns:
        Convex rings, each (M, 2) and counter-clockwise [m].
    """
    ring = clean_ring(np.asarray(polygon.exterior.coords)[:-1])
    if not polygon.interiors and _is_convex(ring):
        return [ring]
    triangles = [np.asarray(t.exterior.coords)[:-1] for t in shapely.constrained_delaunay_triangles(polygon).geoms]
    vertices, ids = np.unique(np.concatenate(triangles), axis=0, return_inverse=True)
    parts = []
    for corner_ids, triangle in zip(ids.reshape(-1, 3).tolist(), triangles, strict=True):
        parts.append(corner_ids if signed_area(triangle) > 0 else corner_ids[::-1])
    return [vertices[part] for part in _merge_convex(parts, vertices)]


def _merge_convex(parts: list[list[int]], vertices: np.ndarray) -> list[list[int]]:
    """Merge neighbouring parts, counter-clockwise vertex ids each, until no union of two is convex."""
    for i in range(len(parts)):
        for j in range(i + 1, len(parts)):
            union = _union_across_edge(parts[i], parts[j])
            if union is not None and _is_convex(vertices[union]):
                rest = parts[:i] + parts[i + 1 : j] + parts[j + 1 :]
                return _merge_convex([*rest, union], vertices)
    return parts


def _union_across_edge(first: list[int], second: list[int]) -> list[int] | None:
    """Join two counter-clockwise rings of vertex ids that share an edge, or None where they share none."""
    edges = {(second[k - 1], second[k]): k for k in range(len(second))}
    for k in range(len(first)):
        shared = edges.get((first[k], first[k - 1]))
        if shared is not None:
            others = [second[(shared + s) % len(second)] for s in range(1, len(second) - 1)]
            return first[:k] + others + first[k:]
    return None


def _is_convex(ring: np.ndarray) -> bool:
    edges = np.roll(ring, -1, axis=0) - ring
    turns = edges[:, 0] * np.roll(edges[:, 1], -1) - edges[:, 1] * np.roll(edges[:, 0], -1)
    scale = np.sum(np.linalg.norm(edges, axis=1)) ** 2
    return bool(np.all(turns >= -CONVEX_TOLERANCE * scale))
