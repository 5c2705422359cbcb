"""Occupancy grids: polygons that cover exactly what is occupied, and scenarios of them.

`python tests/test_occupancy.py` prints how long it takes from the files of large maps to polygons.
"""

from __future__ import annotations

import math
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from PIL import Image

from drake_gnnocp import Scenario, plan
from drake_gnnocp.maps.grid_outlines import outlines
from drake_gnnocp.maps.occupancy_grid import Grid, grid_of_cells
from drake_gnnocp.maps.occupancy_map import read_map
from drake_gnnocp.scenario import Area, ScenarioError

EXACT = 1e-9  # m and m^2, rounding of coordinates of order ten
YAML = "image: {}\nresolution: 0.05\norigin: [-10.0, 5.0, 0.0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
WAREHOUSE = Path(__file__).parents[2] / "shared" / "scenarios" / "maps" / "warehouse.yaml"
AS_IT_IS = np.zeros(3)
BLACK, WHITE = 0, 254  # as map_saver writes what is occupied and free


def drawn(n: int, share: float, rng: np.random.Generator, specks: float = 0.002) -> np.ndarray:
    """A map (n, n) of walls, boxes and discs at any angle, and single cells, of which a share is occupied."""
    occupied = rng.random((n, n)) < specks
    occupied[[0, 1, -2, -1]] = occupied[:, [0, 1, -2, -1]] = True
    while occupied.mean() < share:
        centre, angle, kind = rng.uniform(0, n, 2), rng.uniform(0, np.pi), rng.integers(3)
        sizes = np.array([[n / 10, 0.8], [n / 25, n / 40], [n / 50, n / 50]])[kind] * rng.uniform(0.5, 2.0, 2)
        low, high = np.clip(np.array([centre - sizes.max() * 1.5, centre + sizes.max() * 1.5]), 0, n).astype(int)
        x, y = np.meshgrid(*(np.arange(low[i], high[i]) + 0.5 - centre[i] for i in range(2)))
        u, v = np.abs([x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)])
        shape = np.hypot(u, v) < sizes[0] if kind == 2 else (u < sizes[0]) & (v < sizes[1])
        occupied[low[1] : high[1], low[0] : high[0]] |= shape
    return occupied


def cells_by_sides(occupied: np.ndarray) -> int:
    """The number of regions whose cells are connected by sides."""
    left, n = {tuple(cell) for cell in np.argwhere(occupied).tolist()}, 0
    while left:
        n, todo = n + 1, [left.pop()]
        while todo:
            i, j = todo.pop()
            found = {(i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)} & left
            left -= found
            todo += found
    return n


def check_cover(grid: Grid) -> None:
    """Polygons are valid, cover the occupied cells and no part of others; their vertices are corners of cells."""
    polygons = np.array(outlines(grid), dtype=object)
    assert shapely.is_valid(polygons).all()
    assert len(polygons) == cells_by_sides(grid.occupied)
    cell = grid.resolution**2
    assert shapely.area(polygons).sum() == pytest.approx(cell * grid.occupied.sum(), abs=EXACT)
    y, x = np.indices(grid.occupied.shape).reshape(2, -1)
    centres = shapely.points(grid.in_world(np.column_stack([x, y]) + 0.5))
    inside, _ = shapely.STRtree(polygons).query(centres, predicate="within")
    assert sorted(inside.tolist()) == np.flatnonzero(grid.occupied).tolist()
    c, s = math.cos(grid.origin[2]), math.sin(grid.origin[2])
    for ring in shapely.get_rings(polygons):
        vertices = (shapely.get_coordinates(ring) - grid.origin[:2]) @ np.array([[c, -s], [s, c]]) / grid.resolution
        assert vertices == pytest.approx(np.round(vertices), abs=1e-6)
        sides = np.diff(np.round(vertices), axis=0)
        assert ((sides == 0).sum(axis=1) == 1).all()  # along the cells' sides
        assert (np.sum(sides * np.roll(sides, 1, axis=0), axis=1) == 0).all()  # and corners only


shapes = st.tuples(st.integers(1, 9), st.integers(1, 9))


@given(shapes.flatmap(lambda shape: arrays(bool, shape, fill=st.nothing())), st.sampled_from([0.0, 0.4, -2.5]))
def test_small_grids_are_covered_exactly(occupied: np.ndarray, yaw: float) -> None:
    check_cover(Grid(occupied, 0.25, np.array([3.0, -2.0, yaw])))


