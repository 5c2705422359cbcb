"""What scenario files say, checked key by key: JSON, drawings, occupancy maps, and the CSV format of TPCAP.

A key of the JSON format is one entry of `PARSERS`, which turns what the file says into the field of the same name of
`Scenario`, or raises.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import chain
from pathlib import Path
from reprlib import repr as shown  # short, and shallow where the value is nested
from typing import Any

import numpy as np

from drake_gnnocp.ends import GoalTolerance
from drake_gnnocp.files import PACKAGE, parse_json, read_text
from drake_gnnocp.maps.dxf import read_dxf
from drake_gnnocp.maps.geojson import parse_geojson
from drake_gnnocp.maps.grid_outlines import fields_of_grid
from drake_gnnocp.maps.tpcap import parse_tpcap
from drake_gnnocp.shapes import Area
from drake_gnnocp.vehicle import Vehicle

MAP_SUFFIXES = (".yaml", ".yml")
SUFFIXES = (".json", ".geojson", ".dxf", ".csv", *MAP_SUFFIXES)
POSE, BOUNDS = "x, y, theta", "xmin, xmax, ymin, ymax"
LARGEST = 1e12  # m, rad: beyond it a double does not resolve the millimetre
NUMBERS = frozenset({int, float})
LONGEST_NAME = 100  # bytes, names of files end at 255
BUNDLED = PACKAGE / "scenarios"


class ScenarioError(ValueError):
    """A scenario that cannot be planned: the message is one line that names the file, the field and the reason."""


def bundled_scenarios() -> list[str]:
    """Names of the scenarios that come with the package."""
    return sorted(path.stem for path in BUNDLED.iterdir() if path.suffix == ".json")


def path_of(source: str | Path) -> Path:
    """The file of a scenario.

    Args:
        source: its path, or the name of a bundled one.

    Raises:
        ScenarioError: it is neither a bundled name nor a path with one of the SUFFIXES.
    """
    if str(source) in (names := bundled_scenarios()):
        return BUNDLED / f"{source}.json"
    if Path(source).suffix.lower() not in SUFFIXES:
        known = f"{', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]}"
        raise ScenarioError(f"scenario: neither a {known} file nor a bundled name ({', '.join(names)})")
    return Path(source)


def read_fields(path: Path, unknown: str, layers: Sequence[str] = ()) -> dict[str, Any]:
    """The fields of the scenario in a file with one of the SUFFIXES.

    Those of an occupancy map lack start and goal, those of a JSON file or a drawing may.

    Args:
        path: of the file.
        unknown: what unknown cells of an occupancy map are taken for.
        layers: of a DXF drawing: only what is on these is an obstacle.

    Raises:
        ValueError: the file is missing or unreadable, or a value is illegal; the message is one line.
    """
    suffix = path.suffix.lower()
    if layers and suffix != ".dxf":
        raise ScenarioError("--layers: only a .dxf file has layers")
    if suffix in MAP_SUFFIXES:
        from drake_gnnocp.maps.occupancy_map import read_map  # what reads images is not for every scenario

        return {"name": _name(path.stem), **fields_of_grid(read_map(path, unknown))}
    if suffix == ".dxf":
        return checked_fields(read_dxf(path, layers), WITHOUT_ENDS)
    text = read_text(path)
    if suffix == ".geojson":
        return checked_fields(parse_geojson(text, path.stem), WITHOUT_ENDS)
    if suffix == ".csv":
        return checked_fields(parse_tpcap(text, path.stem))
    data = parse_json(text)
    held = data if isinstance(data, dict) else {}
    return checked_fields(data, [key for key in REQUIRED_KEYS if key in WITHOUT_ENDS or key in held])


def with_ends(fields: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """Fields of a scenario, start and goal among them: those of a file, and others that take their places.

    Raises:
        ScenarioError: one of them is missing.
    """
    for one, other in (("goal", "goals"), ("goals", "goal")):
        if one in changes:
            fields.pop(other, None)
    fields = fields | changes
    missing = [end for end in ("start", "goal") if end not in fields and f"{end}s" not in fields]
    if missing:
        options = " ".join(f"--{end} X Y THETA" for end in missing)
        raise ScenarioError(f"{' and '.join(missing)}: missing; where the file has none, give {options}")
    return fields


def checked_fields(data: Any, required: Sequence[str] | None = None) -> dict[str, Any]:
    """The fields of a scenario by name, from the keys of the JSON format; keys that are left out or null have none.

    Args:
        data: the keys and what they hold.
        required: keys that must not be left out; None for REQUIRED_KEYS.

    Raises:
        ScenarioError: a key is missing, unknown or has an illegal value; the message names it.
    """
    required = REQUIRED_KEYS if required is None else required
    if not isinstance(data, dict):
        raise ScenarioError(f"scenario: must be an object with the keys {', '.join(KEYS)}, not {shown(data)}")
    for key in data:
        if key not in KEYS:
            raise ScenarioError(f"{key}: unknown key; allowed are {', '.join(KEYS)}")
    several = data.get("goals") is not None
    if several and data.get("goal") is not None:
        raise ScenarioError("goals: give either goal or goals, not both")
    required = [key for key in required if not (several and key == "goal")]
    for key in required:
        if key not in data:
            raise ScenarioError(f"{key}: missing")
    given = [key for key in KEYS if key in required or data.get(key) is not None]
    return {key: PARSERS[key](data[key]) for key in given}


def as_json(value: Any) -> Any:
    """Fields in what JSON can hold; `checked_fields` gives them back exactly. What is None is left out."""
    if isinstance(value, Mapping):
        return {key: as_json(inner) for key, inner in value.items() if inner is not None}
    if isinstance(value, Vehicle | GoalTolerance):
        return value.to_dict()
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Area):
        return as_json(value._asdict())
    return [as_json(inner) for inner in value] if isinstance(value, tuple) else value


def pose_as_json(pose: np.ndarray) -> list[float | None]:
    """A pose (3,) in what JSON can hold: a heading that is free is None."""
    return [None if math.isnan(number) else number for number in pose.tolist()]


def _name(value: Any) -> str:
    # the name becomes a folder under artifacts/plans
    if not isinstance(value, str) or not value.strip(" ."):
        raise ScenarioError(f"name: must be a text that can name a folder, not {shown(value)}")
    if not value.isprintable() or "/" in value or "\\" in value:
        raise ScenarioError(f"name: must have no slashes or unprintable characters, unlike {shown(value)}")
    if len(value.encode()) > LONGEST_NAME:
        raise ScenarioError(f"name: must be at most {LONGEST_NAME} bytes long, unlike {shown(value)}")
    return value


def _numbers(what: str, value: Any, meaning: str) -> np.ndarray:
    n = len(meaning.split(","))
    if not isinstance(value, list | tuple) or len(value) != n:
        raise ScenarioError(f"{what}: must be {n} numbers [{meaning}], not {shown(value)}")
    for i, number in enumerate(value):
        if isinstance(number, bool) or not isinstance(number, int | float):
            raise ScenarioError(f"{what}[{i}]: must be a number, not {shown(number)}")
        if not abs(number) <= LARGEST:  # NaN as well
            raise ScenarioError(f"{what}[{i}]: must be finite and at most {LARGEST:g}, not {shown(number)}")
    return np.array(value, dtype=float)


def _goal(what: str, value: Any) -> np.ndarray:
    """A pose, whose heading may be null: it is NaN then."""
    if isinstance(value, list | tuple) and len(value) == 3 and value[2] is None:
        return np.append(_numbers(what, (*value[:2], 0.0), POSE)[:2], math.nan)
    return _numbers(what, value, POSE)


def _goals(value: Any) -> tuple[np.ndarray, ...]:
    if not isinstance(value, list | tuple) or not value:
        raise ScenarioError(f"goals: must be a list of at least one pose [{POSE}], not {shown(value)}")
    return tuple(_goal(f"goals[{i}]", goal) for i, goal in enumerate(value))


def _goal_tolerance(value: Any) -> GoalTolerance:
    try:
        return GoalTolerance.from_dict(value)
    except ValueError as error:
        raise ScenarioError(str(error)) from None


def _bounds(value: Any) -> tuple[float, ...] | np.ndarray:
    if isinstance(value, list | tuple) and value and isinstance(value[0], list | tuple):
        return _vertices("bounds", value, least=3)
    return tuple(_numbers("bounds", value, BOUNDS).tolist())


def _clearance(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ScenarioError(f"clearance: must be a number in m, not {shown(value)}")
    return value


def _obstacles(value: Any) -> tuple[np.ndarray | Area, ...]:
    if not isinstance(value, list | tuple):
        raise ScenarioError(f"obstacles: must be a list of polygons, not {shown(value)}")
    return tuple(
        _area(f"obstacles[{j}]", obstacle)
        if isinstance(obstacle, dict)
        else _vertices(f"obstacles[{j}]", obstacle, least=3)
        for j, obstacle in enumerate(value)
    )


def _area(what: str, value: dict[str, Any]) -> Area:
    for key in value:
        if key not in Area._fields:
            raise ScenarioError(f"{what}.{key}: unknown key; allowed are {', '.join(Area._fields)}")
    if "ring" not in value:
        raise ScenarioError(f"{what}.ring: missing")
    holes = [] if value.get("holes") is None else value["holes"]
    if not isinstance(holes, list | tuple):
        raise ScenarioError(f"{what}.holes: must be a list of polygons, not {shown(holes)}")
    rings = tuple(_vertices(f"{what}.holes[{k}]", hole, least=3) for k, hole in enumerate(holes))
    return Area(_vertices(f"{what}.ring", value["ring"], least=3), rings)


def _lines(value: Any) -> tuple[np.ndarray, ...]:
    if not isinstance(value, list | tuple):
        raise ScenarioError(f"lines: must be a list of polylines, not {shown(value)}")
    return tuple(_vertices(f"lines[{j}]", line, least=2) for j, line in enumerate(value))


def _points(value: Any) -> np.ndarray:
    if not isinstance(value, list | tuple):
        raise ScenarioError(f"points: must be a list of [x, y] or [x, y, r], not {shown(value)}")
    points = np.zeros((len(value), 3))
    for k, point in enumerate(value):
        meaning = "x, y" if isinstance(point, list | tuple) and len(point) == 2 else "x, y, r"
        numbers = _numbers(f"points[{k}]", point, meaning)
        points[k, : len(numbers)] = numbers
        if points[k, 2] < 0:
            raise ScenarioError(f"points[{k}]: must have a radius of 0 or more, not {points[k, 2]:g}")
    return points


def _vertices(what: str, value: Any, least: int) -> np.ndarray:
    if not isinstance(value, list | tuple) or len(value) < least:
        raise ScenarioError(f"{what}: must be a list of at least {least} vertices [x, y], not {shown(value)}")
    if all(type(vertex) in (list, tuple) and len(vertex) == 2 for vertex in value):
        numbers = list(chain.from_iterable(value))
        if NUMBERS.issuperset(map(type, numbers)) and all(abs(number) <= LARGEST for number in numbers):
            return np.array(value, dtype=float)  # the usual way: what follows takes four times as long
    return np.array([_numbers(f"{what}[{k}]", vertex, "x, y") for k, vertex in enumerate(value)])  # names the fault


def _vehicle(value: Any) -> Vehicle:
    if not isinstance(value, dict):
        raise ScenarioError(f"vehicle: must be an object, not {shown(value)}")
    try:
        return Vehicle.from_dict(value)
    except ValueError as error:
        raise ScenarioError(str(error)) from None


PARSERS: dict[str, Callable[[Any], Any]] = {
    "name": _name,
    "start": partial(_numbers, "start", meaning=POSE),
    "goal": partial(_goal, "goal"),
    "obstacles": _obstacles,
    "bounds": _bounds,
    "vehicle": _vehicle,
    "clearance": _clearance,
    "lines": _lines,
    "points": _points,
    "goals": _goals,
    "goal_tolerance": _goal_tolerance,
}
KEYS = tuple(PARSERS)
REQUIRED_KEYS = KEYS[:4]
WITHOUT_ENDS = ("name", "obstacles")  # of a file: start and goal may be given beside it
