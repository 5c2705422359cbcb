"""Whether there is a next solve after the check of a plan, and what it is asked for, by hand-made plans."""

import math
from dataclasses import replace

import numpy as np
import pytest

from drake_gnnocp import Scenario, Trajectory, Vehicle
from drake_gnnocp.budget import Budget
from drake_gnnocp.ocp import refine as module
from drake_gnnocp.ocp.answers import answer
from drake_gnnocp.ocp.boxes import limits
from drake_gnnocp.ocp.costs import CostWeights
from drake_gnnocp.ocp.formulation import Formulation, Line, formulate
from drake_gnnocp.ocp.refine import Refined, Solve, refine
from drake_gnnocp.verification import verify

EXACT = 1e-9  # sums over a thousand steps of the driven motion
VEHICLE = Vehicle()
TOP_SPEED = 2.0  # m/s, of the plan, at its middle


def plan() -> Trajectory:
    """Straight ahead by 8 m in 8 intervals of 1 s, from rest to rest."""
    a = np.array([0.0, *np.full(3, 2 / 3), 0.0, *np.full(3, -2 / 3), 0.0])
    v = np.append(0.0, np.cumsum((a[1:] + a[:-1]) / 2))
    x = np.append(0.0, np.cumsum(v[:-1] + a[:-1] / 3 + a[1:] / 6))
    states, inputs = np.zeros((9, 5)), np.zeros((9, 2))
    states[:, 0], states[:, 3], inputs[:, 0] = x, v, a
    return Trajectory(np.arange(9.0), states, inputs)


def block(side: float) -> np.ndarray:
    """An obstacle to the left of the lane, at a distance from the car's side, that start and goal are clear of [m]."""
    y = VEHICLE.width / 2 + side
    return np.array([[4.5, y], [6.5, y], [6.5, y + 1.0], [4.5, y + 1.0]])


def task(*rings: np.ndarray, goal: tuple[float, float, float] = (8.0, 0.0, 0.0), v_max: float = 2.5) -> Scenario:
    return Scenario("task", np.zeros(3), np.array(goal), rings, vehicle=Vehicle(v_max=v_max))


def around(scenario: Scenario) -> Formulation:
    """The problem around a reference that is none of the solver's plans."""
    reference = plan()
    reference.states[1:-1, 1] -= 0.5
    return formulate(scenario, reference, CostWeights(), margin=0.1)


def solved(scenario: Scenario, found: Trajectory, success: bool = True) -> Solve:
    return Solve(0.0, 0.0, 1, success, "by hand", (), 0, 0, found, verify(scenario, found))


def answered(scenario: Scenario, formulation: Formulation) -> Formulation:
    """The answer to the plan, as the solver's solution of the formulation."""
    return answer(scenario, formulation, plan())


def test_a_clean_plan_is_the_next_reference_and_nothing_more_is_asked() -> None:
    scenario = task(block(0.5))
    formulation = around(scenario)
    found = answered(scenario, formulation)
    np.testing.assert_array_equal(found.reference.states, plan().states)
    assert vars(replace(found, reference=formulation.reference)) == vars(formulation)  # the same objects


@pytest.mark.parametrize("before", [0.0, 0.02])
def test_exceeded_limits_are_lowered_by_more_than_the_excess(before: float) -> None:
    scenario = task(v_max=TOP_SPEED / 1.05)
    formulation = replace(around(scenario), limits_margin=before)
    found = answered(scenario, formulation)
    lowered = found.limits_margin - before
    assert limits(found).upper[0, 0] == pytest.approx((1 - before - lowered) * scenario.vehicle.v_max)
    assert TOP_SPEED * (1 - lowered) < scenario.vehicle.v_max  # if it is exceeded by as much again
    assert lowered < 0.06


def test_some_of_the_limits_always_remains() -> None:
    scenario = task(v_max=TOP_SPEED / 10)
    assert 0 < limits(answered(scenario, around(scenario))).upper.min()


def test_where_the_plan_ends_beside_the_goal_the_next_aims_to_the_other_side() -> None:
    scenario = task(goal=(7.98, 0.03, 0.05))
    formulation = around(scenario)
    found = answered(scenario, formulation)
    np.testing.assert_allclose(found.goal, [7.96, 0.06, 0.1, 0.0, 0.0], atol=EXACT)
    again = answered(scenario, found)  # it missed by as much although it aimed beside
    np.testing.assert_allclose(again.goal, [7.94, 0.09, 0.15, 0.0, 0.0], atol=EXACT)
    moving = replace(formulation, goal=np.append(formulation.goal[:3], [0.3, 0.1]))
    np.testing.assert_allclose(answered(scenario, moving).goal[3:], [0.3, 0.1])


def test_full_turns_of_the_goals_heading_are_no_error() -> None:
    for turns in (-2 * math.pi, 2 * math.pi):
        scenario = task(goal=(7.98, 0.0, turns))
        found = answered(scenario, around(scenario))
        np.testing.assert_allclose(found.goal, [7.96, 0.0, 0.0, 0.0, 0.0], atol=EXACT)


def test_a_goal_that_is_reached_well_enough_stays() -> None:
    scenario = task(goal=(7.996, 0.004, 0.005))
    formulation = around(scenario)
    np.testing.assert_array_equal(answered(scenario, formulation).goal, formulation.goal)


def test_an_obstacle_that_is_too_near_gets_lines_in_the_intervals_that_pass_it() -> None:
    scenario = task(block(0.012))
    formulation = around(scenario)
    found, x = answered(scenario, formulation), plan().poses[:, 0]
    front, rear = x + VEHICLE.wheelbase + VEHICLE.front_hang, x - VEHICLE.rear_hang
    passing = [k for k in range(8) if front[k + 1] > 4.5 and rear[k] < 6.5]
    assert [line.interval for line in found.lines] == passing
    assert {(line.obstacle, line.clearance) for line in found.lines} == {(0, float(formulation.line_clearances[0]))}
    assert found.line_clearances[0] > 0.012


