"""Occupancy grids: which square cells of a rectangle are occupied, and where in the world the rectangle lies.

Cell (i, j), i counted upwards and j to the right, is the square [j, j + 1] x [i, i + 1] in units of the resolution r.
The point p of the grid is the point o + r R(yaw) p of the world: the origin o is the lower left corner of the lower
left cell, and R turns counter-clockwise. What lies outside of the grid is unknown: a car has to stay inside.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass
from reprlib import repr as shown  # short, and shallow where the value is nested
from typing import Any

import numpy as np

UNKNOWN = -1  # of a cell, the others are 0 to 100 per cent: as in ROS's OccupancyGrid
FREE, OCCUPIED = 0, 100
MEANINGS = ("occupied", "free")  # that unknown cells can have
FINEST, COARSEST = 1e-3, 1e3  # m, that a cell can measure
FARTHEST = 1e12  # m: beyond it a double does not resolve the millimetre
MOST_CELLS = 64_000_000
THRESHOLD = 0.65  # of map_server's and map_saver's: cells of 65 per cent are occupied

logger = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Grid:
    """A rectangle of square cells, some of which are occupied.

    Raises:
        ValueError: there are no cells or too many, or resolution or origin are no such; the message names the field.
    """

    occupied: np.ndarray  # (ny, nx) of bool, row 0 is the lowest
    resolution: float  # m, length of a cell's side
    origin: np.ndarray  # (3,) x, y, yaw of the lower left corner of the lower left cell [m, m, rad]

    def __post_init__(self) -> None:
        object.__setattr__(self, "occupied", _cells(self.occupied).astype(bool, copy=False))
        object.__setattr__(self, "resolution", _resolution(self.resolution))
        object.__setattr__(self, "origin", _origin(self.origin))

    def in_world(self, points: np.ndarray) -> np.ndarray:
        """Points (N, 2) of the world [m] from such in cells, x first. Equal ones stay equal."""
        x, y, yaw = self.origin
        across, up = self.resolution * np.asarray(points, dtype=float).T
        if yaw == 0:
            return np.column_stack([x + across, y + up])
        c, s = math.cos(yaw), math.sin(yaw)
        return np.column_stack([x + c * across - s * up, y + s * across + c * up])

    @property
    def bounds(self) -> tuple[float, float, float, float] | np.ndarray:
        """The rectangle of all cells: xmin, xmax, ymin, ymax [m], or where it is turned its ring (4, 2) [m]."""
        ny, nx = self.occupied.shape
        ring = self.in_world(np.array([[0, 0], [nx, 0], [nx, ny], [0, ny]]))
        if self.origin[2] != 0:
            return ring
        (xmin, ymin), (xmax, ymax) = ring[0].tolist(), ring[2].tolist()
        return xmin, xmax, ymin, ymax


def grid_of_cells(
    cells: np.ndarray,
    resolution: float,
    origin: Sequence[float] | np.ndarray,
    *,
    unknown: str = MEANINGS[0],
    occupied_thresh: float = THRESHOLD,
) -> Grid:
    """A grid from the cells of a ROS OccupancyGrid, or from whether they are occupied.

    Args:
        cells: (ny, nx), row 0 is the lowest: -1 (unknown) or 0 to 100 per cent, or bools. Costmaps of 0 to 255 are not
            such.
        resolution: length of a cell's side [m].
        origin: x, y, yaw of the lower left corner of the lower left cell [m, m, rad]; the yaw may be left out.
        unknown: what unknown cells are taken for: "occupied" or "free".
        occupied_thresh: cells of at least this share of 100 per cent are occupied, in (0, 1].

    Raises:
        ValueError: a value is illegal; the message names it.
    """
    if unknown not in MEANINGS:
        raise ValueError(f"unknown: must be {' or '.join(MEANINGS)}, not {shown(unknown)}")
    if not 0 < occupied_thresh <= 1:
        raise ValueError(f"occupied_thresh: must be above 0 and at most 1, not {shown(occupied_thresh)}")
    cells = _cells(cells)
    if cells.dtype != bool:
        low, high = cells.min(), cells.max()
        if not (UNKNOWN <= low and high <= OCCUPIED) or cells.dtype.kind not in "iu":
            found = f"{cells.dtype} of {low:g} to {high:g}"
            raise ValueError(f"cells: must be whole numbers, -1 (unknown) or 0 to 100 per cent, not {found}")
        occupied = cells >= math.ceil(OCCUPIED * occupied_thresh - 1e-9)  # 100 * 0.55 is above 55
        cells = occupied | (cells == UNKNOWN) if unknown == "occupied" else occupied
    return Grid(cells, resolution, origin if len(origin) != 2 else (*origin, 0.0))  # type: ignore[arg-type]


def _cells(value: Any) -> np.ndarray:
    cells = np.asarray(value)
    if cells.ndim != 2 or not cells.size or cells.dtype.kind not in "biuf":
        raise ValueError(f"cells: must be rows and columns of numbers or bools, not {cells.dtype} in {cells.shape}")
    if cells.size > MOST_CELLS:
        ny, nx = cells.shape
        raise ValueError(f"cells: must be at most {MOST_CELLS / 1e6:g} million, not {nx} x {ny}")
    return cells


def _resolution(value: Any) -> float:
    try:
        resolution = float(value)
    except (TypeError, ValueError):
        resolution = math.nan
    if not FINEST <= resolution <= COARSEST:
        raise ValueError(f"resolution: must be {FINEST:g} to {COARSEST:g} m, not {shown(value)}")
    return resolution


def _origin(value: Any) -> np.ndarray:
    try:
        origin = np.array(value, dtype=float)
    except (TypeError, ValueError):
        origin = np.empty(0)
    if origin.shape != (3,) or not (np.abs(origin) <= FARTHEST).all():  # NaN as well
        raise ValueError(f"origin: must be 3 finite numbers [x, y, yaw] of at most {FARTHEST:g}, not {shown(value)}")
    if abs(origin[2]) > 2 * math.pi:
        logger.warning("origin: the yaw is in radians, and %g is more than a turn: are these degrees?", origin[2])
    return origin
