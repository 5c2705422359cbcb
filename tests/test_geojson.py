"""GeoJSON as scenarios: geometries against shapely's own reader, roles, members, and what is not in metres."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from drake_gnnocp import Scenario
from drake_gnnocp.maps.geojson import parse_geojson
from drake_gnnocp.scenario import Area

ROOT = Path(__file__).parents[1]
BOX = [[6, -3], [9, -3], [9, 1], [6, 1], [6, -3]]
HOLE = [[7, -2], [8, -2], [8, 0], [7, 0], [7, -2]]
FRAME = [[-5, -10], [30, -10], [30, 15], [-5, 15], [-5, -10]]


def feature(kind: str, coordinates: Any, **properties: Any) -> dict[str, Any]:
    return {"type": "Feature", "properties": properties, "geometry": {"type": kind, "coordinates": coordinates}}


def collection(*features: Any, **members: Any) -> dict[str, Any]:
    return {"type": "FeatureCollection", **members, "features": list(features)}


def parsed(data: Any) -> dict[str, Any]:
    return parse_geojson(json.dumps(data), "file")


START, GOAL = feature("Point", [0, 0], role="start", heading=0), feature("Point", [18, 4], role="goal", heading="90deg")


def test_a_yard_is_read_as_drawn(tmp_path: Path) -> None:
    path = tmp_path / "yard.geojson"
    data = collection(START, GOAL, feature("Polygon", [FRAME], role="bounds"), feature("Polygon", [BOX]))
    path.write_text(json.dumps(data | {"vehicle": {"width": 2.0}, "clearance": 0.2, "generator": "by hand"}))
    scenario = Scenario.load(path)
    assert scenario.name == "yard"
    assert scenario.start.tolist() == [0, 0, 0] and scenario.goal.tolist() == [18, 4, math.pi / 2]
    assert scenario.bounds == (-5, 30, -10, 15) and scenario.vehicle.width == 2.0 and scenario.clearance == 0.2
    assert scenario.to_dict()["obstacles"] == [BOX[:-1]]
    assert Scenario.from_dict(scenario.to_dict()).to_dict() == scenario.to_dict()


def test_the_car_park_among_the_examples_is_all_that_can_be_drawn() -> None:
    scenario = Scenario.load(ROOT / "examples" / "car_park.geojson")
    assert (len(scenario.obstacles), len(scenario.lines), len(scenario.points)) == (15, 1, 5)
    assert any(isinstance(obstacle, Area) for obstacle in scenario.obstacles)
    assert len(scenario.to_dict()["bounds"]) == 5 and scenario.clearance == 0.1
    assert Scenario.from_dict(scenario.to_dict()).to_dict() == scenario.to_dict()


def test_every_geometry_has_its_key() -> None:
    members = [
        {"type": "Polygon", "coordinates": [BOX, HOLE]},
        {"type": "MultiPolygon", "coordinates": [[FRAME], [BOX, HOLE], []]},
        {"type": "LineString", "coordinates": [[0, 1, 99], [2, 3, 99]]},
        {"type": "MultiLineString", "coordinates": [[[4, 5], [6, 7]], [[8, 9], [8, 8], [7, 7]]]},
        {"type": "Point", "coordinates": [1.5, 2.5]},
        {"type": "GeometryCollection", "geometries": [{"type": "MultiPoint", "coordinates": [[3, 3], [4, 4]]}]},
    ]
    found = parsed({"type": "GeometryCollection", "geometries": members})
    ringed = {"ring": BOX[:-1], "holes": [HOLE[:-1]]}
    assert found == {
        "name": "file",
        "obstacles": [ringed, FRAME[:-1], ringed],
        "lines": [[[0, 1], [2, 3]], [[4, 5], [6, 7]], [[8, 9], [8, 8], [7, 7]]],
        "points": [[1.5, 2.5], [3, 3], [4, 4]],
    }
    assert parsed(members[0])["obstacles"] == [ringed]
    assert parsed({"type": "Feature", "properties": None, "geometry": members[4]})["points"] == [[1.5, 2.5]]


@given(
    corners=st.lists(st.tuples(st.integers(-50, 50), st.integers(-50, 50)), min_size=3, max_size=6, unique=True),
    lines=st.lists(st.lists(st.tuples(st.floats(-9, 9), st.floats(-9, 9)), min_size=2, max_size=4), max_size=3),
    points=st.lists(st.tuples(st.floats(-9, 9), st.floats(-9, 9)), max_size=3),
)
def test_geometries_are_those_of_an_independent_reader(corners: Any, lines: Any, points: Any) -> None:
    hull = shapely.MultiPoint(corners).convex_hull
    shapes = [shapely.MultiLineString(lines), shapely.MultiPoint(points)]
    if isinstance(hull, shapely.Polygon):
        shapes.append(hull)
    text = shapely.to_geojson(shapely.GeometryCollection(shapes))
    found = parse_geojson(text, "file")
    theirs = shapely.from_geojson(text)
    ours = [
        shapely.MultiLineString(found.get("lines", [])),
        shapely.MultiPoint(found.get("points", [])),
        *(shapely.Polygon(ring) for ring in found["obstacles"]),
    ]
    for one, other in zip(ours, theirs.geoms, strict=True):
        assert shapely.equals_exact(shapely.normalize(one), shapely.normalize(other), 0.0)


def test_points_with_a_radius_are_discs() -> None:
    found = parsed(collection(feature("Point", [1, 2], radius=0.3), feature("MultiPoint", [[3, 4], [5, 6]], radius=1)))
    assert found["points"] == [[1, 2, 0.3], [3, 4, 1], [5, 6, 1]]


@pytest.mark.parametrize(
    ("heading", "radians"),
    [(1.5, 1.5), ("90deg", math.pi / 2), (" -45.5 deg", math.radians(-45.5)), ("180°", math.pi), (-7, -7)],
)
def test_headings_are_in_rad_or_in_degrees_that_say_so(heading: Any, radians: float) -> None:
    found = parsed(collection(feature("Point", [0, 0], role="start", heading=heading)))
    assert found["start"] == pytest.approx([0, 0, radians], abs=1e-12)


def test_a_goal_without_a_heading_is_free_and_several_are_goals() -> None:
    free = feature("Point", [1, 2], role="goal")
    assert parsed(collection(free))["goal"] == [1, 2, None]
    found = parsed(collection(free, GOAL))
    assert found["goals"] == [[1, 2, None], [18, 4, math.pi / 2]] and "goal" not in found


def test_members_mean_what_they_mean_in_json() -> None:
    members = {"name": "lot", "start": [1, 2, 3], "goal": [4, 5, None], "vehicle": {"width": 2}, "clearance": 0.1}
    assert parsed(collection(**members)) == {**members, "obstacles": []}


def test_ignored_and_unlocated_features_are_nothing() -> None:
    nowhere: dict[str, Any] = {"type": "Feature", "properties": {}, "geometry": None}
    assert parsed(collection(feature("Polygon", "scribble", role="ignore"), nowhere))["obstacles"] == []


def named(name: str) -> dict[str, Any]:
    return {"type": "name", "properties": {"name": name}}


@pytest.mark.parametrize(
    "name",
    [
        *("urn:ogc:def:crs:OGC:1.3:CRS84", "http://www.opengis.net/def/crs/OGC/1.3/CRS84"),
        *("urn:ogc:def:crs:EPSG::4326", "EPSG:4258", "urn:ogc:def:crs:EPSG:9.9.1:7844"),
    ],
)
def test_longitudes_and_latitudes_are_refused(name: str) -> None:
    with pytest.raises(ValueError, match="^crs: .* has longitudes and latitudes: export in metres"):
        parsed(collection(crs=named(name)))


def test_web_mercator_is_refused_and_metric_systems_are_not(caplog: pytest.LogCaptureFixture) -> None:
    with pytest.raises(ValueError, match="^crs: .* is Web Mercator, which stretches lengths"):
        parsed(collection(crs=named("urn:ogc:def:crs:EPSG::3857")))
    for crs in (named("urn:ogc:def:crs:EPSG::25832"), named("EPSG:32633"), None):
        parsed(collection(START, GOAL, crs=crs))
    assert not caplog.records
    parsed(collection(crs=named("local grid")))
    assert "is not known here: coordinates are taken as metres" in caplog.text


def test_a_map_smaller_than_a_car_raises_a_suspicion_only(caplog: pytest.LogCaptureFixture) -> None:
    plot = [[13.401, 52.501], [13.402, 52.501], [13.402, 52.502]]
    assert len(parsed(collection(feature("Polygon", [plot])))["obstacles"]) == 1
    assert "coordinates: the map is 0.001 x 0.001 m: are these degrees?" in caplog.text
    caplog.clear()
    parsed(collection(feature("Polygon", [BOX])))
    assert not caplog.records


BOW_TIE = [[0, 0], [4, 4], [4, 0], [0, 4]]
FAULTS: list[tuple[Any, str]] = [
    ([], "file: must be a GeoJSON object, not []"),
    ({}, "type: missing"),
    ({"type": 3}, "type: must be a text, not 3"),
    ({"type": "Topology"}, "type: must be a geometry of GeoJSON, not 'Topology'"),
    (collection(3), "features[0]: must be an object, not 3"),
    (collection({"type": "Point", "coordinates": [0, 0]}), "features[0].type: must be Feature, not 'Point'"),
    ({"type": "FeatureCollection"}, "features: must be a list, not None"),
    (collection(START, feature("Box", [])), "features[1].geometry.type: must be a geometry of GeoJSON, not 'Box'"),
    (collection(feature("Point", [0, "1"])), "features[0].geometry.coordinates[1]: must be a number, not '1'"),
    (collection(feature("Point", [0])), "features[0].geometry.coordinates: must be a position [x, y], not [0"),
    (
        collection(feature("Polygon", [[[0, 0], [1, 1], [0, 0]]])),
        "features[0].geometry.coordinates[0]: must have at le",
    ),
    (collection(feature("LineString", [[0, 0]])), "features[0].geometry.coordinates: must have at least 2 positions"),
    (collection(feature("Polygon", [BOW_TIE])), "features[0].geometry.coordinates: crosses itself"),
    (collection(feature("MultiPolygon", [[BOX], [BOX, BOW_TIE]])), "features[0].geometry.coordinates[1]: hole 1: cros"),
    (collection(feature("Point", [1, 1e13])), "features[0].geometry.coordinates[1]: must be finite and at most 1e+12"),
    (
        collection(feature("Point", [1, 1], radius=-1)),
        "features[0].properties.radius: must be 0 or more metres, not -1",
    ),
    (collection(feature("Point", [1, 1], role="gaol")), "features[0].properties.role: must be one of start, goal, bou"),
    (collection(feature("Polygon", [BOX], role="start")), "features[0].geometry.type: must be Point where the role is"),
    (collection(feature("Point", [1, 1], role="start")), "features[0].geometry.coordinates: a start needs the propert"),
    (collection(feature("Point", [1, 1], role="goal", heading="east")), "features[0].properties.heading: must be a nu"),
    (collection(feature("Polygon", [FRAME, BOX], role="bounds")), "features[0].geometry.coordinates: must be one ring"),
    (collection(START, START), "features[1].geometry.coordinates: is a second one; there can be one start"),
    (collection(START, start=[0, 0, 0]), "start: is given twice, as a member and by a feature's role"),
    (collection(GOAL, goals=[[0, 0, 0]]), "goals: is given twice"),
]


@pytest.mark.parametrize(("data", "message"), FAULTS, ids=[message for _, message in FAULTS])
def test_what_is_wrong_is_named(data: Any, message: str) -> None:
    with pytest.raises(ValueError) as raised:
        parsed(data)
    assert str(raised.value).startswith(message)


def test_poses_of_the_call_take_the_place_of_those_in_the_file(tmp_path: Path) -> None:
    path = tmp_path / "lot.geojson"
    path.write_text(json.dumps(collection(START, feature("Polygon", [BOX]))))
    assert Scenario.load(path, goal=(18, 4, 0)).goal.tolist() == [18, 4, 0]
    with pytest.raises(ValueError, match="goal: missing; where the file has none, give --goal X Y THETA"):
        Scenario.load(path)


def test_collections_may_not_be_nested_without_end() -> None:
    data: Any = {"type": "Point", "coordinates": [0, 0]}
    for _ in range(200):
        data = {"type": "GeometryCollection", "geometries": [data]}
    with pytest.raises(ValueError, match="^file: is nested too deeply"):
        parsed(data)
