r"""The holonomic-with-obstacles heuristic (Dolgov et al. 2008): the way to the goal if the car were a disc.

The largest disc around the rear axle's middle that is inside the car has the radius r = min(width / 2, rear hang). A
grid cell is blocked if the disc hits an obstacle wherever in the cell it is. Among the free cells the shortest
8-connected distance to the goal, V, is the fixed point of

    V(cell) = min over the neighbours n of V(n) + distance(cell, n),  V(goal) = 0,

found by sweeping the whole grid with numpy until nothing changes: no heap, no order that could depend on anything.
An infinite V at the start proves that there is no path.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from drake_gnnocp.budget import Budget
from drake_gnnocp.search.distance_field import DistanceField
from drake_gnnocp.search.relaxation import relax
from drake_gnnocp.vehicle import Vehicle

POOL = 2  # cells of the distance field along each side of a cell here


@dataclass(frozen=True, eq=False)
class HolonomicHeuristic:
    """Distances of the rear axle's middle to the goal among obstacles, at the cells of a grid."""

    xmin: float  # m, left side of the grid
    ymin: float  # m, lower side of the grid
    cell: float  # m, side of a cell
    values: np.ndarray  # (nx, ny) distance to the goal among free cells, infinite where there is no way [m]

    @classmethod
    def of(cls, field: DistanceField, vehicle: Vehicle, goal: np.ndarray, budget: Budget) -> HolonomicHeuristic:
        """Compute the distances to a goal over the area of a distance field.

        Args:
            field: distances to the obstacles.
            vehicle: the car.
            goal: (3,) x, y, theta [m, m, rad].
            budget: where it ends early, values are too large.
        """
        widest = pooled(field.values)
        radius = min(0.5 * vehicle.width, vehicle.rear_hang)
        blocked = widest + field.half_diagonal < radius
        cell = POOL * field.cell
        i = min(max(int((goal[0] - field.xmin) / cell), 0), blocked.shape[0] - 1)
        j = min(max(int((goal[1] - field.ymin) / cell), 0), blocked.shape[1] - 1)
        return cls(field.xmin, field.ymin, cell, _distances(blocked, (i, j), budget) * cell)

    @property
    def reaches_the_rim(self) -> bool:
        """Whether there is a way between the goal and some cell at the rim of the grid."""
        v = self.values
        return bool(np.isfinite(np.concatenate([v[0], v[-1], v[:, 0], v[:, -1]])).any())

    def at(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Distances to the goal from the points x, y (N,) each [m]: (N,) [m]."""
        nx, ny = self.values.shape
        i = ((x - self.xmin) * (1 / self.cell)).astype(np.intp)
        j = ((y - self.ymin) * (1 / self.cell)).astype(np.intp)
        return self.values[np.minimum(np.maximum(i, 0), nx - 1), np.minimum(np.maximum(j, 0), ny - 1)]


def pooled(values: np.ndarray) -> np.ndarray:
    """Largest value of each block of POOL x POOL cells (nx, ny): (nx / POOL, ny / POOL), rounded up."""
    nx, ny = (math.ceil(n / POOL) for n in values.shape)
    padded = np.zeros((nx * POOL, ny * POOL))
    padded[: values.shape[0], : values.shape[1]] = values
    return padded.reshape(nx, POOL, ny, POOL).max(axis=(1, 3))


def _distances(blocked: np.ndarray, goal: tuple[int, int], budget: Budget) -> np.ndarray:
    """8-connected distances to the goal in cells, infinite at blocked cells."""
    nx, ny = blocked.shape
    is_free = np.zeros((nx + 2, ny + 2), dtype=bool)  # no move leaves the frame, which is blocked
    is_free[1:-1, 1:-1] = ~blocked
    values = np.full(is_free.size, math.inf)
    target = np.ravel_multi_index((goal[0] + 1, goal[1] + 1), is_free.shape)
    values[target] = 0.0
    shifts = np.array([(a, b) for a in (-1, 0, 1) for b in (-1, 0, 1) if (a, b) != (0, 0)])
    offsets, lengths = shifts @ [ny + 2, 1], np.linalg.norm(shifts, axis=1)
    relax(values, is_free.ravel(), offsets[None], lengths[None], np.array([target]), budget)
    return values.reshape(is_free.shape)[1:-1, 1:-1]