@pytest.mark.parametrize("share", [0.05, 0.1, 0.2])
@pytest.mark.parametrize("yaw", [0.0, 0.7])
def test_a_map_of_40_m_is_covered_exactly(share: float, yaw: float) -> None:
    check_cover(Grid(drawn(400, share, np.random.default_rng(3)), 0.1, np.array([-20.0, -20.0, yaw])))


def test_an_outline_has_its_corners_only() -> None:
    (ell,) = outlines(Grid(np.array([[1, 1, 1], [1, 0, 0]]), 2.0, np.array([10.0, 20.0, 0.0])))
    expected = shapely.Polygon([(10, 20), (16, 20), (16, 22), (12, 22), (12, 24), (10, 24)])
    assert ell.equals(expected)
    assert shapely.get_num_coordinates(ell) == 7


def test_a_ring_keeps_its_hole_and_what_lies_in_it() -> None:
    occupied = np.ones((7, 7), dtype=bool)
    occupied[1:6, 1:6] = False
    occupied[3, 3] = True
    ring, speck = sorted(outlines(Grid(occupied, 1.0, AS_IT_IS)), key=lambda polygon: -polygon.area)
    assert ring.equals(shapely.box(0, 0, 7, 7) - shapely.box(1, 1, 6, 6))
    assert speck.equals(shapely.box(3, 3, 4, 4))


def test_cells_that_touch_in_a_corner_are_polygons_of_their_own_without_a_gap() -> None:
    polygons = outlines(Grid(np.eye(6), 0.1, np.array([1 / 3, 2 / 7, 0.3])))
    assert len(polygons) == 6
    for one, other in zip(polygons, polygons[1:], strict=False):
        assert one.distance(other) == 0.0


@pytest.mark.parametrize("flip", [1, -1])
def test_a_pocket_behind_a_diagonal_contact_is_a_hole_that_touches_the_outside(flip: int) -> None:
    hook = np.array([[1, 1, 1], [1, 0, 1], [0, 1, 1]])[:, ::flip]  # the pocket is open at a point only
    (polygon,) = outlines(Grid(hook, 1.0, AS_IT_IS))
    assert polygon.is_valid
    assert [shapely.Polygon(hole).area for hole in polygon.interiors] == [1.0]
    assert shapely.Polygon(polygon.exterior).area == 8.0


def test_nobody_passes_a_thin_wall_at_any_angle() -> None:
    for angle in np.linspace(0.0, np.pi, 40):
        at = np.round(30 + np.outer(np.linspace(-50, 50, 2000), [np.cos(angle), np.sin(angle)])).astype(int)
        at = at[((at >= 0) & (at < 60)).all(axis=1)]
        occupied = np.zeros((60, 60))
        occupied[at[:, 1], at[:, 0]] = 1
        wall = shapely.union_all(outlines(Grid(occupied, 1.0, AS_IT_IS)))
        assert len(shapely.get_parts(shapely.box(0, 0, 60, 60) - wall)) >= 2


def test_nothing_occupied_has_no_polygons_and_all_of_it_has_one() -> None:
    assert outlines(Grid(np.zeros((3, 4)), 0.1, AS_IT_IS)) == []
    (everything,) = outlines(Grid(np.ones((3, 4)), 0.5, AS_IT_IS))
    assert everything.equals(shapely.box(0, 0, 2, 1.5))


def test_noise_without_end_is_refused() -> None:
    checkered = np.indices((2300, 1200)).sum(axis=0) % 2 == 0
    with pytest.raises(ValueError, match="^cells: what is occupied has 5520000 corners"):
        outlines(Grid(checkered, 0.1, AS_IT_IS))


def test_a_grid_that_is_turned_lies_where_its_origin_says() -> None:
    occupied = np.zeros((2, 3), dtype=bool)
    occupied[0, 2] = True  # from (1, 0) to (1.5, 0.5) before it is turned by 90 degrees
    grid = Grid(occupied, 0.5, np.array([10.0, 20.0, math.pi / 2]))
    (polygon,) = outlines(grid)
    assert polygon.bounds == pytest.approx((9.5, 21.0, 10.0, 21.5), abs=EXACT)
    assert np.asarray(grid.bounds) == pytest.approx(np.array([[10, 20], [10, 21.5], [9, 21.5], [9, 20]]), abs=EXACT)


