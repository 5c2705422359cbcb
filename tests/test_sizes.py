"""Sizes: what is far away changes nothing, and no array grows with the extent or the number of what is given."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from drake_gnnocp import CostWeights, Scenario, Vehicle, plan
from drake_gnnocp.budget import Budget
from drake_gnnocp.convex import MOST_VERTICES as MOST_OF_A_PART
from drake_gnnocp.convex import convex_parts
from drake_gnnocp.guesses.straight import straight_line
from drake_gnnocp.learning.scene import MOST_VERTICES, vectors_of
from drake_gnnocp.ocp.formulation import formulate
from drake_gnnocp.ocp.obstacles import MOST_OF_A_KNOT
from drake_gnnocp.pictures import save_replay
from drake_gnnocp.search import collision
from drake_gnnocp.search.collision import FootprintTest, Margins
from drake_gnnocp.search.distance_field import DistanceField
from drake_gnnocp.search.hybrid_astar import search
from drake_gnnocp.search.regions import search_regions

BLOCK = np.array([[7.0, -3.0], [9.0, -3.0], [9.0, 0.5], [7.0, 0.5]])
TASK = Scenario("task", np.zeros(3), np.array([15.0, 3.0, 0.0]), (BLOCK,))
SMALL_PAGE = 5e6  # bytes: most of it is Meshcat itself


def square(x: float, y: float, side: float) -> np.ndarray:
    return np.array([x, y]) + side * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def circle(n: int, radius: float = 5.0) -> np.ndarray:
    angle = np.linspace(0, 2 * np.pi, n, endpoint=False)
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


@pytest.mark.parametrize("size", [1e3, 1e9, 1e12])
def test_wide_bounds_change_neither_the_search_nor_the_plan(size: float) -> None:
    bounded = replace(TASK, bounds=(-size, size, -size, size))
    assert search_regions(bounded) == search_regions(TASK)
    one, other = plan(TASK).trajectory, plan(bounded).trajectory
    assert one is not None and other is not None
    np.testing.assert_array_equal(one.states, other.states)


def test_a_replay_of_a_wide_map_is_no_larger_than_others(tmp_path: Path) -> None:
    for size in (50.0, 1e7, 1e12):
        beside = square(-size, 9.0, 2 * size)
        save_replay(tmp_path / "replay.html", replace(TASK, bounds=(-size, size, -size, size)), None)
        save_replay(tmp_path / "beside.html", replace(TASK, obstacles=(beside,)), None)
        assert all(path.stat().st_size < SMALL_PAGE for path in tmp_path.iterdir())


def test_a_turning_circle_larger_than_the_map_is_searched() -> None:
    clumsy = Vehicle(phi_max=1e-3, wheelbase=20.0, width=1.0, front_hang=0.0, rear_hang=0.0)
    task = replace(TASK, vehicle=clumsy, goal=np.array([60.0, 0.0, 0.0]), obstacles=(BLOCK + [0.0, -3.0],))
    assert clumsy.turning_radius > 1e4
    found = search(task, Budget.of(5.0), first_stage=1)
    assert found.path is not None


def test_poses_are_tested_in_parts_with_the_same_outcome(monkeypatch: pytest.MonkeyPatch) -> None:
    region = (-10.0, 30.0, -10.0, 10.0)
    field = DistanceField.of(TASK.convex_obstacles, region, 0.3, 4.0)
    rng = np.random.default_rng(0)
    poses = rng.uniform([-10, -10, -3], [30, 10, 3], (500, 3))
    margins = Margins.of(TASK, 0.12)
    whole = FootprintTest(TASK, field, region, margins).collides(poses)
    monkeypatch.setattr(collision, "MOST_NUMBERS", 100)
    np.testing.assert_array_equal(FootprintTest(TASK, field, region, margins).collides(poses), whole)
    assert 0 < whole.sum() < len(poses)


@pytest.mark.parametrize("n", [MOST_OF_A_PART + 1, 2 * MOST_OF_A_PART - 1, 10_000])
def test_a_round_obstacle_is_cut_into_parts_of_few_vertices(n: int) -> None:
    polygon = shapely.Polygon(circle(n))
    parts = convex_parts(polygon)
    shapes = [shapely.Polygon(part) for part in parts]
    assert max(map(len, parts)) <= MOST_OF_A_PART and all(shape.is_valid for shape in shapes)
    assert sum(shape.area for shape in shapes) == pytest.approx(polygon.area, rel=1e-12)
    assert shapely.union_all(shapes).symmetric_difference(polygon).area < 1e-9
    if n < 1000:
        assert max(a.intersection(b).area for a, b in itertools.combinations(shapes, 2)) < 1e-12


def test_the_network_sees_few_vertices_of_a_large_ring() -> None:
    edges, mask = vectors_of(replace(TASK, obstacles=(circle(5000) + [5.0, -20.0],)))
    assert 16 <= mask.sum() < MOST_VERTICES
    edges = edges[:, mask[0]]
    np.testing.assert_array_equal(edges[0, :-1, 2:], edges[0, 1:, :2])  # still a closed ring
    np.testing.assert_array_equal(edges[0, -1, 2:], edges[0, 0, :2])


def test_a_knot_has_rows_for_the_nearest_of_very_many_obstacles() -> None:
    blocks = tuple(square(-3.0 + 0.05 * (i % 300), 1.5 + 0.05 * (i // 300), 0.04) for i in range(3 * MOST_OF_A_KNOT))
    task = replace(TASK, obstacles=blocks, goal=np.array([12.0, 0.0, 0.0]))
    formulation = formulate(task, straight_line(task, 10), CostWeights(), 0.1)
    footprints = task.vehicle.footprints(formulation.reference.poses)
    pairs = formulation.obstacles.pairs_within(footprints, formulation.reference.t, 2.5)
    counts = np.bincount(pairs.knot)
    assert counts.max() == MOST_OF_A_KNOT
    rows_of_blocks = np.unique(pairs.obstacle[pairs.knot == counts.argmax()] // 300)
    assert rows_of_blocks[0] == 0