def test_an_obstacle_that_is_too_near_in_spite_of_its_line_gets_more_clearance() -> None:
    scenario = task(block(0.012))
    first = answered(scenario, around(scenario))
    second = answered(scenario, first)
    asked = float(first.line_clearances[0])
    assert [line.interval for line in second.lines] == [line.interval for line in first.lines]
    for line in second.lines:
        assert line.clearance == pytest.approx(asked + asked - 0.012, abs=EXACT)
    enough = replace(first, lines=(Line(3, 0, 0.05),), line_clearances=np.array([0.011]))
    assert answered(scenario, enough).lines == enough.lines


def test_bounds_that_are_too_near_get_lines_like_an_obstacle() -> None:
    side = VEHICLE.width / 2 + 0.01  # from the lane's middle to the lower bound
    scenario = replace(task(), bounds=(-5.0, 15.0, -side, 5.0))
    formulation = around(scenario)
    assert not answered(scenario, formulation).lines  # start and goal are no farther inside
    strict = replace(formulation, line_clearances=np.full(4, 0.02))
    assert {line.obstacle for line in answered(scenario, strict).lines} == {2}


# --- whether there is a next solve ---


def refined_by_hand(
    monkeypatch: pytest.MonkeyPatch, scenario: Scenario, guess: Formulation, solves: list[Solve]
) -> tuple[Refined, list[Formulation]]:
    """The loop over hand-made solves, and what was asked for in each."""
    asked: list[Formulation] = []

    def solve_once(_scenario: Scenario, formulation: Formulation, *_: object) -> Solve:
        asked.append(formulation)
        return solves[len(asked) - 1]

    monkeypatch.setattr(module, "solve_once", solve_once)
    return refine(scenario, guess, Budget.unlimited()), asked


def test_a_verified_plan_without_a_comfortable_clearance_is_widened_once_where_that_costs_little(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scenario = task(block(0.012))
    near = solved(scenario, plan())
    aside = plan().inputs.copy()
    aside[1:4, 1] += np.array([-0.01, 0.01, 0.0])  # turns a little away from the block
    wider = replace(plan(), inputs=aside)
    wide = replace(near, trajectory=wider)
    dear = replace(near, trajectory=replace(wider, inputs=1.1 * wider.inputs))
    failed = replace(wide, verification=replace(near.verification, collision_free=False))
    assert near.verification.verified
    for second, best in ((wide, 1), (dear, 0), (near, 0), (failed, 0)):
        refined, asked = refined_by_hand(monkeypatch, scenario, around(scenario), [near, second])
        assert len(asked) == 2 and refined.best == best and refined.verified and refined.reason == ""
        assert not asked[0].lines and {(line.obstacle, line.clearance) for line in asked[1].lines} == {(0, 0.101)}


def test_no_more_clearance_is_asked_for_than_the_place_leaves(monkeypatch: pytest.MonkeyPatch) -> None:
    ring = block(0.03)
    tight = task(ring, ring * [1, -1])  # 6 cm more than the car is wide
    near = solved(tight, plan())
    _, asked = refined_by_hand(monkeypatch, tight, around(tight), [near, near])
    beside = np.abs(plan().poses[:, 0] + VEHICLE.length / 2 - VEHICLE.rear_hang - 5.5) < 2.0
    demanded = asked[1].demanded
    assert beside.sum() >= 2 and demanded[beside].max() < 0.031 and demanded.max() > 0.1
    assert all(line.clearance < 0.102 for line in asked[1].lines)


def test_a_plan_that_is_clear_or_that_is_not_to_be_widened_is_the_last(monkeypatch: pytest.MonkeyPatch) -> None:
    clear = task(block(0.5))
    _, asked = refined_by_hand(monkeypatch, clear, around(clear), [solved(clear, plan())])
    assert len(asked) == 1
    near = task(block(0.012))
    _, asked = refined_by_hand(monkeypatch, near, replace(around(near), comfort=0.0), [solved(near, plan())])
    assert len(asked) == 1


def test_near_ends_that_leave_little_a_plan_may_be_as_near(monkeypatch: pytest.MonkeyPatch) -> None:
    behind = np.array([[-2.0, -1.0], [0.0, -1.0], [0.0, 1.0], [-2.0, 1.0]]) - [VEHICLE.rear_hang + 0.02, 0.0]
    ahead = -behind + [8.0 + VEHICLE.wheelbase + VEHICLE.front_hang - VEHICLE.rear_hang, 0.0]
    tight = replace(task(behind, ahead), bounds=(-20.0, 20.0, -20.0, 20.0))
    _, asked = refined_by_hand(monkeypatch, tight, around(tight), [solved(tight, plan())] * 2)
    assert len(asked) == 1


def test_of_several_plans_with_faults_the_one_with_the_fewest_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = task(block(0.5), goal=(7.9, 0.0, 0.0))  # the plan ends beside it
    one = solved(scenario, plan())
    two = replace(one, verification=replace(one.verification, limits_ok=False))
    nearer = replace(one, verification=replace(one.verification, min_clearance_m=0.1))
    solves = [two, nearer, one, *[two] * 6]
    refined, asked = refined_by_hand(monkeypatch, scenario, around(scenario), solves)
    assert refined.best == 2 and not refined.verified and len(asked) == 9
    assert refined.reason == "the optimised plan ends 0.100 m off the goal after 9 solves"
