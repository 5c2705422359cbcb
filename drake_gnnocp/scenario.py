"""A planning task: start, goal, polygons, optional bounds and vehicle; read from JSON and TPCAP CSV files."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from drake_gnnocp.geometry import convex_parts, polygons_of
from drake_gnnocp.trajectory import write_atomically
from drake_gnnocp.vehicle import Vehicle

KEYS = ("name", "start", "goal", "obstacles", "bounds", "vehicle")
REQUIRED_KEYS = KEYS[:4]
TPCAP_VEHICLE = Vehicle(width=1.942, v_max=2.5, a_max=1.0, phi_max=0.75, w_max=0.5)


class ScenarioError(ValueError):
    """A scenario that cannot be planned: the message is one line that names the file, the field and the reason."""


@dataclass(frozen=True, eq=False)
class Scenario:
    """One planning task. Coordinates in m, headings in rad; poses are those of the middle of the rear axle.

    Raises:
        ScenarioError: a polygon is not simple, or the car at start or goal collides or leaves the bounds.
    """

    name: str
    start: np.ndarray  # (3,) x, y, theta
    goal: np.ndarray  # (3,) x, y, theta
    obstacles: tuple[np.ndarray, ...] = ()  # rings (N_j, 2), not closed, either orientation, convex or not
    bounds: tuple[float, float, float, float] | None = None  # xmin, xmax, ymin, ymax: the footprint stays inside
    vehicle: Vehicle = field(default_factory=Vehicle)

    def __post_init__(self) -> None:
        for j, ring in enumerate(self.obstacles):
            try:
                polygons_of(ring - ring[0])
            except ValueError as error:
                raise ScenarioError(f"obstacles[{j}]: {error}") from None
        if self.bounds is not None and not (self.bounds[0] < self.bounds[1] and self.bounds[2] < self.bounds[3]):
            raise ScenarioError(f"bounds: must be [xmin, xmax, ymin, ymax] with min < max, not {list(self.bounds)}")
        for which, pose in (("start", self.start), ("goal", self.goal)):
            self._check_pose(which, pose)

    def _check_pose(self, which: str, pose: np.ndarray) -> None:
        footprint = self.vehicle.footprints(pose - np.append(pose[:2], 0.0))[0]  # in a frame that moves with the car
        if self.bounds is not None:
            xmin, xmax, ymin, ymax = self.bounds
            (left, low), (right, high) = footprint.min(axis=0) + pose[:2], footprint.max(axis=0) + pose[:2]
            if left < xmin or right > xmax or low < ymin or high > ymax:
                raise ScenarioError(f"{which}: the car leaves the bounds {list(self.bounds)}")
        car = shapely.Polygon(footprint)
        for j, ring in enumerate(self.obstacles):
            if any(car.intersects(polygon) for polygon in polygons_of(ring - pose[:2])):
                raise ScenarioError(f"{which}: the car collides with obstacles[{j}]")

    @cached_property
    def polygons(self) -> tuple[shapely.Polygon, ...]:
        """The obstacles as exact simple polygons (an obstacle that touches itself gives several)."""
        return tuple(polygon for ring in self.obstacles for polygon in polygons_of(ring))

    @cached_property
    def convex_obstacles(self) -> tuple[np.ndarray, ...]:
        """Convex rings (M, 2), counter-clockwise, that cover the obstacles exactly [m]."""
        return tuple(part for polygon in self.polygons for part in convex_parts(polygon))

    def translated(self, dx: float, dy: float) -> Scenario:
        """The same task moved by (dx, dy) [m].

        Planners work near the origin: maps in world coordinates of 1e9 m would cost them all their digits.
        """
        offset = np.array([dx, dy])
        bounds = self.bounds
        if bounds is not None:
            bounds = (bounds[0] + dx, bounds[1] + dx, bounds[2] + dy, bounds[3] + dy)
        return replace(
            self,
            start=self.start + np.append(offset, 0.0),
            goal=self.goal + np.append(offset, 0.0),
            obstacles=tuple(ring + offset for ring in self.obstacles),
            bounds=bounds,
        )

    @classmethod
    def load(cls, source: str | Path) -> Scenario:
        """Read a scenario: the name of a bundled one, a `.json` or a TPCAP `.csv` file.

        Raises:
            ScenarioError: the file is missing or unreadable, or what it says cannot be planned.
        """
        if str(source) in bundled_scenarios():
            return cls.load(_bundled_folder() / f"{source}.json")
        path = Path(source)
        reader = {".json": _read_json, ".csv": _read_tpcap}.get(path.suffix.lower())
        if reader is None:
            known = ", ".join(bundled_scenarios())
            raise ScenarioError(f"{source}: scenario: neither a .json or .csv file nor a bundled name ({known})")
        try:
            if path.is_dir():
                raise ScenarioError("file: is a folder")
            return reader(path.read_text(encoding="utf-8-sig"), path.stem)
        except ScenarioError as error:
            raise ScenarioError(f"{source}: {error}") from None
        except (OSError, UnicodeDecodeError) as error:
            reason = error.strerror if isinstance(error, OSError) else "is not UTF-8 text"
            raise ScenarioError(f"{source}: file: {reason}") from None

    @classmethod
    def from_dict(cls, data: Any) -> Scenario:
        """Build a scenario from the keys of the JSON format.

        Raises:
            ScenarioError: a key is missing, unknown or has an illegal value; the message names it.
        """
        if not isinstance(data, dict):
            raise ScenarioError(f"scenario: must be an object with the keys {', '.join(KEYS)}")
        for key in data:
            if key not in KEYS:
                raise ScenarioError(f"{key}: unknown key; allowed are {', '.join(KEYS)}")
        for key in REQUIRED_KEYS:
            if key not in data:
                raise ScenarioError(f"{key}: missing")
        bounds = data.get("bounds")
        xmin, xmax, ymin, ymax = _numbers("bounds", bounds, 4) if bounds is not None else (0.0, 0.0, 0.0, 0.0)
        return cls(
            name=_name(data["name"]),
            start=_numbers("start", data["start"], 3),
            goal=_numbers("goal", data["goal"], 3),
            obstacles=_rings(data["obstacles"]),
            bounds=None if bounds is None else (float(xmin), float(xmax), float(ymin), float(ymax)),
            vehicle=_vehicle(data.get("vehicle")),
        )

    def to_dict(self) -> dict[str, Any]:
        """The scenario in the keys of the JSON format; `from_dict` gives it back exactly."""
        data: dict[str, Any] = {
            "name": self.name,
            "start": self.start.tolist(),
            "goal": self.goal.tolist(),
            "obstacles": [ring.tolist() for ring in self.obstacles],
        }
        if self.bounds is not None:
            data["bounds"] = list(self.bounds)
        data["vehicle"] = self.vehicle.to_dict()
        return data

    def save(self, path: Path | str) -> None:
        """Write the scenario as JSON."""
        write_atomically(Path(path), json.dumps(self.to_dict(), indent=1) + "\n")


def bundled_scenarios() -> list[str]:
    """Names of the scenarios that come with the package."""
    return sorted(path.stem for path in _bundled_folder().iterdir() if path.suffix == ".json")


def _bundled_folder() -> Path:
    return Path(str(resources.files("drake_gnnocp") / "scenarios"))


def _read_json(text: str, _stem: str) -> Scenario:
    try:
        data = json.loads(text, object_pairs_hook=_unique_keys)
    except json.JSONDecodeError as error:
        raise ScenarioError(f"line {error.lineno}: is not JSON: {error.msg}") from None
    except RecursionError:
        raise ScenarioError("file: is nested too deeply") from None
    return Scenario.from_dict(data)


def _unique_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    data = dict(pairs)
    if len(data) < len(pairs):
        keys = [key for key, _ in pairs]
        raise ScenarioError(f"{next(key for key in keys if keys.count(key) > 1)}: appears twice")
    return data


def _read_tpcap(text: str, stem: str) -> Scenario:
    """Read one row `x0,y0,th0, xf,yf,thf, n, count_1..count_n, x,y of every vertex`."""
    cells = [cell.strip() for cell in text.replace("\n", ",").split(",") if cell.strip()]
    values = np.array([_cell(i, cell) for i, cell in enumerate(cells)])
    if len(values) < 7:
        raise ScenarioError(f"row 1: needs start, goal and the number of obstacles (7 numbers), has {len(values)}")
    n = _count("number of obstacles", values[6], least=0)
    if len(values) < 7 + n:
        raise ScenarioError(f"vertex counts: needs {n} of them, has {len(values) - 7}")
    counts = [_count(f"vertex count of obstacles[{j}]", value, least=3) for j, value in enumerate(values[7 : 7 + n])]
    vertices = values[7 + n :]
    if len(vertices) != 2 * sum(counts):
        raise ScenarioError(f"vertices: the counts ask for {2 * sum(counts)} numbers, there are {len(vertices)}")
    rings = np.split(vertices.reshape(-1, 2), np.cumsum(counts)[:-1]) if n else []
    return Scenario(_name(stem), values[0:3], values[3:6], tuple(rings), vehicle=TPCAP_VEHICLE)


def _cell(i: int, cell: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        raise ScenarioError(f"number {i + 1}: {cell!r} is not a number") from None
    if not math.isfinite(value):
        raise ScenarioError(f"number {i + 1}: must be finite, not {cell}")
    return value


def _count(what: str, value: float, least: int) -> int:
    if value != int(value) or value < least:
        raise ScenarioError(f"{what}: must be a whole number of at least {least}, not {value:g}")
    return int(value)


def _name(value: Any) -> str:
    # the name becomes a folder under artifacts/plans
    if not isinstance(value, str) or not value.strip(" .") or any(c in '/\\\0\n\r' for c in value) or len(value) > 100:
        raise ScenarioError(f"name: must be a plain name without slashes, not {value!r:.60}")
    return value


def _numbers(what: str, value: Any, n: int) -> np.ndarray:
    if not isinstance(value, list | tuple) or len(value) != n:
        raise ScenarioError(f"{what}: must be a list of {n} numbers")
    for i, number in enumerate(value):
        if isinstance(number, bool) or not isinstance(number, int | float):
            raise ScenarioError(f"{what}[{i}]: must be a number, not {number!r:.60}")
        if not abs(number) <= 1e15:  # NaN as well
            raise ScenarioError(f"{what}[{i}]: must be finite and below 1e15, not {number!r:.60}")
    return np.array(value, dtype=float)


def _rings(value: Any) -> tuple[np.ndarray, ...]:
    if not isinstance(value, list | tuple):
        raise ScenarioError("obstacles: must be a list of polygons")
    rings = []
    for j, ring in enumerate(value):
        if not isinstance(ring, list | tuple) or len(ring) < 3:
            raise ScenarioError(f"obstacles[{j}]: must be a list of at least 3 vertices")
        rings.append(np.array([_numbers(f"obstacles[{j}][{k}]", vertex, 2) for k, vertex in enumerate(ring)]))
    return tuple(rings)


def _vehicle(value: Any) -> Vehicle:
    if value is None:
        return Vehicle()
    if not isinstance(value, dict):
        raise ScenarioError("vehicle: must be an object")
    try:
        return Vehicle.from_dict(value)
    except ValueError as error:
        raise ScenarioError(str(error)) from None
