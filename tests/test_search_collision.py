"""The searches' collision test against shapely, and the guarantees between samples."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from drake_gnnocp.scenario import Scenario
from drake_gnnocp.search.collision import FootprintTest, Margins, sweep
from drake_gnnocp.search.distance_field import DistanceField
from drake_gnnocp.vehicle import Vehicle

REGION = (-20.0, 20.0, -20.0, 20.0)
FAR = np.array([-200.0, -200.0, 0.0])  # scenarios must have free ends: here they are away from everything
UNDECIDED = 1e-9  # m, nearer to contact than this the two tests may round differently
CUT_OFF = 3.0  # m


def test_of(rings: list[np.ndarray], margin: float = 0.0) -> tuple[FootprintTest, Scenario]:
    scenario = Scenario("test", FAR, FAR, tuple(rings))
    field = DistanceField.of(scenario.convex_obstacles, REGION, 0.2, CUT_OFF)
    return FootprintTest(scenario, field, REGION, Margins(margin, margin, margin, 1.0)), scenario


test_of.__test__ = False  # type: ignore[attr-defined]


def box(cx: float, cy: float, width: float, height: float) -> np.ndarray:
    return np.array([cx, cy]) + np.array([[-width, -height], [width, -height], [width, height], [-width, height]]) / 2


def star(rng: np.random.Generator) -> np.ndarray:
    """A random, mostly concave polygon of either orientation."""
    n = int(rng.integers(3, 10))
    angles = (np.arange(n) + rng.uniform(0.1, 0.9, n)) * 2 * math.pi / n
    ring = rng.uniform(-12, 12, 2) + rng.uniform(0.3, 5.0, n)[:, None] * np.stack([np.cos(angles), np.sin(angles)], 1)
    return ring[:: rng.choice([-1, 1])]


def grown(vehicle: Vehicle, poses: np.ndarray, margin: float) -> np.ndarray:
    """Shapely rectangles of the car grown by a margin on all sides."""
    corners = vehicle.corners + margin * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    x = poses[:, :1] + cos[:, None] * corners[:, 0] - sin[:, None] * corners[:, 1]
    y = poses[:, 1:2] + sin[:, None] * corners[:, 0] + cos[:, None] * corners[:, 1]
    return np.asarray(shapely.polygons(np.stack([x, y], axis=-1)))


@pytest.mark.parametrize("margin", [0.0, 0.15])
@pytest.mark.parametrize("seed", range(6))
def test_agrees_with_shapely_on_random_poses_among_random_polygons(seed: int, margin: float) -> None:
    rng = np.random.default_rng(seed)
    test, scenario = test_of([star(rng) for _ in range(10)], margin)
    poses = np.column_stack([rng.uniform(-14, 14, (2000, 2)), rng.uniform(-7, 7, 2000)])
    cars = grown(scenario.vehicle, poses, margin)
    obstacles = shapely.union_all(list(scenario.polygons))
    expected = shapely.intersects(obstacles, cars)
    overlap = shapely.area(shapely.intersection(obstacles, cars))
    decided = np.where(expected, overlap, shapely.distance(obstacles, cars)) > UNDECIDED
    assert 0.2 < expected.mean() < 0.9  # both answers are asked for
    np.testing.assert_array_equal(test.collides(poses)[decided], expected[decided])


def test_edges_that_cross_without_a_vertex_inside_collide() -> None:
    test, _ = test_of([box(1.0, 0.0, 0.05, 12.0)])  # a thin wall right across the car
    assert test.collides(np.zeros((1, 3)))[0]
    assert not test.collides(np.array([[2.0, 0.0, 0.0]]))[0]


def test_car_completely_inside_a_polygon_collides() -> None:
    test, _ = test_of([box(0.0, 0.0, 15.0, 15.0)])
    assert test.collides(np.array([[0.0, 0.0, 0.3], [-1.0, 2.0, 4.0]])).all()


def test_obstacle_completely_inside_the_car_collides() -> None:
    test, _ = test_of([box(1.4, 0.3, 0.01, 0.01)])
    assert test.collides(np.zeros((1, 3)))[0]


def test_mouth_of_a_concave_polygon_is_free() -> None:
    outside = [[-3.0, -3.0], [6.0, -3.0], [6.0, 3.0], [-3.0, 3.0]]
    mouth = [[-3.0, 2.0], [5.0, 2.0], [5.0, -2.0], [-3.0, -2.0]]
    test, _ = test_of([np.array([*outside, *mouth])])
    inside_the_mouth, across_an_arm = [0.0, 0.0, 0.0], [0.0, 0.0, math.pi / 2]
    np.testing.assert_array_equal(test.collides(np.array([inside_the_mouth, across_an_arm])), [False, True])


def test_footprint_must_stay_inside_the_region_and_may_touch_its_rim() -> None:
    test, scenario = test_of([])
    ahead = scenario.vehicle.wheelbase + scenario.vehicle.front_hang
    limit = 20.0 - ahead
    poses = np.array([[limit, 0.0, 0.0], [limit + 1e-6, 0.0, 0.0], [0.0, limit + 0.01, math.pi / 2]])
    np.testing.assert_array_equal(test.collides(poses), [False, True, True])


def test_margin_gives_way_around_an_end_with_little_clearance() -> None:
    start = np.zeros(3)
    wall = box(0.0, 0.95 + 0.1 + 0.5, 40.0, 1.0)  # 0.1 m beside the car
    scenario = Scenario("test", start, np.array([12.0, -5.0, 0.0]), (wall,))
    margins = Margins.of(scenario, 0.15)
    assert margins.start == pytest.approx(0.05)
    assert margins.goal == 0.15
    test = FootprintTest(scenario, DistanceField.of((wall,), REGION, 0.2, CUT_OFF), REGION, margins)
    np.testing.assert_array_equal(test.collides(np.array([start, [12.0, 0.0, 0.0]])), [False, True])


def test_clearance_is_infinite_without_obstacles() -> None:
    assert Scenario("test", FAR, FAR).nearest_at_ends.tolist() == [math.inf, math.inf]


def test_no_point_of_the_car_outruns_the_margin_between_two_tested_poses() -> None:
    test, scenario = test_of([], margin=0.12)
    vehicle, half_step = scenario.vehicle, 0.5 * test.spacing
    for curvature in (1.0, -1.0, 0.3, 0.0):
        for s in (half_step, -half_step):
            turn = curvature / vehicle.turning_radius * s
            moved = vehicle.footprints(np.array([s * np.sinc(turn / math.pi), 0.5 * turn * s, turn]))[0]
            assert np.linalg.norm(moved - vehicle.corners, axis=1).max() <= 0.12
    assert sweep(vehicle) > 1.0


def test_distance_field_bounds_the_distance_from_both_sides() -> None:
    rng = np.random.default_rng(7)
    scenario = Scenario("test", FAR, FAR, tuple(star(rng) for _ in range(8)))
    field = DistanceField.of(scenario.convex_obstacles, REGION, 0.2, CUT_OFF)
    points = rng.uniform(-20, 20, (5000, 2))
    exact = np.minimum(shapely.distance(shapely.union_all(list(scenario.polygons)), shapely.points(points)), CUT_OFF)
    assert np.abs(field.at(points[:, 0], points[:, 1]) - exact).max() <= field.half_diagonal + UNDECIDED
