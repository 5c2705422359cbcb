"""Drawings with damage of all kinds, as bytes."""

from __future__ import annotations

import copy
import json
from typing import Any

import numpy as np

SUBCLASS = {
    **{"LINE": "AcDbLine", "CIRCLE": "AcDbCircle", "LWPOLYLINE": "AcDbPolyline", "POLYLINE": "AcDb2dPolyline"},
    **{"ELLIPSE": "AcDbEllipse", "SPLINE": "AcDbSpline", "INSERT": "AcDbBlockReference", "POINT": "AcDbPoint"},
}
DXF_CELLS = [
    *("nan", "inf", "1e308", "-1", "0", "1e300", "", "x", "\n", "1e-320", "70", "LINE", "9" * 400, "\x00", "HATCH"),
    *("BOUNDS", "INSERT", "-5", "255", "10\n", "START", "POST", "100000", "SPLINE", "0.5"),
]
JSON_WORDS = [
    *(
        "NaN",
        "Infinity",
        "null",
        "[",
        "]",
        "{",
        "}",
        ",",
        '"',
        "1e999",
        "\\u0000",
        "-",
        "//",
        "\ufeff",
        "\n",
        "9" * 400,
    ),
    *('"start"', '"bounds"', '"role"', '"Point"', '"Polygon"'),
]
STRANGE: list[Any] = [
    *(
        float("nan"),
        float("inf"),
        1e308,
        1e13,
        -0.0,
        1e-320,
        10**400,
        -1,
        2.5,
        True,
        None,
        "90deg",
        "nandeg",
        "9e99deg",
    ),
    *(
        "",
        "0",
        "\x00",
        "\ud800",
        "goal",
        "start",
        "bounds",
        "Polygon",
        "Point",
        [],
        {},
        [[]],
        [None],
        [[[[0]]]],
        [0] * 50,
    ),
    *({"type": "Feature"}, {"type": "Point", "coordinates": [0, 0]}, {"properties": {"name": "EPSG:4326"}}),
]


def tags(*pairs: tuple[int, object]) -> str:
    """Group codes and values as the text of a DXF file."""
    return "".join(f"{code}\n{value}\n" for code, value in pairs)


def entity(kind: str, *pairs: tuple[int, object], layer: str = "WALLS") -> str:
    return tags((0, kind), (100, "AcDbEntity"), (8, layer), (100, SUBCLASS[kind]), *pairs)


def ends(x: float, y: float, u: float, v: float) -> tuple[tuple[int, object], ...]:
    return (10, x), (20, y), (11, u), (21, v)


def vertex(x: float, y: float, bulge: float = 0.0) -> str:
    place = (8, "WALLS"), (100, "AcDbVertex"), (100, "AcDb2dVertex"), (10, x), (20, y), (42, bulge)
    return tags((0, "VERTEX"), (100, "AcDbEntity"), *place)


DXF = "".join(  # in mm
    [
        tags((0, "SECTION"), (2, "HEADER"), (9, "$ACADVER"), (1, "AC1015"), (9, "$INSUNITS"), (70, 4), (0, "ENDSEC")),
        tags((0, "SECTION"), (2, "BLOCKS"), (0, "BLOCK"), (8, "0"), (2, "POST"), (70, 0), (10, 0), (20, 0)),
        entity("CIRCLE", (10, 0), (20, 0), (40, 200), layer="0"),
        tags((0, "ENDBLK"), (8, "0"), (0, "ENDSEC"), (0, "SECTION"), (2, "ENTITIES")),
        entity("LINE", *ends(0, 0, 1000, 0), layer="START"),
        entity("LINE", *ends(14000, 0, 15000, 500), layer="GOAL"),
        entity(
            "LWPOLYLINE",
            (90, 3),
            (70, 1),
            (10, 8000),
            (20, 8000),
            (10, 11000),
            (20, 8000),
            (42, 0.5),
            (10, 8000),
            (20, 11000),
        ),
        entity("POLYLINE", (66, 1), (70, 1)) + vertex(-8000, 8000) + vertex(-7000, 8000, -1) + vertex(-8000, 9000),
        tags((0, "SEQEND")),
        entity("CIRCLE", (10, 0), (20, -9000), (40, 2000), (100, "AcDbArc"), (50, 20), (51, 100)).replace(
            "CIRCLE", "ARC"
        ),
        entity("ELLIPSE", *ends(9000, -9000, 1000, 500), (40, 0.5), (41, 0), (42, 6.283185307179586)),
        entity(
            "SPLINE",
            *((70, 8), (71, 3), (72, 8), (73, 4), *((40, knot) for knot in (0, 0, 0, 0, 1, 1, 1, 1))),
            *(
                (code, 1000 * at)
                for x, y in ((-9, -9), (-8, -8), (-7, -9.5), (-6, -9))
                for code, at in ((10, x), (20, y))
            ),
        ),
        entity("INSERT", (2, "POST"), (10, 5000), (20, -5000), (41, 2), (50, 30)),
        entity("POINT", (10, 3000), (20, 9000)),
        tags((0, "ENDSEC"), (0, "EOF")),
    ]
)


