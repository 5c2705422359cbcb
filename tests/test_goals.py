"""Several goals and free headings: which goal is reached, in which heading, and what is said of it."""

from __future__ import annotations

import json
import logging
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from matplotlib.colors import to_rgba

from drake_gnnocp import (
    FromGuess,
    MinimumTime,
    NoGuess,
    Plan,
    PlanOptions,
    Scenario,
    ScenarioError,
    Vehicle,
    plan,
    verify,
)
from drake_gnnocp.budget import Budget
from drake_gnnocp.command_line import main
from drake_gnnocp.ends import GoalTolerance
from drake_gnnocp.guesses import HybridAStar
from drake_gnnocp.ocp.formulation import Formulation
from drake_gnnocp.ocp.refine import Refined, Solve
from drake_gnnocp.pictures import draw_map, style
from drake_gnnocp.planner import attempt as attempt_module
from drake_gnnocp.planner.goals import FEW, Goals, aims_of
from drake_gnnocp.search.stages import SCHEDULE

START = np.zeros(3)
BLOCK = [[6.0, -3.0], [9.0, -3.0], [9.0, 1.0], [7.0, 2.0]]
BESIDE, AROUND = (14.0, 5.0, 0.5), (12.0, -6.0, 3.0)  # an easy goal, and a dearer one
FREE = math.nan
EXACT = 1e-9  # but for rounding
NEAR = 1e-4  # m and rad, of an end that the optimiser puts on the rim of a tolerance


def cage(x: float, y: float) -> np.ndarray:
    """A wall around a car at (x, y) with the heading 0."""
    inner = np.array([[-2.0, -2.0], [5.0, -2.0], [5.0, 2.0], [-2.0, 2.0], [-2.0, -1.9]])
    outer = np.array([[-2.2, -1.9], [-2.2, 2.2], [5.2, 2.2], [5.2, -2.2], [-2.2, -2.2], [-2.2, -2.0], [-2.0, -2.0]])
    return np.concatenate([inner, outer])[:-1] + [x, y]


@pytest.fixture(scope="module")
def task() -> Callable[..., Scenario]:
    """Makes tasks among one block; keywords change fields."""

    def make(*goals: Any, **changes: Any) -> Scenario:
        ends = {"goal": goals[0]} if len(goals) == 1 else {"goals": goals}
        return Scenario(**{"name": "task", "start": START, "obstacles": (np.array(BLOCK),), **ends, **changes})

    return make


@pytest.fixture(scope="module")
def beside(task: Callable[..., Scenario]) -> Plan:
    return plan(task(BESIDE))


@pytest.fixture(scope="module")
def around(task: Callable[..., Scenario]) -> Plan:
    return plan(task(AROUND))


def states_of(result: Plan) -> np.ndarray:
    assert result.verified and result.trajectory is not None
    return result.trajectory.states


def cost_of(result: Plan) -> float:
    assert result.cost is not None
    return result.cost.J


# several goals


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_the_goal_of_the_cheapest_plan_is_reached(
    task: Callable[..., Scenario], beside: Plan, around: Plan, order: tuple[int, int]
) -> None:
    alone, goals = [beside, around], [BESIDE, AROUND]
    result = plan(task(*(goals[i] for i in order)))
    best = min(order, key=lambda i: cost_of(alone[i]))
    assert result.goal_reached == order.index(best)
    np.testing.assert_array_equal(states_of(result), states_of(alone[best]))
    assert {made.goal for made in result.attempts if made.verified} == {0, 1}  # both were planned to
    assert f"reaches goals[{order.index(best)}]" in result.summary


def test_the_nearer_of_two_goals_is_reached_where_plans_take_equally_long(task: Callable[..., Scenario]) -> None:
    far, near = (26.0, 8.0, 0.0), (13.0, 5.0, 0.2)
    result = plan(task(far, near), horizon=14.0)
    assert result.verified and result.goal_reached == 1
    assert result.to_dict()["goal_reached"] == 1
    assert {attempt["goal"] for attempt in result.to_dict()["attempts"]} == {0, 1}


def test_the_quickest_plan_is_taken_where_time_is_minimised(task: Callable[..., Scenario]) -> None:
    """A long straight costs less than a short way with a bend, and takes longer."""
    far, near = (40.0, 8.0, 0.0), (6.0, 6.0, 1.2)
    scenario, few = task(far, near, obstacles=()), PlanOptions(most_attempts=1, knots=40)
    assert plan(scenario, options=few).goal_reached == 0
    result = plan(scenario, horizon=MinimumTime(), options=few)
    assert result.goal_reached == 1
    assert {made.goal for made in result.attempts} == {1}  # the way to the other alone takes longer than that plan


