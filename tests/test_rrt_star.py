"""RRT*: what its path promises, the poses made of it, and what happens without OMPL."""

import itertools
import math
import sys
from pathlib import Path

import numpy as np
import pytest
import shapely

from drake_gnnocp import Scenario, Vehicle, plan
from drake_gnnocp.budget import Budget
from drake_gnnocp.command_line import main
from drake_gnnocp.guesses import Guess, RrtStar
from drake_gnnocp.search.polyline import geared
from drake_gnnocp.search.regions import search_regions
from drake_gnnocp.search.rrt_star import END_RADIUS, _Lines, rrt_star_path

EXACT = 1e-9  # m and rad, sums of a few doubles of size 10
TOUCH = 1e-6  # m: swept areas are shrunk by this, so that touching does not count
CLIPPED = 0.05  # m^2: shapely's circles are polygons, and leave centimetres of a line that the search does not test
LATE = 20  # looks at the clock after the budget is over: each of four searches takes a few
UNLIMITED = Budget.unlimited()
WALL = [[10, -6], [12, -6], [12, 8], [10, 8]]
VEHICLE = Vehicle()

pytest.importorskip("ompl", reason="the search is OMPL's")


@pytest.fixture
def behind_a_wall() -> Scenario:
    return Scenario("wall", np.zeros(3), np.array([22.0, 0.0, 0.0]), (np.array(WALL, dtype=float),))


@pytest.fixture
def walled_in() -> Scenario:
    """A goal inside a closed ring of walls."""
    boxes = [(10, -6, 22, -5), (10, 5, 22, 6), (10, -5, 11, 5), (21, -5, 22, 5)]
    rings = tuple(np.array(shapely.box(*box).exterior.coords[:-1]) for box in boxes)
    return Scenario("walled_in", np.zeros(3), np.array([14.0, 0.0, 0.0]), rings)


def middle(pose: np.ndarray) -> np.ndarray:
    return VEHICLE.footprints(pose)[0].mean(axis=0)


@pytest.mark.parametrize("name", ["wall", "map_a", "narrow_gate"])
def test_the_path_joins_the_ends_and_the_car_fits_along_it(name: str, behind_a_wall: Scenario) -> None:
    scenario = behind_a_wall if name == "wall" else Scenario.load(name)
    path = rrt_star_path(scenario, UNLIMITED, seed=3)
    assert path is not None
    np.testing.assert_allclose(path[0], middle(scenario.start), atol=EXACT)
    np.testing.assert_allclose(path[-1], middle(scenario.goal), atol=EXACT)
    ends = shapely.MultiPoint(path[[0, -1]]).buffer(END_RADIUS)
    blocked = shapely.union_all(list(scenario.polygons))
    for a, b in zip(path[:-1], path[1:], strict=True):
        line = shapely.LineString([a, b])
        assert line.distance(blocked) > VEHICLE.width / 2 - TOUCH
        away = shapely.get_parts(line.difference(ends))
        for part in away[~shapely.is_empty(away)]:  # there the whole car fits along the line
            p, q = np.array(part.coords)[[0, -1]]
            ahead = (q - p) / part.length * VEHICLE.length / 2
            swept = shapely.LineString([p - ahead, q + ahead]).buffer(VEHICLE.width / 2, cap_style="flat")
            assert swept.intersection(blocked).area < CLIPPED


def test_a_line_is_as_long_as_the_car_that_drives_it(behind_a_wall: Scenario) -> None:
    above, region = np.array([11.0, 20.0]), (-30.0, 50.0, -30.0, 30.0)  # the wall's top is at y = 8
    for disc_radius, distance, is_free in (
        (5.0, 1.5, False),
        (5.0, 2.4, True),
        (math.inf, 1.5, True),
        (math.inf, 0.9, False),
    ):
        lines = _Lines(behind_a_wall, region, disc_radius)
        below = np.array([11.0, 8.0 + distance])
        assert lines.is_free(above, below) == lines.is_free(below, above) == is_free
    assert not _Lines(behind_a_wall, (-30.0, 50.0, -30.0, 22.0), 5.0).is_free(above, np.array([11.0, 14.0]))


def test_the_path_has_no_corner_that_a_free_line_leaves_out(behind_a_wall: Scenario) -> None:
    path = rrt_star_path(behind_a_wall, UNLIMITED, seed=3)
    assert path is not None
    lines = _Lines(behind_a_wall, search_regions(behind_a_wall)[0], END_RADIUS)
    assert not any(lines.is_free(a, b) for a, b in zip(path, path[2:], strict=False))