def test_the_rectangle_of_a_grid_that_is_not_turned_is_a_box() -> None:
    assert Grid(np.zeros((2, 3)), 0.5, np.array([10.0, -20.0, 0.0])).bounds == (10.0, 11.5, -20.0, -19.0)


def test_cells_of_per_cent_are_occupied_from_65_on() -> None:
    cells = np.array([[-1, 0, 64], [65, 66, 100]], dtype=np.int8)
    assert grid_of_cells(cells, 0.1, (0, 0, 0)).occupied.tolist() == [[True, False, False], [True, True, True]]
    free = grid_of_cells(cells, 0.1, (0, 0), unknown="free", occupied_thresh=0.66)
    assert free.occupied.tolist() == [[False, False, False], [False, True, True]]
    assert grid_of_cells(np.array([[54, 55]]), 0.1, (0, 0), occupied_thresh=0.55).occupied.tolist() == [[False, True]]
    assert grid_of_cells(cells > 0, 0.1, (0, 0)).occupied.tolist() == (cells > 0).tolist()


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"cells": np.array([[0, 254]])}, "cells: must be whole numbers"),
        ({"cells": np.array([[0.0, math.nan]])}, "cells: must be whole numbers"),
        ({"cells": np.zeros(4)}, "cells: must be rows and columns"),
        ({"cells": np.zeros((0, 4))}, "cells: must be rows and columns"),
        ({"cells": np.array([["#"]])}, "cells: must be rows and columns"),
        ({"resolution": -0.1}, "resolution"),
        ({"resolution": "fine"}, "resolution"),
        ({"origin": (0.0, math.nan, 0.0)}, "origin"),
        ({"origin": (0.0,)}, "origin"),
        ({"unknown": "black"}, "unknown"),
        ({"occupied_thresh": 65}, "occupied_thresh"),
    ],
)
def test_illegal_grids_are_refused_by_name(changes: dict[str, object], field: str) -> None:
    given = {"cells": np.zeros((2, 2), dtype=int), "resolution": 0.1, "origin": (0.0, 0.0, 0.0)} | changes
    with pytest.raises(ValueError, match=f"^{field}"):
        grid_of_cells(**given)  # type: ignore[arg-type]


@pytest.mark.parametrize("yaw", [0.0, 0.3])
def test_a_scenario_of_a_grid_covers_the_same_with_holes_and_stays_inside(yaw: float, tmp_path: Path) -> None:
    occupied = np.zeros((60, 80), dtype=bool)
    occupied[[0, -1]] = occupied[:, [0, -1]] = True  # a wall all around: a polygon with a hole
    occupied[30:33, 40:60] = True
    origin = np.array([-10.0, -8.0, yaw])
    start = np.append(Grid(occupied, 0.5, origin).in_world(np.array([[10.0, 10.0]]))[0], yaw)
    goal = np.append(Grid(occupied, 0.5, origin).in_world(np.array([[60.0, 45.0]]))[0], yaw)
    scenario = Scenario.from_occupancy(occupied, 0.5, origin, start, goal, clearance=0.1)
    assert (scenario.name, scenario.clearance) == ("map", 0.1)
    assert [type(obstacle) for obstacle in scenario.obstacles] == [Area, np.ndarray]
    assert shapely.area(scenario.shapes.polygons).sum() == pytest.approx(0.25 * occupied.sum(), abs=EXACT)
    assert isinstance(scenario.bounds, np.ndarray if yaw else tuple)
    scenario.save(tmp_path / "map.json")
    assert Scenario.load(tmp_path / "map.json").to_dict() == scenario.to_dict()
    free = np.zeros((60, 80), dtype=np.int8)
    with pytest.raises(ScenarioError, match="^goal: the car leaves the bounds"):
        Scenario.from_occupancy(free, 0.5, origin, start, start + [0.0, -6.0, 0.0])