def test_a_goal_that_is_occupied_is_left_out_with_a_warning(
    task: Callable[..., Scenario], beside: Plan, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING):
        result = plan(task((7.0, 0.0, 0.0), BESIDE))
    assert result.goal_reached == 1 and {made.goal for made in result.attempts} == {1}
    assert "goals[0]: the car collides with obstacles[0]; it is left out" in caplog.text
    np.testing.assert_array_equal(states_of(result), states_of(beside))


def test_where_all_goals_are_occupied_each_is_named(task: Callable[..., Scenario]) -> None:
    message = (
        r"^goals: the car can stand at none: goals\[0\]: the car collides with obstacles\[0\]; goals\[1\]: the car le"
    )
    with pytest.raises(ScenarioError, match=message):
        task((7.0, 0.0, 0.0), (100.0, 0.0, 0.0), bounds=(-5.0, 30.0, -10.0, 10.0))


@pytest.mark.parametrize("guess", ["auto", "hybrid_astar", "gnn"])
def test_another_goal_is_reached_where_the_first_cannot_be(task: Callable[..., Scenario], guess: str) -> None:
    caged = (20.0, 9.0, 0.0)
    result = plan(task(caged, BESIDE, obstacles=(np.array(BLOCK), cage(*caged[:2]))), guess)
    assert result.verified and result.goal_reached == 1
    assert result.no_path is None


def test_there_is_no_path_where_that_is_proven_for_every_goal(task: Callable[..., Scenario]) -> None:
    first, second = (20.0, 9.0, 0.0), (20.0, -9.0, 0.0)
    result = plan(task(first, second, obstacles=(cage(*first[:2]), cage(*second[:2]))))
    assert result.status == "no_path" and result.goal_reached is None
    assert result.no_path is not None and result.no_path.proven
    assert "goals[0]: " in result.no_path.text and "; goals[1]: " in result.no_path.text
    assert result.to_dict()["no_path"]["proven"]


def test_one_goal_without_a_path_proves_nothing_for_another(
    task: Callable[..., Scenario], monkeypatch: pytest.MonkeyPatch
) -> None:
    def collides(scenario: Scenario, formulation: Formulation, *_: object) -> Refined:
        check = replace(verify(scenario, formulation.reference), collision_free=False)
        solve = Solve(0.0, 0.0, 1, False, "Infeasible", (), 0, 0, formulation.reference, check)
        return Refined((solve,), 0, "collides with an obstacle")

    monkeypatch.setattr(attempt_module, "refine", collides)
    caged = (20.0, 9.0, 0.0)
    result = plan(task(caged, BESIDE, obstacles=(np.array(BLOCK), cage(*caged[:2]))))
    assert result.status == "unverified" and result.goal_reached is None and result.attempt.goal == 1
    assert any(made.no_path is not None and made.no_path.proven for made in result.attempts if made.goal == 0)


def test_short_searches_come_before_long_ones(task: Callable[..., Scenario], monkeypatch: pytest.MonkeyPatch) -> None:
    """A hard goal does not use up the time for an easy one."""
    asked: list[tuple[float, int]] = []

    def guesses(self: HybridAStar, scenario: Scenario, budget: Budget) -> Iterator[NoGuess]:
        asked.append((float(scenario.goal[0]), self.last_stage))
        yield NoGuess(self.name, "none")

    monkeypatch.setattr(HybridAStar, "guesses", guesses)
    monkeypatch.setattr(attempt_module, "refine", lambda *_: Refined((), None, "nothing is solved"))
    plan(task(BESIDE, AROUND), "hybrid_astar")
    last = len(SCHEDULE)
    assert [stages < last for _, stages in asked] == [True, True, False, False]
    assert {x for x, _ in asked[:2]} == {x for x, _ in asked[2:]} == {BESIDE[0], AROUND[0]}


def test_of_many_goals_the_most_promising_are_planned_to(task: Callable[..., Scenario]) -> None:
    goals = [(12.0 + 3 * i, 6.0, 0.0) for i in range(3 * FEW)]
    result = plan(task(*goals), options=PlanOptions(knots=40))
    assert result.verified
    assert len({made.goal for made in result.attempts}) == FEW


def test_the_network_s_costs_put_the_cheaper_goal_first(task: Callable[..., Scenario]) -> None:
    dear, cheap = (4.0, 7.0, 3.0), (25.0, 4.0, 0.0)  # the nearer one takes a turn of 170 degrees
    goals = Goals(task(dear, cheap), None, FromGuess(), Budget.unlimited(), PlanOptions())
    aims = goals._ordered(aims_of(task(dear, cheap)))
    assert [aim.goal for aim in aims] == [1, 0] and aims[0].way > aims[1].way