def test_bends_that_the_rectangle_does_not_get_around_are_taken_with_the_disc() -> None:
    path = rrt_star_path(Scenario.load("l_corridor"), UNLIMITED, seed=3)
    assert path is not None


def test_the_same_seed_gives_the_same_path_and_another_one_another(behind_a_wall: Scenario) -> None:
    first, again, other = (rrt_star_path(behind_a_wall, UNLIMITED, seed) for seed in (1, 1, 2))
    assert first is not None and other is not None
    np.testing.assert_array_equal(first, again)
    assert first.shape != other.shape or not np.array_equal(first, other)


def test_the_guess_has_exact_ends_at_rest_and_plans_to_a_verified_plan(behind_a_wall: Scenario) -> None:
    guess = next(RrtStar(knots=120).guesses(behind_a_wall, UNLIMITED))
    assert isinstance(guess, Guess) and len(guess.trajectory) == 120
    np.testing.assert_allclose(guess.trajectory.states[0], 0.0, atol=EXACT)
    np.testing.assert_allclose(guess.trajectory.states[-1], [22.0, 0.0, 0.0, 0.0, 0.0], atol=EXACT)
    result = plan(behind_a_wall, "rrt_star")
    assert result.verified and {attempt.source for attempt in result.attempts} == {"rrt_star"}


def test_gears_follow_the_headings_of_the_ends() -> None:
    # into a slot across the way: forwards past it, then backwards into it
    start, goal = np.zeros(3), np.array([6.0, -8.0, math.pi / 2])
    line = np.array([middle(start), [7.0, 0.0], middle(goal)])
    path = geared(line, start, goal, VEHICLE)
    np.testing.assert_array_equal(np.unique(path.gears), [-1, 1])
    assert path.gears[0] == 1 and path.gears[-1] == -1
    np.testing.assert_allclose(path.poses[[0, -1]], [start, goal], atol=EXACT)
    # straight back is driven backwards
    back = geared(np.array([middle(start), [-10.0, 0.0]]), start, np.array([-11.4, 0.0, 0.0]), VEHICLE)
    assert (back.gears == -1).all()
    np.testing.assert_allclose(back.poses[:, 2], 0.0, atol=EXACT)


def test_corners_are_rounded_and_headings_continuous() -> None:
    start, goal = np.zeros(3), np.array([10.0, 10.0, math.pi / 2])
    path = geared(np.array([middle(start), [10.0, 0.0], middle(goal)]), start, goal, VEHICLE)
    assert (path.gears == 1).all()
    assert np.abs(np.diff(path.poses[:, 2])).max() < 0.1  # rad, a quarter turn in 3 m is 0.05 in 10 cm
    assert np.linalg.norm(np.diff(path.poses[:, :2], axis=0), axis=1).max() < 0.4


def test_standing_still_is_a_path() -> None:
    pose = np.array([1.0, 2.0, 0.3])
    path = geared(np.array([middle(pose), middle(pose)]), pose, pose + (0, 0, 2 * math.pi), VEHICLE)
    np.testing.assert_allclose(path.poses, [pose, pose], atol=EXACT)


def test_no_way_is_a_reason_and_no_other_guess_steps_in(walled_in: Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
    for proof in ("no_passage", "no_path"):  # as where there is no way, and that cannot be proven
        monkeypatch.setattr(f"drake_gnnocp.planner.one_goal.{proof}", lambda _: None)
    result = plan(walled_in, "rrt_star", max_seconds=2.0)
    attempt, shown = result.attempts
    assert result.status == "failed" and attempt.source == "rrt_star" and attempt.reason.startswith("RRT*: ")
    assert shown.reason.startswith("not solved") and result.guess is shown.start


@pytest.mark.parametrize("looks", [0, 10, 1000])
def test_the_search_ends_with_its_budget(walled_in: Scenario, looks: int) -> None:
    instants = itertools.count(1)  # a clock that moves on at every look
    assert rrt_star_path(walled_in, Budget(looks, instants.__next__)) is None
    assert next(instants) <= looks + LATE


def test_without_ompl_a_line_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "ompl", None)
    monkeypatch.setitem(sys.modules, "ompl.geometric", None)
    assert main(["map_a", "--guess", "rrt_star", "--out", str(tmp_path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line == "guess: 'rrt_star' needs OMPL: pip install ompl, or pip install -e .[rrt_star]"
    assert list(tmp_path.iterdir()) == []
