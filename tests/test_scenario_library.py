"""The bundled scenarios: they load, have room at both ends, and are what their names promise."""

import json
from pathlib import Path

import numpy as np
import pytest
import shapely

import drake_gnnocp
from drake_gnnocp.convex import convex_parts
from drake_gnnocp.scenario import Scenario, bundled_scenarios
from drake_gnnocp.vehicle import Vehicle

FOLDER = Path(drake_gnnocp.__file__).parent / "scenarios"
REQUIRED = {
    *("map_a", "map_b", "map_c", "map_d", "perpendicular_in", "perpendicular_out", "parallel_in", "parallel_out"),
    *("angled_in", "angled_out", "dead_end_turn", "narrow_gate", "l_corridor", "thin_walls", "concave"),
    *("crowded_yard", "empty_field"),
}
END_CLEARANCE = 0.2  # m: an optimizer that keeps a margin of 0.1 m still has room at both ends
THIN = 0.1 + 1e-6  # m: walls are written in whole centimetres, their thickness carries rounding only
SLENDER = 20  # length of a wall over its thickness, at least
SHARED_AREA = 1e-9  # m^2: walls may touch, which costs rounding only
WALL = 1.0  # m: walls may stand around the bounds
DECIMALS = 2  # centimetres: the files are meant to be read


def clearance(scenario: Scenario, pose: np.ndarray) -> float:
    """Least distance from the car at a pose to any obstacle or to the bounds [m]."""
    car = shapely.Polygon(scenario.vehicle.footprints(pose)[0])
    distances = [car.distance(polygon) for polygon in scenario.polygons]
    if scenario.bounds is not None:
        xmin, xmax, ymin, ymax = scenario.bounds
        distances.append(shapely.box(xmin, ymin, xmax, ymax).exterior.distance(car))
    return min(distances, default=float("inf"))


def sides(ring: np.ndarray) -> np.ndarray:
    """Lengths of the edges of a ring [m]."""
    return np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1)


def test_the_library_has_the_required_scenarios() -> None:
    assert len(bundled_scenarios()) >= 14
    assert set(bundled_scenarios()) >= REQUIRED


@pytest.mark.parametrize("name", bundled_scenarios())
def test_loads_and_is_named_like_its_file(name: str) -> None:
    assert Scenario.load(name).name == name


@pytest.mark.parametrize("name", bundled_scenarios())
def test_start_and_goal_have_room(name: str) -> None:
    scenario = Scenario.load(name)
    assert clearance(scenario, scenario.start) >= END_CLEARANCE
    assert clearance(scenario, scenario.goal) >= END_CLEARANCE


@pytest.mark.parametrize("name", bundled_scenarios())
def test_obstacles_lie_within_the_bounds_and_do_not_overlap(name: str) -> None:
    scenario = Scenario.load(name)
    polygons = np.array(scenario.polygons, dtype=object)
    tree = shapely.STRtree(polygons)
    i, j = tree.query(polygons, predicate="intersects")
    overlaps = [polygons[a].intersection(polygons[b]).area for a, b in zip(i, j, strict=True) if a < b]
    assert sum(overlaps) < SHARED_AREA
    if scenario.bounds is not None:
        xmin, xmax, ymin, ymax = scenario.bounds
        yard = shapely.box(xmin - WALL, ymin - WALL, xmax + WALL, ymax + WALL)
        assert all(yard.contains(polygon) for polygon in scenario.polygons)


@pytest.mark.parametrize("name", bundled_scenarios())
def test_survives_the_round_trip_through_a_dictionary(name: str) -> None:
    scenario = Scenario.load(name)
    again = Scenario.from_dict(json.loads(json.dumps(scenario.to_dict())))
    assert again.to_dict() == scenario.to_dict()


@pytest.mark.parametrize("name", bundled_scenarios())
def test_files_are_readable(name: str) -> None:
    text = (FOLDER / f"{name}.json").read_text(encoding="utf-8")
    data = json.loads(text)
    vertices = np.array([vertex for ring in data["obstacles"] for vertex in ring]).reshape(-1, 2)
    np.testing.assert_array_equal(vertices, vertices.round(DECIMALS))
    first_vertices = [line for line in text.splitlines() if line.startswith("  [[")]
    assert len(first_vertices) == len(data["obstacles"])  # one obstacle a line


@pytest.mark.parametrize("name", sorted(REQUIRED))
def test_required_scenarios_use_the_vehicle_of_the_paper(name: str) -> None:
    assert Scenario.load(name).vehicle == Vehicle()


@pytest.mark.parametrize("name", ["map_a", "map_b"])
def test_maps_a_and_b_mix_rectangles_and_irregular_polygons_on_a_long_way(name: str) -> None:
    scenario = Scenario.load(name)
    assert np.linalg.norm(scenario.goal[:2] - scenario.start[:2]) >= 25.0
    corners = [len(ring) for ring in scenario.obstacles]
    assert corners.count(4) >= 4
    assert len(corners) - corners.count(4) >= 4
    straight = shapely.LineString([scenario.start[:2], scenario.goal[:2]]).buffer(scenario.vehicle.width / 2)
    assert any(straight.intersects(polygon) for polygon in scenario.polygons)  # obstacles are in the way


@pytest.mark.parametrize("name", ["map_c", "map_d"])
def test_maps_c_and_d_have_irregular_polygons_only(name: str) -> None:
    assert all(len(ring) >= 5 for ring in Scenario.load(name).obstacles)


def test_thin_walls_are_thin() -> None:
    rings = [np.asarray(ring) for ring in Scenario.load("thin_walls").obstacles]
    walls = [ring for ring in rings if sides(ring).min() <= THIN]
    assert len(walls) >= 5
    assert all(sides(wall).max() >= SLENDER * sides(wall).min() for wall in walls)


def test_the_yard_is_crowded() -> None:
    assert len(Scenario.load("crowded_yard").obstacles) >= 20


def test_the_goal_of_concave_lies_inside_a_concave_obstacle() -> None:
    scenario = Scenario.load("concave")
    concave = [polygon for polygon in scenario.polygons if len(convex_parts(polygon)) > 1]
    assert len(concave) >= 3
    assert any(polygon.convex_hull.contains(shapely.Point(scenario.goal[:2])) for polygon in concave)


def test_corridors_are_single_concave_polygons() -> None:
    for name in ("l_corridor", "dead_end_turn", "hammerhead_turn"):
        assert any(len(convex_parts(polygon)) > 1 for polygon in Scenario.load(name).polygons), name


def test_the_truck_is_longer_than_the_car() -> None:
    assert Scenario.load("truck_yard").vehicle.length > Vehicle().length + 2.0