def test_a_trajectory_as_a_guess_goes_to_the_goal_it_ends_at(
    task: Callable[..., Scenario], beside: Plan, around: Plan
) -> None:
    for i, alone in enumerate((beside, around)):
        assert alone.trajectory is not None
        result = plan(task(BESIDE, AROUND), alone.trajectory)
        assert result.goal_reached == i and {made.goal for made in result.attempts} == {i}


def test_plans_to_several_goals_are_the_same_every_time(task: Callable[..., Scenario]) -> None:
    scenario = task(AROUND, (*BESIDE[:2], FREE), goal_tolerance=GoalTolerance(x=0.3))
    first, second = plan(scenario), plan(scenario, max_seconds=1000.0)
    assert first.goal_reached == second.goal_reached
    np.testing.assert_array_equal(states_of(first), states_of(second))


# free headings


def test_a_free_heading_costs_no_more_than_a_fixed_one(task: Callable[..., Scenario]) -> None:
    free = plan(task((*BESIDE[:2], FREE)))
    assert free.verified and free.goal_reached == 0
    for heading in (0.0, 0.5, -1.4, 3.0):
        assert cost_of(free) <= cost_of(plan(task((*BESIDE[:2], heading))))
    np.testing.assert_allclose(states_of(free)[-1, :2], BESIDE[:2], atol=NEAR)
    assert free.trajectory is not None and verify(task((*BESIDE[:2], FREE)), free.trajectory).verified
    assert "with the heading" in free.summary


def test_a_slot_leaves_few_headings() -> None:
    slot = [np.array([[8, 3.9], [16, 3.9], [16, 4], [8, 4]]), np.array([[8, 6.2], [16, 6.2], [16, 6.3], [8, 6.3]])]
    turned = 0.3  # rad, so that no round number of degrees lies along it
    cos, sin = math.cos(turned), math.sin(turned)
    walls = tuple(ring @ np.array([[cos, sin], [-sin, cos]]) for ring in slot)
    place = np.array([11.0, 5.1]) @ np.array([[cos, sin], [-sin, cos]])
    scenario = Scenario("slot", START, np.append(place, FREE), walls)
    headings = scenario.headings_at(0)
    assert len(headings) == 6
    for some, along in ((headings[:3], turned), (headings[3:], turned - math.pi)):
        off = [math.remainder(heading - along, 2 * math.pi) for heading in some]
        assert max(map(abs, off)) < math.radians(4.0) and min(map(abs, off)) < math.radians(1.0)
    assert np.isnan(scenario.goals[0][2]) and scenario.goal[2] == headings[0]


def test_a_free_heading_has_the_clearance_that_the_place_has() -> None:
    """Beside a wall: what is asked for at the goal is what the best heading leaves."""
    wall = np.array([[6.0, 2.0], [30.0, 2.0], [30.0, 3.0], [6.0, 3.0]])
    scenario = Scenario("wall", START, np.array([15.0, 0.9, FREE]), (wall,), clearance=0.5)
    poses = [(15.0, 0.9, heading) for heading in scenario.headings_at(0)]
    cars = shapely.polygons(scenario.vehicle.footprints(np.array(poses)))
    room = shapely.distance(cars, shapely.Polygon(wall))
    assert 0.14 < room.min() and room.max() < 0.5  # 0.15 m is what a car along the wall has
    result = plan(scenario)
    assert result.verified


def test_a_plan_in_a_heading_that_leaves_less_than_others_is_refused() -> None:
    """A car that looks at a wall 0.14 m before it could have turned away."""
    wall = np.array([[15.9, -4.0], [16.0, -4.0], [16.0, 4.0], [15.9, 4.0]])
    fixed = Scenario("wall", START, np.array([12.0, 0.0, 0.0]), (wall,), clearance=0.5)
    found = plan(fixed).trajectory
    assert found is not None and verify(fixed, found).verified
    assert not verify(replace(fixed, goal=np.array([12.0, 0.0, FREE])), found).clearance_ok


# scenarios and their files


def test_goals_come_back_from_json(task: Callable[..., Scenario]) -> None:
    scenario = task(BESIDE, (*AROUND[:2], None), goal_tolerance=GoalTolerance(0.5, heading=0.1))
    data = scenario.to_dict()
    assert data["goals"] == [list(BESIDE), [*AROUND[:2], None]] and "goal" not in data
    assert data["goal_tolerance"] == {"x": 0.5, "y": 0.0, "heading": 0.1}
    again = Scenario.from_dict(json.loads(json.dumps(data)))
    assert again.to_dict() == data and again.targets[1].is_free
    free = task((*BESIDE[:2], None))
    assert free.to_dict()["goal"] == [*BESIDE[:2], None] and "goals" not in free.to_dict()
    assert task((7.0, 0.0, 0.0), BESIDE).goal.tolist() == list(BESIDE)  # what planners work with can be stood at