@pytest.mark.parametrize(
    ("unknown", "end", "said"),
    [
        ("occupied", (30.0, 10.0, 0.0), "goal: the car collides with an occupied (or unknown) cell near (29.07, 9.05)"),
        ("occupied", (13.4, 10.0, 0.0), "goal: the car collides with an occupied (or unknown) cell near (17.00, 9.50)"),
        ("free", (17.5, 10.0, 0.0), "goal: the car collides with an occupied cell near (17.00, 9.50)"),
    ],
)
def test_a_car_that_stands_on_cells_is_refused_with_their_place(
    unknown: str, end: tuple[float, float, float], said: str
) -> None:
    cells = np.zeros((40, 80), dtype=np.int8)
    cells[19:21, 34:36] = 100
    cells[:, 50:] = -1
    with pytest.raises(ScenarioError) as refusal:
        Scenario.from_occupancy(cells, 0.5, (0, 0), (3.0, 10.0, 0.0), end, unknown=unknown)
    assert str(refusal.value) == said


def test_a_plan_among_the_cells_of_a_map_is_verified_and_touches_none() -> None:
    pixels = drawn(400, 0.0, np.random.default_rng(0), specks=0.0)
    pixels[100:300, 195:200] = True  # a wall, a block that is turned, and single cells
    y, x = np.indices(pixels.shape) + 0.5
    pixels |= (np.abs(x + y - 560) < 40) & (np.abs(x - y) < 30)
    pixels[np.arange(80, 120), np.arange(240, 280)] = True
    cells = np.where(pixels, 100, 0).astype(np.int8)
    scenario = Scenario.from_occupancy(cells, 0.1, (-20.0, -20.0), (-12.0, 0.0, 1.2), (12.0, -3.0, -1.0))
    result = plan(scenario)
    assert result.verified and result.trajectory is not None
    cars = shapely.polygons(scenario.vehicle.footprints(result.trajectory.poses))
    occupied = np.argwhere(pixels)[:, ::-1] * 0.1 - 20.0
    assert not len(
        shapely.STRtree(shapely.box(*occupied.T, *(occupied + 0.1).T)).query(cars, predicate="intersects")[0]
    )


def test_the_outline_of_a_noisy_grid_warns_of_nothing() -> None:
    cells = "2 19 33 14 35 19 36 18 36 19 37 17 37 19 38 17 38 18 38 19 39 17 40 17 41 0 41 14 41 15 41 16 41 17"
    occupied = np.zeros((42, 20), dtype=bool)
    occupied[tuple(np.array(cells.split(), dtype=int).reshape(-1, 2).T)] = True  # GEOS divides by zero
    scenario = Scenario.from_occupancy(occupied, 0.05, (0, 0), (-20, 4, 0), (-40, 4, 0), bounds=None)
    outline = shapely.union_all(shapely.polygonize(shapely.get_parts(scenario.outline)))
    assert outline.buffer(EXACT).covers(shapely.union_all(scenario.shapes.polygons))


@pytest.mark.skipif(not WAREHOUSE.is_file(), reason=f"there is no {WAREHOUSE}")
def test_a_warehouse_is_read() -> None:
    scenario = Scenario.load(WAREHOUSE, start=(-5.0, 4.0, 0.0), goal=(1.0, -12.0, -math.pi / 2))
    grid = read_map(WAREHOUSE)
    assert (scenario.name, grid.occupied.shape, grid.resolution) == ("warehouse", (1674, 1006), 0.03)
    assert scenario.bounds == pytest.approx((-15.1, -15.1 + 1006 * 0.03, -25.0, -25.0 + 1674 * 0.03))
    assert shapely.area(scenario.shapes.polygons).sum() == pytest.approx(0.03**2 * grid.occupied.sum())


def main() -> None:
    """Print the seconds from the files of maps of 2,000 x 2,000 cells to polygons, and the numbers of these."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "map.yaml"
        for share, specks in ((0.05, 0.002), (0.1, 0.002), (0.2, 0.002), (0.2, 0.02)):
            pixels = np.where(drawn(2000, share, np.random.default_rng(1), specks)[::-1], BLACK, WHITE)
            for suffix in ("pgm", "png"):
                Image.fromarray(pixels.astype(np.uint8)).save(path.with_suffix(f".{suffix}"))
                path.write_text(YAML.format(f"map.{suffix}"))
                begin = time.perf_counter()
                polygons = outlines(read_map(path))
                seconds = time.perf_counter() - begin
                vertices = shapely.get_num_coordinates(polygons).sum() - len(shapely.get_rings(polygons))
                print(f"{share:.0%} occupied, {specks:.1%} specks, {suffix}: {seconds:.3f} s, ", end="")
                print(f"{len(polygons)} polygons, {vertices} vertices")


if __name__ == "__main__":
    main()
