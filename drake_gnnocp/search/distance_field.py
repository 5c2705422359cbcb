r"""Distance to the nearest obstacle on a grid, exact at the cell centres and cut off beyond a few metres.

The distance d is 1-Lipschitz: within a cell of half diagonal e whose centre has the distance D,

    D - e <= d <= D + e,

so one look-up bounds the distance of any point from both sides. Only cells within the cut-off of an edge are ever
touched, which makes the field cost milliseconds.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import shapely

from drake_gnnocp.polygons import edges_of, polygons_from

LOOK_UP = 200  # squared distances to edges are computed in the time in which the nearest ring of a point is looked up
MOST_NUMBERS = 100_000  # in an array: more are computed in parts


@dataclass(frozen=True, eq=False)
class DistanceField:
    """Distances at the cell centres of a grid over a rectangle."""

    xmin: float  # m, left side of the grid
    ymin: float  # m, lower side of the grid
    cell: float  # m, side of a cell
    cut_off: float  # m, larger distances are stored as this
    values: np.ndarray  # (nx, ny) min(distance to the nearest obstacle, cut_off), 0 inside [m]

    @classmethod
    def of(
        cls, convex_rings: Iterable[np.ndarray], region: tuple[float, float, float, float], cell: float, cut_off: float
    ) -> DistanceField:
        """Build the field.

        Args:
            convex_rings: (M_j, 2) counter-clockwise each [m].
            region: xmin, xmax, ymin, ymax of the rectangle to cover [m].
            cell: side of a cell [m].
            cut_off: largest distance of interest [m].
        """
        xmin, xmax, ymin, ymax = region
        shape = (max(1, math.ceil((xmax - xmin) / cell)), max(1, math.ceil((ymax - ymin) / cell)))
        field = cls(xmin, ymin, cell, cut_off, np.full(shape, cut_off**2))
        rings = list(convex_rings)
        if not rings:
            return replace(field, values=np.full(shape, cut_off))
        ends = _outer(edges_of(rings))
        windows = field._windows(ends.min(axis=1), ends.max(axis=1), cut_off)
        if windows[1].prod(axis=1).sum() > LOOK_UP * field.values.size:
            return field._of_many(rings)
        field._draw_edges(ends, *windows)
        field._fill(rings)
        np.sqrt(field.values, out=field.values)
        return field

    def _of_many(self, rings: list[np.ndarray]) -> DistanceField:
        """The same field, which takes as long as there are cells, and not as there are edges."""
        nx, ny = self.values.shape
        x, y = self.xmin + (np.arange(nx) + 0.5) * self.cell, self.ymin + (np.arange(ny) + 0.5) * self.cell
        centres = shapely.points(*np.meshgrid(x, y, indexing="ij")).ravel()
        values = np.full(nx * ny, self.cut_off)
        found, distances = shapely.STRtree(polygons_from(rings)).query_nearest(
            centres, max_distance=self.cut_off, return_distance=True, all_matches=False
        )
        values[found[0]] = distances
        return replace(self, values=values.reshape(nx, ny))

    @property
    def half_diagonal(self) -> float:
        """Largest distance of a point of a cell from its centre [m]."""
        return self.cell * math.sqrt(0.5)

    def at(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Values of the cells that hold the points x, y (any shape, [m]); points outside get the nearest cell's."""
        return self.values.ravel()[self.index(x, y)]

    def index(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Flat index of the cell that holds each point x, y [m]."""
        nx, ny = self.values.shape
        # truncation instead of floor: points left of the grid are clipped to its first cell anyway
        i = ((x - self.xmin) * (1 / self.cell)).astype(np.intp)
        j = ((y - self.ymin) * (1 / self.cell)).astype(np.intp)
        return np.minimum(np.maximum(i, 0), nx - 1) * ny + np.minimum(np.maximum(j, 0), ny - 1)

    def _draw_edges(self, ends: np.ndarray, first: np.ndarray, counts: np.ndarray) -> None:
        """Lower the squared distances around edges, whose ends are (E, 2, 2), within windows of cells."""
        for edges in _groups(counts, counts.prod(axis=1)):
            i, j, px, py = self._cells(first[edges], counts[edges[0]])
            a, (ex, ey) = ends[edges, 0], (ends[edges, 1] - ends[edges, 0]).T[:, :, None, None]
            ax, ay = a.T[:, :, None, None]
            u = np.clip(((px - ax) * ex + (py - ay) * ey) / (ex * ex + ey * ey), 0.0, 1.0)
            squared = (px - (ax + u * ex)) ** 2 + (py - (ay + u * ey)) ** 2
            if len(edges) == 1:  # much faster
                window = self.values[i[0, 0, 0] : i[0, -1, 0] + 1, j[0, 0, 0] : j[0, 0, -1] + 1]
                np.minimum(window, squared[0], out=window)
            else:
                cells = i * self.values.shape[1] + j
                np.minimum.at(self.values.reshape(-1), cells.ravel(), squared.ravel())  # flat, eight times as fast

    def _fill(self, rings: list[np.ndarray]) -> None:
        """Set the cells whose centres are inside convex rings to 0."""
        first, counts = self._windows(
            np.array([ring.min(axis=0) for ring in rings]), np.array([ring.max(axis=0) for ring in rings]), 0.0
        )
        corners = np.array([len(ring) for ring in rings])
        for group in _groups(np.column_stack([counts, corners]), counts.prod(axis=1)):
            i, j, px, py = self._cells(first[group], counts[group[0]])
            vertices = np.array([rings[ring] for ring in group])
            inside = np.ones(np.broadcast_shapes(px.shape, py.shape), dtype=bool)
            for a, b in zip(vertices.swapaxes(0, 1), np.roll(vertices, -1, axis=1).swapaxes(0, 1), strict=True):
                (ax, ay), (bx, by) = a.T[:, :, None, None], b.T[:, :, None, None]
                inside &= (bx - ax) * (py - ay) >= (by - ay) * (px - ax)
            i, j = np.broadcast_arrays(i, j)
            self.values[i[inside], j[inside]] = 0.0

    def _windows(self, low: np.ndarray, high: np.ndarray, distance: float) -> tuple[np.ndarray, np.ndarray]:
        """The cells within a distance of boxes, (N, 2) [m]: the first and the count along each axis, (N, 2) each."""
        origin, size = np.array([self.xmin, self.ymin]), np.array(self.values.shape)
        first = np.clip(np.floor((low - distance - origin) / self.cell), 0, size).astype(np.intp)
        past = np.clip(np.ceil((high + distance - origin) / self.cell), 0, size).astype(np.intp)
        return first, np.maximum(past - first, 0)

    def _cells(self, first: np.ndarray, count: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Cells of W windows of one size (2,): indices (W, n, 1) and (W, 1, m), centres x and y in these shapes [m]."""
        i = first[:, 0, None, None] + np.arange(count[0])[:, None]
        j = first[:, 1, None, None] + np.arange(count[1])
        return i, j, self.xmin + (i + 0.5) * self.cell, self.ymin + (j + 0.5) * self.cell


def _outer(edges: np.ndarray) -> np.ndarray:
    """The edges (E, 2, 2) that only one ring has: those between two parts of a polygon are inside of it."""
    a, b = edges[:, 0], edges[:, 1]
    is_turned = (a[:, 0] > b[:, 0]) | ((a[:, 0] == b[:, 0]) & (a[:, 1] > b[:, 1]))
    ends = np.where(is_turned[:, None, None], edges[:, ::-1], edges).reshape(-1, 4)
    order = np.lexsort(ends.T)
    is_double = (np.diff(ends[order], axis=0) == 0).all(axis=1)
    is_inner = np.zeros(len(edges), dtype=bool)
    is_inner[order[1:][is_double]] = is_inner[order[:-1][is_double]] = True
    return edges[~is_inner]


def _groups(keys: np.ndarray, sizes: np.ndarray) -> list[np.ndarray]:
    """Indices of equal rows of keys (N, K) together, no more in a group than MOST_NUMBERS of their sizes (N,)."""
    order = np.lexsort(keys.T)
    order = order[sizes[order] > 0]
    if not len(order):
        return []
    starts = np.flatnonzero((np.diff(keys[order], axis=0) != 0).any(axis=1)) + 1
    groups = []
    for group in np.split(order, starts):
        most = max(1, MOST_NUMBERS // int(sizes[group[0]]))
        groups += [group[first : first + most] for first in range(0, len(group), most)]
    return groups
