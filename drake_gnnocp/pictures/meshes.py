"""Triangle meshes for the replay: prisms over exact polygons and frusta.

A mesh is (vertices (3, N) [m], faces (3, M) of vertex indices, counter-clockwise seen from outside).
"""

from __future__ import annotations

import numpy as np
import shapely

from drake_gnnocp.polygons import signed_area

Mesh = tuple[np.ndarray, np.ndarray]


def prism(polygon: shapely.Polygon, low: float, high: float) -> Mesh:
    """Extrude a polygon, concave or with holes, from z = low to z = high [m]."""
    lids = [_counter_clockwise(t) for t in shapely.constrained_delaunay_triangles(polygon).geoms]
    triangles = [_at(t, high) for t in lids] + [_at(t[::-1], low) for t in lids]
    outside = shapely.orient_polygons(polygon)  # the inside on the left of every edge, round holes too
    for ring in (np.asarray(r.coords) for r in (outside.exterior, *outside.interiors)):
        for p, q in zip(ring[:-1], ring[1:], strict=True):
            (p0, q0), (p1, q1) = _at(np.array([p, q]), low), _at(np.array([p, q]), high)
            triangles += [np.array([p0, q0, q1]), np.array([p0, q1, p1])]
    vertices = np.concatenate(triangles).T  # every triangle has its own: shared ones would be shaded as if round
    return vertices, np.arange(vertices.shape[1]).reshape(-1, 3).T


def frustum(bottom: tuple[float, float, float], top: tuple[float, float, float], low: float, high: float) -> Mesh:
    """A truncated pyramid symmetric to y = 0, from z = low to high; bottom and top: (rear, front, half width) [m]."""
    (along, across, up), faces = prism(shapely.box(0.0, -1.0, 1.0, 1.0), 0.0, 1.0)
    rear, front, half = (low_end + up * (high_end - low_end) for low_end, high_end in zip(bottom, top, strict=True))
    return np.stack([rear + along * (front - rear), across * half, low + up * (high - low)]), faces


def upright(mesh: Mesh, half_width: float) -> Mesh:
    """Turn a prism over a side view (x, z), extruded from 0 to 1, into a body from y = -half_width to half_width."""
    (x, z, share), faces = mesh
    return np.stack([x, half_width * (1 - 2 * share), z]), faces


def _counter_clockwise(triangle: shapely.Polygon) -> np.ndarray:
    ring = np.asarray(triangle.exterior.coords)[:3]
    return ring if signed_area(ring) > 0 else ring[::-1]


def _at(points: np.ndarray, z: float) -> np.ndarray:
    return np.column_stack([points, np.full(len(points), z)])
