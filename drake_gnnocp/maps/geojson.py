"""GeoJSON (RFC 7946) as a scenario: FeatureCollection, Feature, or a geometry; coordinates in metres.

Every geometry is an obstacle: Polygon and MultiPolygon with their holes, LineString and MultiLineString without
thickness, Point and MultiPoint, with the property `radius` [m] as discs. The property `role` of a feature makes it
another thing:

    start    a Point; its property `heading` is a number in rad, or a text such as "90deg"
    goal     the same; without a heading, or with null, that is free; several are goals of which one is to be reached
    bounds   a Polygon without holes
    ignore   nothing
    obstacle what it is without a role

Members of the outermost object that the scenario's JSON format has too (see MEMBERS) mean what they mean there.

The RFC has longitudes and latitudes only. Here these are refused where the file says so in a `crs` member, as QGIS and
GeoJSON of 2008 write it, and so is Web Mercator, which stretches lengths. A file without it is taken to be in metres.
"""

from __future__ import annotations

import json
import logging
import math
import re
from collections.abc import Callable, Iterator
from reprlib import repr as shown
from typing import Any

import numpy as np

from drake_gnnocp.files import parse_json
from drake_gnnocp.maps.drawing import Drawing, Points, without_closing

MEMBERS = ("name", "vehicle", "clearance", "start", "goal", "goals", "goal_tolerance", "start_motion", "goal_motion")
ROLES = ("start", "goal", "bounds", "obstacle", "ignore")
LARGEST = 1e12  # m, rad
DEEPEST = 50  # collections within collections
SMALLEST_MAP = 1.0  # m: all there is to drive around takes more
WEB_MERCATOR = {3857, 3785, 900913, 102100, 102113}
# EPSG keeps 4001 to 4999 for geographic and geocentric systems; these came later
GEOGRAPHIC = {*range(4001, 5000), 6318, 6319, 6668, 6783, 7844, 7843, 7912, 9000, 9057, 9059, 9755, 9990}

logger = logging.getLogger(__name__)


def parse_geojson(text: str, name: str) -> dict[str, Any]:
    """Turn a GeoJSON text into the keys of the scenario's JSON format.

    Args:
        text: the GeoJSON.
        name: of the scenario, where the file has none.

    Raises:
        ValueError: the text is not GeoJSON, or not in metres; the message is one line and names the member.
    """
    root = parse_json(text)
    if not isinstance(root, dict):
        raise ValueError(f"file: must be a GeoJSON object, not {shown(root)}")
    _refuse_degrees(root.get("crs"))
    drawing = Drawing()
    for where, geometry, properties in _features(root, "", 0):
        _add_feature(drawing, where, geometry, properties)
    _warn_of_degrees(drawing)
    keys = {"name": name, **drawing.keys()}
    for member in MEMBERS:
        if root.get(member) is None:
            continue
        shows = {"start": drawing.start, "goal": drawing.goals, "goals": drawing.goals}
        if shows.get(member):
            raise ValueError(f"{member}: is given twice, as a member and by a feature's role")
        keys[member] = root[member]
    return keys


def _features(data: Any, where: str, depth: int) -> Iterator[tuple[str, Any, dict[str, Any]]]:
    """What is drawn: where it stands in the file, a geometry that is no collection, and the feature's properties."""
    kind = _type_of(data, where)
    if kind == "FeatureCollection":
        for i, feature in enumerate(_list(data.get("features"), f"{where}features")):
            if _type_of(feature, f"features[{i}].") != "Feature":
                raise ValueError(f"features[{i}].type: must be Feature, not {shown(feature['type'])}")
            yield from _features(feature, f"features[{i}].", depth)
    elif kind == "Feature":
        properties = {} if data.get("properties") is None else data["properties"]
        if not isinstance(properties, dict):
            raise ValueError(f"{where}properties: must be an object or null, not {shown(properties)}")
        if properties.get("role") not in (None, *ROLES):
            role = shown(properties["role"])
            raise ValueError(f"{where}properties.role: must be one of {', '.join(ROLES)}, not {role}")
        if data.get("geometry") is not None and properties.get("role") != "ignore":
            for at, geometry in _geometries(data["geometry"], f"{where}geometry.", depth):
                yield at, geometry, properties
    else:
        for at, geometry in _geometries(data, where, depth):
            yield at, geometry, {}


def _geometries(data: Any, where: str, depth: int) -> Iterator[tuple[str, Any]]:
    kind = _type_of(data, where)
    if depth > DEEPEST:
        raise ValueError("file: is nested too deeply")
    if kind == "GeometryCollection":
        for i, geometry in enumerate(_list(data.get("geometries"), f"{where}geometries")):
            yield from _geometries(geometry, f"{where}geometries[{i}].", depth + 1)
    elif kind in READERS:
        yield where, data
    else:
        raise ValueError(f"{where}type: must be a geometry of GeoJSON, not {shown(kind)}")


def _type_of(data: Any, where: str) -> str:
    if not isinstance(data, dict):
        raise ValueError(f"{where.removesuffix('.')}: must be an object, not {shown(data)}")
    if "type" not in data:
        raise ValueError(f"{where}type: missing")
    if not isinstance(data["type"], str):
        raise ValueError(f"{where}type: must be a text, not {shown(data['type'])}")
    return data["type"]


