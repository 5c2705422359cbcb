"""Which cells of an occupancy grid a rectangle at any angle covers, exactly: no polygons, no code of the package.

A convex polygon covers, of each row of cells, those between its leftmost and its rightmost point within that row: the
intersection of the two is convex, so every cell in between shares some area with it. All lengths are in cells here,
with the lower left corner of the lower left cell as the origin; row 0 is the lowest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely

TOUCHING = 1e-9  # cells: polygons that reach so little into a cell only touch it
LEAST_AREA = 1e-9  # m^2, of a cell that counts as touched
MOST_NUMBERS = 4_000_000  # of an array, poses are looked at in parts


@dataclass(frozen=True)
class Runs:
    """What polygons cover of the rows of cells: rows (N, R), and the first and last column of each; (N, R) [cells]."""

    rows: np.ndarray
    first: np.ndarray
    last: np.ndarray
    is_there: np.ndarray  # (N, R): a polygon that spans fewer rows than others has fewer runs


def covered(corners: np.ndarray) -> Runs:
    """The cells that convex polygons share some area with: corners (N, K, 2) [cells]."""
    x, y = corners[..., 0], corners[..., 1]
    bottom = np.floor(y.min(axis=1) + TOUCHING).astype(int)
    count = np.ceil(y.max(axis=1) - TOUCHING).astype(int) - bottom
    rows = bottom[:, None] + np.arange(count.max(initial=1))
    x, y, low = x[:, None], y[:, None], rows[..., None].astype(float)
    x_next, y_next = np.roll(x, -1, axis=2), np.roll(y, -1, axis=2)
    rise = y_next - y
    begin, end = np.clip(y, low, low + 1), np.clip(y_next, low, low + 1)  # of each edge within each row
    in_row = (np.maximum(y, y_next) >= low) & (np.minimum(y, y_next) <= low + 1) & (np.abs(rise) > TOUCHING)
    slope = (x_next - x) / np.where(in_row, rise, 1.0)
    ends = np.stack([x + slope * (begin - y), x + slope * (end - y)])
    left = np.where(in_row, ends.min(axis=0), np.inf).min(axis=2)
    right = np.where(in_row, ends.max(axis=0), -np.inf).max(axis=2)
    is_there = (np.arange(rows.shape[1]) < count[:, None]) & (right - left > 2 * TOUCHING)
    left, right = np.where(is_there, left, 0.0), np.where(is_there, right, 1.0)
    first, last = np.floor(left + TOUCHING).astype(int), np.ceil(right - TOUCHING).astype(int) - 1
    return Runs(rows, first, last, is_there)


@dataclass(frozen=True, eq=False)
class RawCells:
    """The cells of a map, which do not change, and where they lie. What lies outside counts as occupied."""

    occupied: np.ndarray  # (ny, nx) of bool, row 0 is the lowest
    cell: float  # m, length of a side
    origin: np.ndarray  # (2,) x, y of the lower left corner [m]

    def __post_init__(self) -> None:
        self.occupied.setflags(write=False)  # what is counted once stays true

    @cached_property
    def _before(self) -> np.ndarray:
        """The number of occupied cells of a row before each column: (ny, nx + 1)."""
        before = np.zeros((self.occupied.shape[0], self.occupied.shape[1] + 1), dtype=np.int32)
        np.cumsum(self.occupied, axis=1, out=before[:, 1:])
        return before

    def hits(self, polygons: np.ndarray) -> np.ndarray:
        """Whether convex polygons (N, K, 2) [m] share area with an occupied cell, or leave the map: (N,)."""
        corners = (polygons - self.origin) / self.cell
        tall = math.ceil(float(np.ptp(corners[..., 1], axis=1).max(initial=1.0))) + 2
        step = max(1, MOST_NUMBERS // (tall * corners.shape[1]))
        parts = [self._hits(corners[i : i + step]) for i in range(0, len(corners), step)]
        return np.concatenate(parts) if parts else np.zeros(0, dtype=bool)

    def _hits(self, corners: np.ndarray) -> np.ndarray:
        ny, nx = self.occupied.shape
        is_over = (corners < -TOUCHING) | (corners > np.array([nx, ny]) + TOUCHING)
        is_outside = np.logical_or.reduce(is_over, axis=(1, 2))
        runs = covered(np.where(is_outside[:, None, None], 0.5, corners))
        rows = np.clip(runs.rows, 0, ny - 1)
        found = self._before[rows, np.clip(runs.last + 1, 0, nx)] - self._before[rows, np.clip(runs.first, 0, nx)]
        return is_outside | ((found > 0) & runs.is_there).any(axis=1)

    def touched(self, polygons: np.ndarray) -> int:
        """The number of occupied cells that convex polygons (N, K, 2) [m] share more than LEAST_AREA with."""
        cells: set[tuple[int, int]] = set()
        for polygon in polygons[np.flatnonzero(self.hits(polygons))]:
            cells |= self._touched(polygon)
        return len(cells)

    def _touched(self, polygon: np.ndarray) -> set[tuple[int, int]]:
        low, high = (polygon.min(axis=0) - self.origin) / self.cell, (polygon.max(axis=0) - self.origin) / self.cell
        (x0, y0), (x1, y1) = np.floor(low).astype(int), np.ceil(high).astype(int)
        window = self.occupied[max(y0, 0) : y1, max(x0, 0) : x1]
        at = np.argwhere(window)[:, ::-1] + np.maximum([x0, y0], 0)  # column, row
        corner = self.origin + self.cell * at
        boxes = shapely.box(*corner.T, *(corner + self.cell).T)
        area = shapely.area(shapely.intersection(boxes, shapely.Polygon(polygon)))
        return {(int(column), int(row)) for column, row in at[area > LEAST_AREA]}


def rectangles(poses: np.ndarray, rear: float, front: float, half: float) -> np.ndarray:
    """Corners of a rectangle at poses (N, 3) x, y, theta: (N, 4, 2), counter-clockwise from rear right [m]."""
    x, y, c, s = poses[:, 0], poses[:, 1], np.cos(poses[:, 2]), np.sin(poses[:, 2])
    ends = [(rear, -half), (front, -half), (front, half), (rear, half)]
    return np.stack([np.column_stack([x + c * u - s * v, y + s * u + c * v]) for u, v in ends], axis=1)


def driven(
    start: np.ndarray, t: np.ndarray, a: np.ndarray, w: np.ndarray, wheelbase: float, reach: float, step: float
) -> np.ndarray:
    """Poses of the bicycle that is driven from a start at rest by inputs, linear between knots, by Runge-Kutta.

    Args:
        start: (3,) x, y, theta [m, m, rad].
        t: (N,) of the knots [s].
        a: (N,) accelerations [m/s^2].
        w: (N,) steering rates [rad/s].
        wheelbase: of the bicycle [m].
        reach: from the rear axle's middle to the farthest corner [m].
        step: no corner moves farther from pose to pose, but for rounding [m].

    Returns:
        (M, 3) x, y, theta [m, m, rad].
    """
    state, poses = np.append(np.asarray(start, dtype=float), [0.0, 0.0]), [np.asarray(start, dtype=float)]
    for k in range(len(t) - 1):
        span = float(t[k + 1] - t[k])
        v, phi = state[3:]
        fastest = abs(v) + span * max(abs(a[k]), abs(a[k + 1]))
        steepest = min(abs(phi) + span * max(abs(w[k]), abs(w[k + 1])), 1.5)
        n = max(1, math.ceil(span * fastest * (1 + reach * math.tan(steepest) / wheelbase) / step))
        h = span / n
        for i in range(n):
            state = _step(state, h, a[k : k + 2], w[k : k + 2], i / n, 1 / n, wheelbase)
            poses.append(state[:3])
    return np.array(poses)


def _step(
    state: np.ndarray, h: float, a: np.ndarray, w: np.ndarray, begin: float, share: float, wheelbase: float
) -> np.ndarray:
    """One step h [s] of Runge-Kutta, from a share `begin` of the interval over which a and w (2,) are linear."""

    def rate(at: np.ndarray, place: float) -> np.ndarray:
        _, _, theta, v, phi = at.tolist()
        turn = v * math.tan(phi) / wheelbase
        accelerates, steers = a[0] + place * (a[1] - a[0]), w[0] + place * (w[1] - w[0])
        return np.array([v * math.cos(theta), v * math.sin(theta), turn, accelerates, steers])

    k1 = rate(state, begin)
    k2 = rate(state + h / 2 * k1, begin + share / 2)
    k3 = rate(state + h / 2 * k2, begin + share / 2)
    k4 = rate(state + h * k3, begin + share)
    return state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
