"""Convex parts of many polygons at once; covers of polygons, which planners take where there are many vertices."""

import numpy as np
import pytest
import shapely

from drake_gnnocp import Scenario, plan
from drake_gnnocp.blocked import FEW_VERTICES
from drake_gnnocp.convex import convex_parts, convex_parts_of, cover
from drake_gnnocp.maps.grid_outlines import outlines
from drake_gnnocp.maps.occupancy_grid import Grid

ROUNDING = 1e-8  # m


def wall_on_a_grid(angle: float, side: float) -> shapely.Polygon:
    """A wall of 6 m by 0.4 m at an angle, as the cells of a grid show it."""
    n = int(8 / side)
    x, y = (np.indices((n, n)) + 0.5).transpose(0, 2, 1) * side - 4.0
    along, across = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
    grid = Grid((np.abs(along) < 3.0) & (np.abs(across) < 0.2), side, np.array([-4.0, -4.0, 0.0]))
    return max(outlines(grid), key=lambda polygon: polygon.area)


def random_region(seed: int) -> list[shapely.Polygon]:
    """Polygons that do not touch, some with holes, of a grid whose cells are occupied at random."""
    occupied = np.random.default_rng(seed).random((24, 24)) < 0.6
    return list(outlines(Grid(occupied, 0.5, np.array([-6.0, 7.0, 0.3 * seed]))))


@pytest.mark.parametrize("seed", range(5))
def test_polygons_are_cut_into_convex_parts_that_cover_them_exactly_many_at_once_like_each_alone(seed: int) -> None:
    polygons = np.array(random_region(seed))
    assert len(polygons) > 5 and any(len(polygon.interiors) for polygon in polygons)
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(polygons))
    assert sum(map(len, convex_parts_of(polygons))) < 0.6 * len(triangles)
    for polygon, rings in zip(polygons, convex_parts_of(polygons), strict=True):
        alone = convex_parts(polygon)
        assert all(np.array_equal(one, other) for one, other in zip(rings, alone, strict=True))
        parts = np.array([shapely.Polygon(ring) for ring in rings])
        assert shapely.area(parts).sum() == pytest.approx(polygon.area) and all(part.exterior.is_ccw for part in parts)
        assert shapely.area(shapely.convex_hull(parts)) == pytest.approx(shapely.area(parts), abs=1e-9)
        assert shapely.symmetric_difference(shapely.union_all(parts), polygon).area < 1e-9
        corners = {tuple(corner) for corner in shapely.get_coordinates(polygon)}
        assert all(tuple(corner) in corners for ring in rings for corner in ring)  # no vertices are added


@pytest.mark.parametrize("angle", [0.0, 0.1, np.pi / 4, 1.0, 2.3])
@pytest.mark.parametrize("tolerance", [0.0, 0.02, 0.06])
def test_a_cover_is_outside_within_the_tolerance_and_has_fewer_vertices(angle: float, tolerance: float) -> None:
    polygon = wall_on_a_grid(angle, side=0.05)
    covering = cover(polygon, tolerance)
    assert covering.is_valid
    assert polygon.difference(covering.buffer(ROUNDING)).is_empty
    assert covering.hausdorff_distance(polygon) <= tolerance + ROUNDING
    if tolerance == 0.06 and angle:
        assert len(covering.exterior.coords) < 0.5 * len(polygon.exterior.coords)


def test_holes_become_smaller_and_may_close() -> None:
    ring = shapely.Polygon([(0, 0), (4, 0), (4, 4), (0, 4)], [[(1, 1), (3, 1), (3, 3), (2, 2.99), (1, 3)]])
    covering = cover(ring, 0.02)
    assert len(covering.interiors) == 1 and covering.area == pytest.approx(16 - 4 + 0.01)
    assert ring.difference(covering.buffer(ROUNDING)).is_empty


def jagged(side: float = 0.05) -> np.ndarray:
    return np.asarray(shapely.transform(wall_on_a_grid(1.0, side), lambda p: p + (9.0, 1.0)).exterior.coords)[:-1]


def test_planners_see_covers_away_from_the_ends_and_the_check_the_truth() -> None:
    wall = jagged()
    assert len(wall) > FEW_VERTICES
    scenario = Scenario("jagged", np.zeros(3), np.array([20.0, 0.0, 0.0]), (wall,))
    (covering,), (exact,) = scenario.blocked, scenario.blocked_exactly
    assert len(covering.exterior.coords) < 0.5 * len(wall)
    assert exact.equals(shapely.Polygon(wall)) and scenario.shapes.polygons[0].equals(exact)
    beside = np.array([exact.bounds[0] - 5.0, exact.bounds[1] + 1.0, 0.0])
    assert scenario.between(np.zeros(3), beside).blocked[0] is not exact  # still metres away
    reach = scenario.vehicle.wheelbase + scenario.vehicle.front_hang
    touching = np.array([shapely.Polygon(wall).bounds[0] - reach - 0.01, exact.exterior.coords[0][1], 0.0])
    lowest = min(exact.exterior.coords, key=lambda corner: corner[0])
    touching[1] = lowest[1]
    assert scenario.between(np.zeros(3), touching).blocked[0].equals(exact)


def test_a_task_whose_covers_close_the_way_is_planned_again_without() -> None:
    depth = 0.03  # of the notches in a passage that is as wide as the car and a little more
    x = np.linspace(4.0, 10.0, 121)
    edge = np.column_stack([x, np.where(np.arange(len(x)) % 2, 0.96, 0.96 + depth)])
    edge[0], edge[-1] = (4.0, 0.96), (10.0, 0.96)
    upper = np.vstack([edge, [[10.0, 9.0], [4.0, 9.0]]])
    task = Scenario("notched", np.array([-8.0, 0, 0]), np.array([22.0, 0, 0]), (upper, upper * (1, -1)))
    assert task.without_covers is not None and task.without_covers.without_covers is None
    assert all(one.equals(other) for one, other in zip(task.without_covers.blocked, task.blocked_exactly, strict=True))
    assert plan(task, max_seconds=30.0).verified
