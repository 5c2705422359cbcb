"""Scenarios: JSON round trip, TPCAP files, poses at the limit, and maps far from the origin."""

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from drake_gnnocp.maps.tpcap import TPCAP_VEHICLE
from drake_gnnocp.scenario import Scenario, ScenarioError, bundled_scenarios
from drake_gnnocp.vehicle import Vehicle

TPCAP_FOLDER = Path(__file__).parents[2] / "shared" / "scenarios" / "tpcap"
TPCAP_CASES = {  # from the table of the folder's README: obstacles, vertices
    **{"Case1": (3, 12), "Case3": (3, 12), "Case5": (53, 212), "Case7": (3, 12), "Case9": (2, 8)},
    **{"Case11": (5, 25), "Case13": (4, 16), "Case15": (4, 16), "Case17": (10, 67), "Case19": (37, 353)},
}
EXACT = 1e-9  # m and m^2, rounding of sums of coordinates of order ten
SNAPPED = 2e-9  # m, by which outlines of obstacles that touch are moved
FAR = 1e9  # m, world coordinates: one ulp is 1.2e-7 m
FAR_ROUNDING = 1e-6  # m and m^2, a few such ulps

TRIANGLE = [[8.0, 8.0], [9.0, 8.0], [8.0, 9.0]]
NOTCHED = [[20, 20], [20, 24], [22, 21], [24, 24], [24, 20]]  # concave and clockwise


def task(**changes: Any) -> dict[str, Any]:
    """A legal scenario in the keys of the JSON format, with changes."""
    return {"name": "task", "start": [0, 0, 0], "goal": [12, 1, 7.5], "obstacles": [TRIANGLE, NOTCHED], **changes}


def test_a_file_gives_back_the_scenario_exactly(tmp_path: Path) -> None:
    vehicle = {"width": 2.0, "v_max": 1.5}
    given = Scenario.from_dict(
        task(start=[1 / 3, 2 / 7, math.pi], bounds=[-5, 30, -6.5, 31], vehicle=vehicle, clearance=0.2)
    )
    given.save(tmp_path / "task.json")
    read = Scenario.load(tmp_path / "task.json")
    assert read.to_dict() == given.to_dict()
    assert read.name == "task"
    assert read.bounds == (-5, 30, -6.5, 31)
    assert read.clearance == 0.2
    assert read.vehicle == Vehicle(width=2.0, v_max=1.5)
    np.testing.assert_array_equal(read.start, [1 / 3, 2 / 7, math.pi])
    np.testing.assert_array_equal(read.obstacles[1], NOTCHED)


def test_lists_and_integers_are_as_good_as_arrays(tmp_path: Path) -> None:
    given = Scenario("lists", [0, 0, 0], [12, 1, 7], [TRIANGLE], [-5, 30, -6, 31])  # type: ignore[arg-type]
    given.save(tmp_path / "lists.json")
    read = Scenario.load(tmp_path / "lists.json")
    assert read.to_dict() == given.to_dict()
    assert given.start.dtype == np.asarray(given.obstacles[0]).dtype == float and isinstance(given.bounds, tuple)
    assert given.translated(1.0, 2.0).start.tolist() == [1.0, 2.0, 0.0]


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"start": ["a", 0, 0]}, "start"),
        ({"goal": None}, "goal"),
        ({"obstacles": [[[8, 8], [9]]]}, r"obstacles\[0\]"),
        ({"obstacles": [[8, 8, 9]]}, r"obstacles\[0\]"),
        ({"bounds": [0, 1, 2]}, "bounds"),
    ],
)
def test_what_is_not_of_numbers_is_refused_by_name(changes: dict[str, Any], field: str) -> None:
    given = {"name": "task", "start": [0, 0, 0], "goal": [12, 1, 7], **changes}
    with pytest.raises(ScenarioError, match=f"^{field}: must be"):
        Scenario(**given)


def test_bounds_and_vehicle_may_be_left_out_or_null() -> None:
    for data in (task(), task(bounds=None, vehicle=None)):
        scenario = Scenario.from_dict(data)
        assert scenario.bounds is None
        assert scenario.vehicle == Vehicle()
        assert "bounds" not in scenario.to_dict()


def test_headings_beyond_pi_are_kept() -> None:
    assert Scenario.from_dict(task()).goal[2] == 7.5
    assert Scenario.from_dict(task(start=[0, 0, -20.0])).to_dict()["start"] == [0, 0, -20.0]


