"""Fields of a scenario as arrays of doubles, from what users give: lists, tuples or arrays."""

from __future__ import annotations

from reprlib import repr as shown  # short, and shallow where the value is nested
from typing import Any

import numpy as np
import shapely

from drake_gnnocp.scenario_files import BOUNDS, POSE, ScenarioError
from drake_gnnocp.shapes import Area


def doubles(what: str, value: Any, meaning: str, shape: tuple[int, ...]) -> np.ndarray:
    """Doubles of a shape, in which -1 stands for any number."""
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):  # texts, or rows of different lengths
        array = np.empty(())
    if array.ndim != len(shape) or any(n not in (-1, size) for n, size in zip(shape, array.shape, strict=True)):
        raise ScenarioError(f"{what}: must be {meaning}, not {shown(value)}")
    return array


def pose(what: str, value: Any, may_be_free: bool = False) -> np.ndarray:
    """A pose (3,) x, y, theta [m, m, rad]; its heading may be None or NaN where it may be free."""
    meaning = f"3 finite numbers [{POSE}]"
    given = doubles(what, value, meaning, (3,))
    if not np.isfinite(given[: 2 if may_be_free else 3]).all() or np.isinf(given[2]):
        raise ScenarioError(f"{what}: must be {meaning}, not {given}")
    return given


def area(what: str, value: Any, meaning: str) -> np.ndarray | Area:
    """A ring (N, 2), or one with holes [m]."""
    if not isinstance(value, Area):
        return doubles(what, value, meaning, (-1, 2))
    holes = (doubles(f"{what}.holes[{k}]", hole, meaning, (-1, 2)) for k, hole in enumerate(value.holes))
    return Area(doubles(what, value.ring, meaning, (-1, 2)), tuple(holes))


def points(value: Any) -> np.ndarray:
    """Points and discs: (K, 3) x, y, radius [m]."""
    if not len(value):
        return np.empty((0, 3))
    rows = doubles("points", value, "a list of [x, y, r]", (-1, 3))
    if not (np.isfinite(rows).all() and (rows[:, 2] >= 0).all()):
        raise ScenarioError("points: must be finite, with a radius of 0 or more")
    return rows


def bounds(value: Any) -> tuple[float, float, float, float] | np.ndarray:
    """A box as a tuple, also where it is given as a ring; another ring as an array."""
    if np.ndim(value) == 1:
        xmin, xmax, ymin, ymax = doubles("bounds", value, f"4 numbers [{BOUNDS}], or a ring", (4,)).tolist()
        return xmin, xmax, ymin, ymax
    ring = doubles("bounds", value, f"4 numbers [{BOUNDS}], or a list of at least 3 vertices [x, y]", (-1, 2))
    if not len(ring) or not np.isfinite(ring).all():
        raise ScenarioError("bounds: must be finite vertices [x, y]")
    (xmin, ymin), (xmax, ymax) = ring.min(axis=0).tolist(), ring.max(axis=0).tolist()
    box = shapely.box(xmin, ymin, xmax, ymax)
    is_box = len(ring) in (4, 5) and bool(shapely.Polygon(ring).equals(box))
    return (xmin, xmax, ymin, ymax) if is_box else ring