def test_other_fields_change_without_the_goals(task: Callable[..., Scenario]) -> None:
    scenario = task(BESIDE, (*AROUND[:2], None))
    changed = replace(scenario, clearance=0.1)
    assert changed.to_dict()["goals"] == scenario.to_dict()["goals"]
    moved = scenario.translated(100.0, 50.0)
    np.testing.assert_allclose(moved.goals[1], [112.0, 44.0, FREE])
    with pytest.raises(ScenarioError, match="goals: give either goal or goals"):
        replace(scenario, goal=np.array([1.0, 9.0, 0.0]))
    with pytest.raises(ScenarioError, match="^goal: missing"):
        Scenario("none", START)
    assert scenario.between(START, AROUND).goals == ()


def test_a_task_at_another_scale_has_the_same_plan_at_that_scale(task: Callable[..., Scenario]) -> None:
    scale, tolerance = 0.1, GoalTolerance(0.4, 0.1, 0.1)
    large = task(AROUND, BESIDE, goal_tolerance=tolerance)
    lengths = ("wheelbase", "front_hang", "rear_hang", "width", "v_max", "a_max")
    small = Scenario(
        name="small",
        start=np.zeros(3),
        obstacles=(scale * np.array(BLOCK),),
        goals=tuple(goal * (scale, scale, 1.0) for goal in large.goals),
        vehicle=Vehicle(**{k: scale * v if k in lengths else v for k, v in Vehicle().to_dict().items()}),
        goal_tolerance=tolerance.scaled(scale),
    )
    one, other = plan(large), plan(small)
    assert one.goal_reached == other.goal_reached
    np.testing.assert_allclose(states_of(other)[:, :2], scale * states_of(one)[:, :2], atol=1e-6)


def test_the_command_line_takes_a_free_heading_and_several_goals(
    task: Callable[..., Scenario], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "task.json"
    task(AROUND, (*BESIDE[:2], None)).save(path)
    how = ["--no-pictures", "--out", str(tmp_path / "plan")]
    assert main([str(path), *how]) == 0
    result = json.loads((tmp_path / "plan" / "result.json").read_text())
    assert result["goal_reached"] == 1 and "reaches goals[1] with the heading" in capsys.readouterr().out
    assert main([str(path), "--goal", "14", "5", "free", *how]) == 0
    assert json.loads((tmp_path / "plan" / "scenario.json").read_text())["goal"] == [14.0, 5.0, None]
    assert "reaches goal with the heading" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        main([str(path), "--start", "0", "0", "free", *how])


def test_a_drawing_with_goals_is_planned(tmp_path: Path) -> None:
    def point(x: float, y: float, **properties: Any) -> dict[str, Any]:
        geometry = {"type": "Point", "coordinates": [x, y]}
        return {"type": "Feature", "properties": properties, "geometry": geometry}

    features = [point(0, 0, role="start", heading=0), point(14, 5, role="goal"), point(12, -6, role="goal", heading=3)]
    data = {"type": "FeatureCollection", "goal_tolerance": {"x": 0.2}, "features": features}
    (tmp_path / "lot.geojson").write_text(json.dumps(data))
    scenario = Scenario.load(tmp_path / "lot.geojson")
    assert scenario.targets[0].is_free and scenario.goal_tolerance == GoalTolerance(x=0.2)
    assert Scenario.load(tmp_path / "lot.geojson", goal=(14, 5, 1)).goals == ()
    assert plan(scenario).goal_reached == 0


def test_the_map_shows_the_goal_that_is_reached_and_others_faint(task: Callable[..., Scenario], beside: Plan) -> None:
    scenario = task(AROUND, (*BESIDE[:2], FREE), (25.0, 0.0, FREE), goal_tolerance=GoalTolerance(0.5, 0.2))
    ax = draw_map(style.new_figure(4, 4).add_subplot(), scenario, beside.trajectory)
    legend = ax.get_legend()
    assert legend is not None
    labels = [text.get_text() for text in legend.get_texts()]
    assert labels.count("goal") == labels.count("other goals") == 1
    for color, n in ((style.GOAL, 1), (style.FAINT_GOAL, 2)):
        drawn = [patch for patch in ax.patches if patch.get_edgecolor() == to_rgba(color)]
        assert sum(patch.get_linestyle() == ":" for patch in drawn) == n  # the boxes of the tolerance
        assert sum(patch.get_linewidth() == 1.8 for patch in drawn) == n