def test_a_file_may_begin_with_a_byte_order_mark_and_end_in_capitals(tmp_path: Path) -> None:
    path = tmp_path / "TASK.JSON"
    path.write_text(json.dumps(task()), encoding="utf-8-sig")
    assert Scenario.load(str(path)).name == "task"


def test_every_bundled_scenario_is_listed_and_loads_by_name() -> None:
    names = bundled_scenarios()
    assert names == sorted(names)
    assert "map_a" in names
    assert Scenario.load("map_a").name == "map_a"


def test_obstacles_are_exact_polygons_and_convex_parts() -> None:
    scenario = Scenario.from_dict(task())
    assert [polygon.area for polygon in scenario.polygons] == pytest.approx([0.5, 10.0])
    parts = shapely.union_all([shapely.Polygon(ring) for ring in scenario.convex_obstacles])
    assert len(scenario.convex_obstacles) == 4  # the notched one takes two cuts: any one leaves an angle above pi
    assert parts.symmetric_difference(shapely.union_all(scenario.polygons)).area < EXACT


def test_an_obstacle_that_touches_itself_gives_all_its_polygons() -> None:
    ring = [[20, 20], [22, 20], [21, 21], [22, 22], [20, 22], [21, 21]]
    assert [polygon.area for polygon in Scenario.from_dict(task(obstacles=[ring])).polygons] == [1, 1]


def test_translating_moves_everything_and_back_again() -> None:
    given = Scenario.from_dict(task(bounds=[-5, 30, -6, 31]))
    moved = given.translated(100, -50)
    np.testing.assert_allclose(moved.start, [100, -50, 0], atol=EXACT)
    np.testing.assert_allclose(moved.goal, [112, -49, 7.5], atol=EXACT)
    np.testing.assert_allclose(moved.obstacles[0], np.array(TRIANGLE) + [100, -50], atol=EXACT)
    assert moved.bounds == (95, 130, -56, -19)
    assert moved.vehicle == given.vehicle
    assert given.translated(1, 2).translated(-1, -2).to_dict() == given.to_dict()
    assert Scenario.from_dict(task()).translated(1, 2).bounds is None


def test_a_map_in_world_coordinates_keeps_its_shape() -> None:
    near = Scenario.from_dict(task(bounds=[-5, 30, -6, 31]))
    far = near.translated(FAR, -FAR)
    np.testing.assert_allclose([p.area for p in far.polygons], [p.area for p in near.polygons], rtol=FAR_ROUNDING)
    back = far.translated(-FAR, FAR)
    for ours, theirs in zip(back.obstacles, near.obstacles, strict=True):
        np.testing.assert_allclose(ours, theirs, atol=FAR_ROUNDING)


def test_a_collision_in_world_coordinates_is_found_to_the_micrometre() -> None:
    gap = 1e-5  # m, hundred ulps of the coordinates
    wall = np.array([[3.76, -5], [4.76, -5], [4.76, 5], [3.76, 5]]) + FAR  # the front bumper is at x + 3.76
    data = task(start=[FAR, FAR, 0], goal=[FAR - 20, FAR, 0])
    Scenario.from_dict({**data, "obstacles": [(wall + [gap, 0]).tolist()]})
    with pytest.raises(ScenarioError, match=r"^start: the car collides with obstacles\[0\]"):
        Scenario.from_dict({**data, "obstacles": [(wall - [gap, 0]).tolist()]})


def test_a_car_may_stand_exactly_on_the_bounds_and_is_not_refused_after_a_move() -> None:
    rng = np.random.default_rng(0)
    for x, y in np.round(rng.uniform(-50, 50, (300, 2)), 2):
        bounds = [x - 0.929, x + 10 + 3.76, y - 0.95, y + 0.95]
        scenario = Scenario.from_dict(task(start=[x, y, 0], goal=[x + 10, y, 0], obstacles=[], bounds=bounds))
        assert scenario.translated(-x, -y).bounds is not None


def test_a_car_may_not_touch_an_obstacle() -> None:
    rng = np.random.default_rng(0)
    for x, y in np.round(rng.uniform(-50, 50, (100, 2)), 2):
        wall = [[x + 3.76, y - 5], [x + 4, y - 5], [x + 4, y + 5], [x + 3.76, y + 5]]
        with pytest.raises(ScenarioError, match="^start: the car collides"):
            Scenario.from_dict(task(start=[x, y, 0], goal=[x - 20, y, 0], obstacles=[wall]))


