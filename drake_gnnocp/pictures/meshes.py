"""Triangle meshes for the replay: prisms over exact polygons and frusta.

A mesh is (vertices (3, N) [m], faces (3, M) of vertex indices, counter-clockwise seen from outside).
"""

from __future__ import annotations

import numpy as np
import shapely

Mesh = tuple[np.ndarray, np.ndarray]


def prism(polygons: shapely.Polygon | np.ndarray, low: float, high: float) -> Mesh:
    """Extrude polygons, one or many (P,), concave or with holes, from z = low to z = high [m]: one mesh of all."""
    polygons = np.atleast_1d(polygons)
    lids = shapely.get_coordinates(shapely.constrained_delaunay_triangles(polygons)).reshape(-1, 4, 2)[:, :3]
    (x, y), (u, v) = (lids[:, 1] - lids[:, 0]).T, (lids[:, 2] - lids[:, 0]).T
    is_clockwise = x * v - y * u < 0
    lids[is_clockwise] = lids[is_clockwise, ::-1]
    outside = shapely.get_rings(shapely.orient_polygons(polygons))  # the inside on the left of every edge, at holes too
    points, ring = shapely.get_coordinates(outside, return_index=True)
    follows = ring[1:] == ring[:-1]
    p, q = points[:-1][follows], points[1:][follows]
    walls = [
        np.stack([_at(p, low), _at(q, low), _at(q, high)], axis=1),
        np.stack([_at(p, low), _at(q, high), _at(p, high)], axis=1),
    ]
    triangles = np.concatenate([_at(lids, high), _at(lids[:, ::-1], low), *walls])
    vertices = triangles.reshape(-1, 3).T  # every triangle has its own: shared ones would be shaded as if round
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


def _at(points: np.ndarray, z: float) -> np.ndarray:
    """Points (..., 2) at a height: (..., 3) [m]."""
    return np.concatenate([points, np.full((*points.shape[:-1], 1), z)], axis=-1)