def feature(kind: str, coordinates: Any, **properties: Any) -> dict[str, Any]:
    """A feature of GeoJSON."""
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


GEOJSON: dict[str, Any] = {
    "type": "FeatureCollection",
    "name": "yard",
    "clearance": 0.1,
    "features": [
        feature("Point", [0, 0], role="start", heading="90deg"),
        feature("Point", [14, 0], role="goal", heading=0.5),
        feature("Polygon", [[[-20, -20], [40, -20], [40, 20], [-20, 20], [-20, -20]]], role="bounds"),
        feature("Polygon", [[[8, 8], [12, 8], [12, 12], [8, 12], [8, 8]]]),
        feature("MultiPolygon", [[[[5, -8], [6, -8], [6, -5], [5, -8]]], [[[-9, -8], [-8, -8], [-8, -5]]]]),
    ],
}


def damaged_bytes(text: str, words: list[str], rng: np.random.Generator) -> bytes:
    """A text with some bytes changed, put in or left out."""
    data = text.encode()
    for _ in range(rng.integers(1, 5)):
        first, last = np.sort(rng.integers(0, len(data) + 1, 2))
        last = min(last, first + rng.integers(0, 12)) if rng.random() < 0.8 else last
        put = words[rng.integers(len(words))].encode() if rng.random() < 0.7 else rng.bytes(int(rng.integers(0, 4)))
        data = data[:first] + put + data[last:]
    return data


def damaged_dxf(rng: np.random.Generator) -> bytes:
    """A DXF drawing with other values, tags left out, or tags put in; at times other bytes."""
    if rng.random() < 0.3:
        return damaged_bytes(DXF, DXF_CELLS, rng)
    lines = DXF.split("\n")
    for _ in range(rng.integers(1, 4)):
        at, cell, chance = rng.integers(len(lines)), DXF_CELLS[rng.integers(len(DXF_CELLS))], rng.random()
        if chance < 0.7:
            lines[at] = cell
        elif chance < 0.85:
            del lines[at : at + 2]
        else:
            lines[at:at] = [str(rng.integers(0, 300)), cell]
    return "\n".join(lines).encode()


def damaged_geojson(rng: np.random.Generator) -> bytes:
    """GeoJSON with other values, however deep, members left out or named otherwise; at times other bytes."""
    if rng.random() < 0.3:
        return damaged_bytes(json.dumps(GEOJSON), JSON_WORDS, rng)
    data = json.loads(json.dumps(GEOJSON))
    for _ in range(rng.integers(1, 4)):
        holder: Any = data
        while keys := list(holder) if isinstance(holder, dict) else list(range(len(holder))):
            key = keys[rng.integers(len(keys))]
            if isinstance(holder[key], dict | list) and rng.random() < 0.8:
                holder = holder[key]
                continue
            if rng.random() < 0.2:
                del holder[key]
            else:
                holder[key] = copy.deepcopy(STRANGE[rng.integers(len(STRANGE))])
            break
    return json.dumps(data).encode("utf-8", "surrogatepass")