def test_a_notch_is_free_though_its_hull_is_not() -> None:
    pocket = [[-5, -5], [15, -5], [15, 5], [-5, 5], [-5, 3], [13, 3], [13, -3], [-5, -3]]
    assert shapely.Polygon(pocket).convex_hull.contains(shapely.Point(0, 0))
    Scenario.from_dict(task(goal=[5, 0, 0], obstacles=[pocket]))


@pytest.mark.parametrize("pose", [np.zeros(2), np.array([0.0, math.nan, 0.0]), np.array([0.0, 0.0, math.inf])])
def test_a_pose_given_to_the_library_is_checked(pose: np.ndarray) -> None:
    with pytest.raises(ScenarioError, match="^goal: must be 3 finite numbers"):
        Scenario("task", np.zeros(3), pose)


def row_of(*rings: Sequence[Sequence[float]], start: str = "0,0,9.5", goal: str = "12,0,0") -> str:
    counts = [str(len(ring)) for ring in rings]
    vertices = [repr(float(value)) for ring in rings for vertex in ring for value in vertex]
    return ",".join([start, goal, str(len(rings)), *counts, *vertices])


def test_a_tpcap_file_is_read_with_the_competitions_vehicle(tmp_path: Path) -> None:
    path = tmp_path / "Case0.csv"
    path.write_text(row_of(TRIANGLE, NOTCHED))
    scenario = Scenario.load(path)
    assert scenario.name == "Case0"
    assert scenario.start.tolist() == [0, 0, 9.5]
    assert scenario.goal.tolist() == [12, 0, 0]
    assert [np.asarray(ring).tolist() for ring in scenario.obstacles] == [TRIANGLE, NOTCHED]
    assert scenario.bounds is None
    expected = {"width": 1.942, "v_max": 2.5, "a_max": 1.0, "phi_max": 0.75, "w_max": 0.5}
    assert scenario.vehicle == TPCAP_VEHICLE == Vehicle.from_dict(expected)


@pytest.mark.parametrize(
    "layout",
    [
        lambda row: row + "\n",
        lambda row: row + ",\r\n\r\n",
        lambda row: row.replace(",", ", "),
        lambda row: row.replace(",", ",\n", 8),
        lambda row: "\ufeff" + row,
    ],
)
def test_a_tpcap_row_may_be_spaced_broken_or_ended_by_a_comma(tmp_path: Path, layout: Any) -> None:
    path = tmp_path / "case.csv"
    path.write_text(layout(row_of(TRIANGLE)), encoding="utf-8", newline="")
    assert np.asarray(Scenario.load(path).obstacles[0]).tolist() == TRIANGLE


def test_a_tpcap_file_may_have_no_obstacles(tmp_path: Path) -> None:
    path = tmp_path / "case.csv"
    path.write_text(row_of())
    assert not len(Scenario.load(path).polygons)


@pytest.mark.skipif(not TPCAP_FOLDER.is_dir(), reason=f"the TPCAP cases are not at {TPCAP_FOLDER}")
@pytest.mark.parametrize("case", TPCAP_CASES)
def test_the_competitions_cases_are_read(case: str) -> None:
    scenario = Scenario.load(TPCAP_FOLDER / f"{case}.csv")
    assert (len(scenario.obstacles), sum(len(ring) for ring in scenario.obstacles)) == TPCAP_CASES[case]
    parts = shapely.union_all([shapely.Polygon(ring) for ring in scenario.convex_obstacles])
    assert shapely.hausdorff_distance(parts, shapely.union_all(scenario.polygons)) < SNAPPED


def test_what_has_loaded_is_not_refused_where_it_is_moved_to() -> None:
    slit = np.array([[0, 0], [4, 0], [4, 4], [2 + 4e-9, 4], [2 + 2e-9, 1], [2, 4], [0, 4]])  # 4 nm wide
    start, goal = np.array([-99.0, -100.0, 0.0]), np.array([-80.0, -100.0, 0.0])
    scenario = Scenario("thin", start, goal, (slit,), bounds=(-99.929, 20.0, -103.0, 10.0))  # touches the bounds
    for offset in (1e3, 1e9, 1e11):
        moved = scenario.translated(offset, -offset)
        assert len(moved.polygons) == len(scenario.polygons)
        assert len(moved.convex_obstacles) == len(scenario.convex_obstacles)
        assert np.isfinite(moved.end_clearances).all() and np.isfinite(moved.centroids).all()
