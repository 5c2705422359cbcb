"""Walls without thickness, points, discs, holes and fences: what they keep the car from, exactly."""

import json
import logging
import math
from pathlib import Path

import numpy as np
import pytest
import shapely

from drake_gnnocp import Area, Scenario, Trajectory, Verification, plan, verify
from drake_gnnocp.pictures import plan_figure, save_replay
from drake_gnnocp.polygons import polygons_of, simple_polygons
from drake_gnnocp.scenario import ScenarioError
from drake_gnnocp.vehicle import Vehicle

ROUNDING = 1e-9
ROOM = [[-10.0, -10.0], [30.0, -10.0], [30.0, 12.0], [8.0, 12.0], [-10.0, 9.0]]


def straight(distance: float) -> Trajectory:
    """The car drives straight ahead from the origin and stops: a = cos-shaped, 201 knots over 20 s."""
    t = np.linspace(0.0, 20.0, 201)
    u = t / t[-1]
    a = distance * 6 * (1 - 2 * u) / t[-1] ** 2
    a[[0, -1]] = 0.0
    v = np.append(0.0, np.cumsum((a[1:] + a[:-1]) / 2 * np.diff(t)))
    a -= v[-1] / t[-1]  # at rest again
    a[[0, -1]] = 0.0
    v = np.append(0.0, np.cumsum((a[1:] + a[:-1]) / 2 * np.diff(t)))
    h = np.diff(t)
    x = np.append(0.0, np.cumsum(v[:-1] * h + (a[:-1] / 3 + a[1:] / 6) * h**2))
    zero = np.zeros_like(t)
    return Trajectory(t, np.column_stack([x, zero, zero, v, zero]), np.column_stack([a, zero]))


@pytest.mark.parametrize(
    ("thing", "clearance"),
    [
        ({"lines": [np.array([[4.0, 1.5], [9.0, 1.25]])]}, 0.3),
        ({"points": np.array([[7.0, 1.35, 0.0]])}, 0.4),
        ({"obstacles": [np.array([[7.0, 1.35], [8.0, 1.6], [7.0, 1.35]])]}, 0.4),  # no area
        ({"obstacles": [Area(np.array(ROOM), (np.array([[-9, -1.2], [29, -1.2], [29, 5], [-9, 5]]),))]}, 0.25),
        ({"bounds": np.array([[-9, -1.2], [29, -1.2], [29, 5], [-9, 6]])}, 0.25),
    ],
)
def test_the_check_knows_how_near_the_car_passes_them(thing: dict[str, object], clearance: float) -> None:
    scenario = Scenario("near", np.array([0.0, 0.0, 0.0]), straight(6.0).poses[-1], **thing)  # type: ignore[arg-type]
    found = verify(scenario, straight(6.0))
    assert found.verified
    assert clearance - 1e-3 <= least_of(found) <= clearance + ROUNDING


def least_of(verification: Verification) -> float:
    findings = {finding.what: finding.found for finding in verification.findings}
    texts = [findings.get("distance to obstacles", ""), findings.get("distance inside the bounds", "")]
    return min(float(text.split()[0]) for text in texts if text.endswith(" m"))


@pytest.mark.parametrize(
    ("thing", "is_bounds"),
    [
        ({"lines": [np.array([[6.5, 4.0], [6.5, 0.94], [9.0, 5.0]])]}, False),
        ({"points": np.array([[6.5, 0.0, 0.0]])}, False),
        ({"points": np.array([[6.5, 1.4, 0.46]])}, False),
        ({"bounds": np.array([[-9, -2], [6, -0.94], [29, -2], [29, 5], [-9, 5]])}, True),
        ({"bounds": np.array([[-9, -2], [5.9, -2], [6, 0.5], [6.1, -2], [29, -2], [29, 5], [-9, 5]])}, True),
    ],
)
def test_a_car_that_meets_them_is_refused_where_it_first_does(thing: dict[str, np.ndarray], is_bounds: bool) -> None:
    way = straight(9.0)
    scenario = Scenario("met", np.array([0.0, 0.0, 0.0]), way.poses[-1], **thing)  # type: ignore[arg-type]
    found = verify(scenario, way)
    assert not found.verified and not found.certified
    assert found.bounds_ok is not is_bounds and found.collision_free is is_bounds
    fault = found.first_fault
    assert fault is not None and 5.0 <= fault.x <= 7.0


