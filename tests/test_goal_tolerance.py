"""Tolerances at the goal: where a plan may end, how the optimiser makes use of it, and what the check grants."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from drake_gnnocp import CostWeights, Plan, PlanOptions, Scenario, Trajectory, plan, verify
from drake_gnnocp.ends import GoalTolerance, Target, nearest_target
from drake_gnnocp.ocp.answers import answer
from drake_gnnocp.ocp.boxes import end_place, ends
from drake_gnnocp.ocp.formulation import formulate
from drake_gnnocp.ocp.triangle_areas import rows_near
from drake_gnnocp.search.reachability import no_path

BLOCK = np.array([[6.0, -3.0], [9.0, -3.0], [9.0, 1.0], [7.0, 2.0]])
BESIDE, AROUND = (14.0, 5.0, 0.5), (12.0, -6.0, 3.0)
FREE = math.nan
EXACT = 1e-9  # but for rounding
NEAR = 1e-4  # m and rad, of an end that the optimiser puts on the rim of a tolerance


def task(*goals: Any, **changes: Any) -> Scenario:
    given = {"goal": np.array(goals[0])} if len(goals) == 1 else {"goals": goals}
    fields: dict[str, Any] = {"name": "task", "start": np.zeros(3), "obstacles": (BLOCK,), **given, **changes}
    return Scenario(**fields)


def cage(x: float, y: float) -> tuple[np.ndarray, ...]:
    """Four walls around a car at (x, y) with the heading 0."""
    sides = ((-2.2, -2.2, 5.2, -2.0), (-2.2, 2.0, 5.2, 2.2), (-2.2, -2.2, -2.0, 2.2), (5.0, -2.2, 5.2, 2.2))
    return tuple(np.array([[x + a, y + b], [x + c, y + b], [x + c, y + d], [x + a, y + d]]) for a, b, c, d in sides)


@pytest.fixture(scope="module")
def beside() -> Plan:
    return plan(task(BESIDE))


@pytest.fixture(scope="module")
def around() -> Plan:
    return plan(task(AROUND))


def trajectory_of(result: Plan) -> Trajectory:
    assert result.verified and result.trajectory is not None
    return result.trajectory


def cost_of(result: Plan) -> float:
    assert result.cost is not None
    return result.cost.J


@pytest.mark.parametrize("tolerance", [GoalTolerance(x=0.6), GoalTolerance(0.3, 0.2, 0.1), GoalTolerance(heading=0.4)])
def test_a_tolerance_makes_plans_cheaper_and_is_kept(around: Plan, tolerance: GoalTolerance) -> None:
    scenario = task(AROUND, goal_tolerance=tolerance)
    result = plan(scenario)
    found, target = trajectory_of(result), scenario.targets[0]
    assert cost_of(result) < 0.99 * cost_of(around)
    assert (np.abs(target.offset(found.poses[-1])) <= target.half_sizes + NEAR).all()
    assert not verify(task(AROUND), found).verified
    assert result.verification is not None and result.verification.terminal_position_error_m < NEAR


def test_a_tolerance_is_measured_in_the_goal_s_frame(beside: Plan) -> None:
    x, y, theta = BESIDE
    cos, sin = math.cos(theta), math.sin(theta)
    cases = ((0.45, 0.0, True), (-0.5, 0.1, True), (0.52, 0.0, False), (0.0, 0.12, False), (0.3, -0.105, True))
    for along, left, ok in cases:
        goal = (x - along * cos + left * sin, y - along * sin - left * cos, theta)  # the plan ends (along, left) of it
        check = verify(task(goal, goal_tolerance=GoalTolerance(0.5, 0.1)), trajectory_of(beside))
        assert check.verified == ok, (along, left)
        assert (check.terminal_position_error_m <= 0.01) == ok
        assert any("beyond 0.5 and 0.1 m" in finding.allowed for finding in check.findings)
    for turn, ok in ((0.25, True), (-0.3, True), (0.34, False)):
        check = verify(task((x, y, theta + turn), goal_tolerance=GoalTolerance(heading=0.3)), trajectory_of(beside))
        assert check.verified == ok
        assert check.terminal_heading_error_rad == pytest.approx(max(abs(turn) - 0.3, 0.0), abs=1e-3)


def test_a_goal_that_is_not_reached_itself_is_reached_within_its_tolerance() -> None:
    """In 5 s a car that starts and ends at rest gets 9.4 m far."""
    goal, few = (11.0, 0.0, 0.0), PlanOptions(most_attempts=1, knots=40)
    assert not plan(task(goal, obstacles=()), "straight", horizon=5.0, options=few).verified
    near = plan(task(goal, obstacles=(), goal_tolerance=GoalTolerance(x=2.5)), "straight", horizon=5.0, options=few)
    assert 8.5 - NEAR < trajectory_of(near).poses[-1, 0] < 9.4


def test_the_problem_bounds_the_end_and_keeps_it_clear() -> None:
    line = Trajectory(np.linspace(0, 9, 20), np.linspace((0, 0, 0, 1, 0), (14, 5, 0.5, 1, 0), 20), np.zeros((20, 2)))
    wall = np.array([[17.5, 8.0], [20.0, 8.0], [20.0, 9.0], [17.5, 9.0]])
    exact = formulate(task(BESIDE, obstacles=(wall,)), line, CostWeights(), 0.1)
    within = formulate(
        task(BESIDE, obstacles=(wall,), goal_tolerance=GoalTolerance(0.5, 0.1, 0.2)), line, CostWeights(), 0.1
    )
    assert end_place(exact) is None and rows_near(exact).knot.max() < 19 == rows_near(within).knot.max()
    np.testing.assert_array_equal(ends(exact)[1].lower, ends(exact)[1].upper)
    assert ends(within)[1].lower[0, 2] == 0.5 - 0.2 and ends(within)[1].upper[0, 2] == 0.5 + 0.2
    place = end_place(within)
    assert place is not None
    matrix, lower, upper = place
    cos, sin = math.cos(0.5), math.sin(0.5)
    for along, left, inside in ((0.49, -0.09, True), (0.51, 0.0, False), (0.0, 0.11, False)):
        at = matrix @ np.array([14 + along * cos - left * sin, 5 + along * sin + left * cos])
        assert ((lower <= at) & (at <= upper)).all() == inside


def test_an_end_beyond_the_tolerance_is_answered_by_as_much() -> None:
    """Straight ahead by 8 m, where the box around the goal ends 0.03 m before."""
    t = np.linspace(0.0, 8.0, 81)
    a = 0.5 * np.cos(np.pi * t / 8)
    speed = np.append(0.0, np.cumsum((a[1:] + a[:-1]) / 2) * 0.1)
    x = np.append(0.0, np.cumsum(speed[:-1] + (2 * a[:-1] + a[1:]) * 0.1 / 6) * 0.1)
    zero = np.zeros_like(t)
    found = Trajectory(t, np.column_stack([x, zero, zero, speed, zero]), np.column_stack([a, zero]))
    for beyond, moved in ((0.03, 0.03), (-0.1, 0.0)):
        goal = (x[-1] - 0.2 - beyond, 0.0, 0.0)
        scenario = task(goal, obstacles=(), goal_tolerance=GoalTolerance(x=0.2))
        formulation = formulate(scenario, found, CostWeights(), 0.1)
        np.testing.assert_allclose(answer(scenario, formulation, found).goal[0], goal[0] - moved, atol=1e-6)


def test_a_car_within_the_tolerance_is_there() -> None:
    result = plan(task((0.3, 0.1, 0.05), goal_tolerance=GoalTolerance(0.4, 0.2, 0.1)))
    assert result.verified and result.guess_source == "at_rest"
    assert plan(task(BESIDE, (0.0, 0.0, FREE))).goal_reached == 1


def test_a_tolerance_that_reaches_out_of_the_cage_proves_nothing() -> None:
    caged = (20.0, 0.0, 0.0)
    scenario = task(caged, obstacles=cage(*caged[:2]))
    proof = no_path(scenario)
    assert proof is not None and proof.proven
    assert no_path(replace(scenario, goal_tolerance=GoalTolerance(12.0, 0.0, 0.0))) is None
    assert no_path(replace(scenario, goal_tolerance=GoalTolerance(0.1, 0.1, 0.1))) is not None
    assert no_path(replace(scenario, goal=np.array([20.0, 0.0, FREE]))) is not None


def test_targets_measure_along_their_heading() -> None:
    target = Target(np.array([1.0, 2.0, math.pi / 2]), GoalTolerance(0.5, 0.1, 0.2))
    np.testing.assert_allclose(target.offset(np.array([0.8, 2.4, math.pi])), [0.4, 0.2, math.pi / 2], atol=EXACT)
    np.testing.assert_allclose(target.excess(np.array([0.8, 2.4, math.pi])), [0.0, 0.1, math.pi / 2 - 0.2], atol=EXACT)
    free = Target(np.array([1.0, 2.0, FREE]), GoalTolerance(0.5, 0.1))
    np.testing.assert_allclose(free.excess(np.array([0.3, 2.4, 9.0])), [-0.2, 0.3, 0.0], atol=EXACT)
    assert nearest_target((target, free), np.array([1.0, 2.0, 0.0])) == 1