def _add_feature(drawing: Drawing, where: str, geometry: dict[str, Any], properties: dict[str, Any]) -> None:
    role, kind = properties.get("role") or "obstacle", geometry["type"]
    at = f"{where}coordinates"
    wanted = {"start": "Point", "goal": "Point", "bounds": "Polygon"}.get(role, kind)
    if kind != wanted:
        raise ValueError(f"{where}type: must be {wanted} where the role is {role}, not {kind}")
    coordinates = READERS[kind](geometry.get("coordinates"), at)
    if role == "obstacle":
        _add_obstacle(drawing, kind, coordinates, _radius(properties, where), at)
    elif role == "bounds":
        if len(coordinates) != 1:
            raise ValueError(f"{at}: must be one ring where the role is bounds: draw its holes as obstacles")
        drawing.set_bounds(coordinates[0], at)
    else:
        heading = _heading(properties.get("heading"), f"{where}properties.heading".replace("geometry.", ""))
        if role == "goal":
            drawing.goals.append([*coordinates, heading])
        elif heading is None:
            raise ValueError(f"{at}: a start needs the property heading, in rad or such as '90deg'")
        else:
            drawing.set_start([*coordinates, heading], at)


def _add_obstacle(drawing: Drawing, kind: str, coordinates: Any, radius: float, at: str) -> None:
    several = coordinates if kind.startswith("Multi") else [coordinates]
    if kind.endswith("Polygon"):
        for i, rings in enumerate(several):
            if rings:
                drawing.add_area(rings[0], rings[1:], f"{at}[{i}]" if kind.startswith("Multi") else at)
    elif kind.endswith("LineString"):
        drawing.lines += several
    else:
        drawing.points += [[*point, radius] if radius else point for point in several]


def _list(value: Any, where: str) -> list[Any]:
    if not isinstance(value, list):
        raise ValueError(f"{where}: must be a list, not {shown(value)}")
    return value


def _number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{where}: must be a number, not {shown(value)}")
    if not abs(value) <= LARGEST:  # NaN as well
        raise ValueError(f"{where}: must be finite and at most {LARGEST:g}, not {shown(value)}")
    return float(value)


def _position(value: Any, where: str) -> list[float]:
    if not isinstance(value, list) or len(value) < 2:
        raise ValueError(f"{where}: must be a position [x, y], not {shown(value)}")
    return [_number(number, f"{where}[{i}]") for i, number in enumerate(value)][:2]  # a height may follow


def _line(value: Any, where: str) -> Points:
    line = _positions(value, where)
    if len(line) < 2:
        raise ValueError(f"{where}: must have at least 2 positions, not {len(line)}")
    return line


def _ring(value: Any, where: str) -> Points:
    ring = without_closing(_positions(value, where))  # one that is not closed means the same
    if len(ring) < 3:
        raise ValueError(f"{where}: must have at least 3 different positions, not {len(ring)}")
    return ring


def _all(read: Callable[[Any, str], Any]) -> Callable[[Any, str], list[Any]]:
    """A reader of lists, from one of what they hold."""
    return lambda value, where: [read(item, f"{where}[{i}]") for i, item in enumerate(_list(value, where))]


_positions = _all(_position)
READERS: dict[str, Callable[[Any, str], Any]] = {
    "Point": _position,
    "MultiPoint": _positions,
    "LineString": _line,
    "MultiLineString": _all(_line),
    "Polygon": _all(_ring),
    "MultiPolygon": _all(_all(_ring)),
}


def _radius(properties: dict[str, Any], where: str) -> float:
    if properties.get("radius") is None:
        return 0.0
    where = f"{where}properties.radius".replace("geometry.", "")
    radius = _number(properties["radius"], where)
    if radius < 0:
        raise ValueError(f"{where}: must be 0 or more metres, not {radius:g}")
    return radius


def _heading(value: Any, where: str) -> float | None:
    """A heading in rad, from a number in rad or a text in degrees; None where it is free."""
    if value is None:
        return None
    if isinstance(value, str):
        degrees = re.fullmatch(r"\s*([-+]?\d+(\.\d*)?|[-+]?\.\d+)\s*(deg|°)\s*", value, re.ASCII)
        if not degrees:
            raise ValueError(f"{where}: must be a number in rad or a text such as '90deg', not {shown(value)}")
        return math.radians(_number(float(degrees[1]), where))
    return _number(value, where)


def _refuse_degrees(crs: Any) -> None:
    """Raise a ValueError where a coordinate reference system is known not to be in metres."""
    if crs is None:
        return
    text = json.dumps(crs).upper()
    codes = {int(code) for code in re.findall(r"EPSG[^\d\"]*?:+(?:[\d.]*:+)?(\d{4,6})\b", text, re.ASCII)}
    if re.search(r"CRS:?(84|83|27)\b", text) or codes & GEOGRAPHIC:
        raise ValueError(f"crs: {shown(crs)} has longitudes and latitudes: export in metres, such as UTM")
    if codes & WEB_MERCATOR:
        raise ValueError(f"crs: {shown(crs)} is Web Mercator, which stretches lengths: export in metres, such as UTM")
    if not codes:
        logger.warning("crs: %s is not known here: coordinates are taken as metres", shown(crs))


def _warn_of_degrees(drawing: Drawing) -> None:
    """Numbers alone do not say what they are; a whole map that is smaller than a car is suspicious."""
    vertices = np.array(drawing.vertices())
    if len(vertices) < 2 or (np.abs(vertices) > [180.0, 90.0]).any():
        return
    spans = np.ptp(vertices, axis=0)
    if max(spans) < SMALLEST_MAP:
        logger.warning("coordinates: the map is %.2g x %.2g m: are these degrees?", *spans)