def test_a_box_given_as_a_ring_is_a_box() -> None:
    ring = [[-9, -2], [29, -2], [29, 5], [-9, 5]]
    scenario = Scenario("box", np.array([0.0, 0.0, 0.0]), np.array([9.0, 0.0, 0.0]), bounds=ring)  # type: ignore[arg-type]
    assert scenario.bounds == (-9.0, 29.0, -2.0, 5.0)


def test_a_ring_without_area_is_a_line_and_says_so(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        scenario = Scenario(
            "line",
            np.array([0.0, 0.0, 0.0]),
            np.array([9.0, 0.0, 0.0]),
            obstacles=(np.array([[3.0, 3], [5, 5], [4, 4]]),),
        )
    assert "obstacles[0]: has no area: it is taken as a line" in caplog.text
    assert scenario.shapes.lines[0].equals(shapely.LineString([[3, 3], [5, 5]]))
    with pytest.raises(ScenarioError, match=r"start: the car collides with obstacles\[0\]"):
        Scenario(
            "line",
            np.array([0.0, 0.0, 0.0]),
            np.array([9.0, 0.0, 0.0]),
            obstacles=(np.array([[1.0, 0], [5, 5], [1, 0]]),),
        )


def test_discs_are_covered_and_hardly_more() -> None:
    scenario = Scenario(
        "disc", np.array([0.0, 0.0, 0.0]), np.array([9.0, 0.0, 0.0]), points=np.array([[5.0, 5.0, 2.0]])
    )
    corners = shapely.get_coordinates(scenario.shapes.polygons[0]) - (5.0, 5.0)
    middles = (corners[1:] + corners[:-1]) / 2
    assert np.linalg.norm(middles, axis=1) == pytest.approx(2.0)  # edges touch the circle from outside
    assert np.linalg.norm(corners, axis=1).max() <= 2.0 * 1.009


def test_the_planner_drives_around_walls_points_and_corners_of_a_fence() -> None:
    scenario = Scenario(
        "mixed",
        np.array([0.0, 0.0, 0.0]),
        np.array([20.0, 3.0, 0.5]),
        obstacles=(Area(np.array([[4.0, 5], [9, 5], [9, 9], [4, 9]]), (np.array([[5, 6], [8, 6], [8, 8], [5, 8]]),)),),
        bounds=np.array(ROOM),
        lines=(np.array([[9.0, -6.0], [9.0, 1.0]]),),
        points=np.array([[14.0, 2.0, 0.0], [14.0, -3.0, 0.5]]),
    )
    result = plan(scenario, max_seconds=20.0)
    assert result.verified and result.trajectory is not None
    poses = result.trajectory.resampled(2000).poses
    cars = shapely.polygons(scenario.vehicle.footprints(poses))
    assert shapely.contains_properly(shapely.Polygon(ROOM), cars).all()
    exact = [shapely.LineString([[9, -6], [9, 1]]), shapely.Point(14, 2), shapely.Point(14, -3).buffer(0.5)]
    assert all((shapely.distance(shape, cars) > 0).all() for shape in exact)


def test_a_slalom_among_points_is_driven_as_among_thin_posts() -> None:
    """It was not found: corners of the car were to keep 3.6 m away from points."""
    places = np.array([[7.0, 0.2], [12.0, -0.3], [17.0, 0.2]])
    plans = []
    for radius in (0.0, 0.01):
        posts = np.column_stack([places, np.full(len(places), radius)])
        plans.append(plan(Scenario("slalom", np.zeros(3), np.array([24.0, 0.0, 0.0]), points=posts)))
    points, thin = plans
    assert points.verified and thin.verified and len(points.attempts) == 1
    assert points.cost is not None and thin.cost is not None and points.cost.J < thin.cost.J


def test_a_closed_wall_without_thickness_is_no_path() -> None:
    wall = np.array([[7.0, -8.0], [20.0, -8.0], [20.0, 8.0], [7.0, 8.0], [7.0, -8.0]])
    result = plan(
        Scenario("shut", np.array([0.0, 0.0, 0.0]), np.array([12.0, 0.0, 0.0]), lines=(wall,)), max_seconds=20.0
    )
    assert result.status == "no_path" and result.no_path is not None and result.no_path.proven


def test_all_keys_come_back_from_a_file_as_they_were(tmp_path: Path) -> None:
    text = {
        "name": "all",
        "start": [0, 0, 0],
        "goal": [9, 0, 0],
        "obstacles": [
            [[4, 5], [9, 5], [9, 9]],
            {"ring": [[1, 5], [3, 5], [3, 9]], "holes": [[[2, 6], [2.5, 6], [2.5, 7]]]},
        ],
        "bounds": ROOM,
        "lines": [[[9, -6], [9, -2]]],
        "points": [[14, 2], [14, -3, 0.5]],
    }
    (tmp_path / "all.json").write_text(json.dumps(text))
    scenario = Scenario.load(tmp_path / "all.json")
    scenario.save(tmp_path / "again.json")
    again = Scenario.load(tmp_path / "again.json")
    assert again.to_dict() == scenario.to_dict()
    assert scenario.to_dict()["points"] == [[14, 2, 0], [14, -3, 0.5]] and scenario.to_dict()["bounds"] == ROOM
    assert scenario.shapes.polygons[1].area == pytest.approx(4.0 - 0.25)
    there_and_back = scenario.translated(1e6, -1e6).translated(-1e6, 1e6)
    assert there_and_back.to_dict()["lines"] == scenario.to_dict()["lines"]


def test_pictures_show_them(tmp_path: Path) -> None:
    scenario = Scenario(
        "drawn",
        np.array([0.0, 0.0, 0.0]),
        np.array([9.0, 0.0, 0.0]),
        bounds=np.array(ROOM),
        lines=(np.array([[9.0, -6.0], [9.0, -2.0]]),),
    )
    collections = plan_figure(scenario).axes[0].collections
    assert any(len(lines.get_segments()) == 1 for lines in collections if hasattr(lines, "get_segments"))
    save_replay(tmp_path / "replay.html", scenario, straight(9.0))
    assert (tmp_path / "replay.html").stat().st_size > 0


def test_many_rings_at_once_are_the_same_polygons_as_one_by_one() -> None:
    rng = np.random.default_rng(4)
    rings = [rng.uniform(-5, 5, (rng.integers(0, 7), 2)) for _ in range(300)]
    rings += [np.array([[0, 0], [1, 0], [1, 0], [0, 1.0]]), np.array([[0, 0], [0, 1], [1, 0.0]]), np.empty((0, 2))]
    plain = 0
    for ring, found in zip(rings, simple_polygons(rings), strict=True):
        try:
            expected = polygons_of(ring)
        except ValueError:
            assert found is None
            continue
        if found is not None:
            plain += 1
            assert len(expected) == 1 and shapely.equals_identical(found, expected[0])
    assert plain >= 50


def test_a_car_between_two_points_that_are_wide_enough_apart_gets_through() -> None:
    width = Vehicle().width
    gate = np.array([[8.0, width / 2 + 0.15, 0.0], [8.0, -width / 2 - 0.15, 0.0]])
    fence = np.array([[-9.0, -3], [25, -3], [25, 3], [-9, 3.001]])
    walls = (np.array([[8.0, 3.0], gate[0, :2]]), np.array([gate[1, :2], [8.0, -3.0]]))
    result = plan(
        Scenario("gate", np.array([0.0, 0.0, 0.0]), np.array([16.0, 0.0, 0.0]), bounds=fence, points=gate, lines=walls),
        max_seconds=20.0,
    )
    assert result.verified and result.verification is not None
    assert 0 < result.verification.min_clearance_m <= 0.15 + ROUNDING
    assert math.isfinite(result.verification.min_clearance_m)
