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

from drake_gnnocp.polygons import polygons_from

CELLS_PER_EDGE = 10  # a cell is looked up in a tenth of the time in which an edge is drawn into the field


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
        if sum(map(len, rings)) * CELLS_PER_EDGE > field.values.size:
            return field._of_many(rings)
        for ring in rings:
            field._stamp(ring)
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

    def _stamp(self, ring: np.ndarray) -> None:
        """Lower the squared distances around one convex ring."""
        for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True):
            window, px, py = self._window(np.minimum(a, b), np.maximum(a, b), self.cut_off)
            ex, ey = b - a
            u = np.clip(((px - a[0]) * ex + (py - a[1]) * ey) / (ex * ex + ey * ey), 0.0, 1.0)
            squared = (px - (a[0] + u * ex)) ** 2 + (py - (a[1] + u * ey)) ** 2
            np.minimum(self.values[window], squared, out=self.values[window])
        window, px, py = self._window(ring.min(axis=0), ring.max(axis=0), 0.0)
        inside = np.ones(np.broadcast_shapes(px.shape, py.shape), dtype=bool)
        for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True):
            inside &= (b[0] - a[0]) * (py - a[1]) >= (b[1] - a[1]) * (px - a[0])
        self.values[window][inside] = 0.0

    def _window(
        self, low: np.ndarray, high: np.ndarray, distance: float
    ) -> tuple[tuple[slice, slice], np.ndarray, np.ndarray]:
        """The cells within a distance of a box: slices, centres x (n, 1) and y (1, m) [m]."""
        slices = []
        for axis, origin in enumerate((self.xmin, self.ymin)):
            last = self.values.shape[axis]
            first = min(max(math.floor((low[axis] - distance - origin) / self.cell), 0), last)
            past = min(max(math.ceil((high[axis] + distance - origin) / self.cell), 0), last)
            slices.append(slice(first, past))
        x = self.xmin + (np.arange(slices[0].start, slices[0].stop) + 0.5) * self.cell
        y = self.ymin + (np.arange(slices[1].start, slices[1].stop) + 0.5) * self.cell
        return (slices[0], slices[1]), x[:, None], y[None, :]
