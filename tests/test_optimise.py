"""Solve, verify, refine: solutions against the solver's tolerances, and what the loop must cure."""

import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from drake_gnnocp import Scenario, Trajectory
from drake_gnnocp.guesses.sources import GuessOptions, hybrid_astar_guess, straight_guess
from drake_gnnocp.ocp import refine
from drake_gnnocp.ocp.convex_step import ConvexOptions
from drake_gnnocp.ocp.dynamics import defects
from drake_gnnocp.ocp.ipopt import IpoptOptions, solve
from drake_gnnocp.ocp.problem import ProblemOptions, build, unpack
from drake_gnnocp.ocp.refine import RefineOptions, optimise
from drake_gnnocp.timing.minimum_effort import gently_timed
from drake_gnnocp.verification import min_clearance, verify

N_KNOTS = 60
FEASIBILITY = IpoptOptions().feasibility  # m and rad: what Ipopt was asked for
IPOPT_BOUND_RELAXATION = 1e-8  # relative, Ipopt's default bound_relax_factor, in program variables
STATE_SCALE = 100.0


@pytest.fixture(scope="module")
def guess(gate: Scenario) -> Trajectory:
    found = hybrid_astar_guess(gate, GuessOptions(n_knots=N_KNOTS), time.monotonic() + 30).trajectory
    assert found is not None
    return found


def test_the_solution_holds_every_constraint_to_the_solvers_tolerance(gate: Scenario, guess: Trajectory) -> None:
    problem = build(gate, guess, [], ProblemOptions())
    step = problem.variables.fixed_step
    solution = solve(problem.program, problem.guess, problem.hessian, 30.0, IpoptOptions())
    assert solution.success, solution
    for binding in problem.program.GetAllConstraints():
        evaluator = binding.evaluator()
        x = solution.program_values[problem.program.FindDecisionVariableIndices(binding.variables())]
        assert evaluator.CheckSatisfied(x, FEASIBILITY), evaluator.get_description()
    trajectory = unpack(problem, solution.program_values)
    knots = np.hstack([trajectory.states, trajectory.inputs])
    gap = defects(knots, step, gate.vehicle.wheelbase)[0]
    assert np.abs(gap[:, :3]).max() <= FEASIBILITY
    assert np.abs(gap[:, 3:]).max() <= FEASIBILITY * STATE_SCALE  # v and phi rows are in program units
    ends = trajectory.states[[0, -1], :3]
    np.testing.assert_allclose(ends, [gate.start, gate.goal], atol=IPOPT_BOUND_RELAXATION * STATE_SCALE)


def test_a_hybrid_astar_guess_becomes_a_verified_plan_that_is_cheaper(gate: Scenario, guess: Trajectory) -> None:
    result = optimise(gate, guess, RefineOptions())
    assert result.verification.verified and result.reason == ""
    assert verify(gate, result.trajectory) == result.verification
    assert result.cost.J1 < (guess.t[1] - guess.t[0]) * np.sum(guess.inputs**2)


def test_a_start_at_the_optimum_stays_there(gate: Scenario, guess: Trajectory) -> None:
    first = optimise(gate, guess, RefineOptions())
    again = optimise(gate, first.trajectory, RefineOptions())
    assert again.verification.verified
    assert sum(r.iterations for r in again.rounds) <= sum(r.iterations for r in first.rounds)
    assert again.rounds[0].convex_steps < first.rounds[0].convex_steps
    assert again.cost.J == pytest.approx(first.cost.J, rel=0.01)  # the solver stops at changes of 0.1 %


def test_a_straight_guess_through_a_block_is_pulled_out_by_lines_alone(gate: Scenario) -> None:
    straight = straight_guess(gate, GuessOptions(n_knots=N_KNOTS)).trajectory
    assert straight is not None and min_clearance(gate, gate.vehicle.footprints(straight.poses)) == 0
    options = replace(RefineOptions(), convex=ConvexOptions(most_steps=0))
    result = optimise(gate, straight, options)
    assert result.verification.verified, result.reason
    assert result.rounds[0].lines > 0


def test_a_free_horizon_is_shorter_and_uses_the_limits(gate: Scenario, guess: Trajectory) -> None:
    fixed = optimise(gate, guess, RefineOptions())
    problem = replace(ProblemOptions(), free_horizon=True)
    free = optimise(gate, guess, RefineOptions(problem=problem))
    assert free.verification.verified, free.reason
    assert free.trajectory.duration < 0.95 * fixed.trajectory.duration
    assert np.abs(free.trajectory.states[:, 3]).max() > 0.9 * gate.vehicle.v_max


def test_a_guess_through_the_tip_of_a_thin_wall_goes_round_it() -> None:
    wall = np.array([[9.0, 0.5], [9.1, 0.5], [9.1, 30.0], [9.0, 30.0]])
    scenario = Scenario("wall", np.zeros(3), np.array([18.0, 0.0, 0.0]), (wall,))
    straight = straight_guess(scenario, GuessOptions(n_knots=N_KNOTS)).trajectory
    assert straight is not None
    result = optimise(scenario, straight, RefineOptions())
    assert result.verification.verified, result.reason


def test_margins_yield_to_what_start_and_goal_allow() -> None:
    side = np.array([[-3.0, 1.0], [20.0, 1.0], [20.0, 2.0], [-3.0, 2.0]])  # 5 cm beside the car
    scenario = Scenario("beside a wall", np.zeros(3), np.array([10.0, 0.0, 0.0]), (side,))
    straight = straight_guess(scenario, GuessOptions(n_knots=N_KNOTS)).trajectory
    assert straight is not None
    assert optimise(scenario, straight, RefineOptions()).verification.verified


def test_an_impossible_task_ends_with_the_reason_and_the_best_attempt() -> None:
    ring = np.array([[4.0, -9.0], [5.0, -9.0], [5.0, 9.0], [4.0, 9.0]])
    scenario = Scenario("walled", np.zeros(3) - [6.0, 0, 0], np.array([12.0, 0.0, 0.0]), (ring,), (-10, 20, -9, 9))
    straight = straight_guess(scenario, GuessOptions(n_knots=20)).trajectory
    assert straight is not None
    result = optimise(scenario, straight, RefineOptions(max_rounds=1), time.monotonic() + 5)
    assert not result.verification.verified
    assert "after" in result.reason and len(result.rounds) <= 2


def test_without_time_the_guess_comes_back_unverified(gate: Scenario, guess: Trajectory) -> None:
    result = optimise(gate, guess, RefineOptions(), deadline=time.monotonic())
    assert result.rounds == () and result.trajectory is guess
    assert result.reason == "out of time before the first solve"


def test_a_verified_plan_nearer_than_it_must_be_is_widened_and_kept_where_that_fails(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scenario = Scenario.load("map_b")
    scenario = scenario.translated(-scenario.start[0], -scenario.start[1])
    found = hybrid_astar_guess(scenario, GuessOptions(), time.monotonic() + 30).trajectory
    assert found is not None
    start = gently_timed(found, 1.1 * found.duration, scenario.vehicle)
    options = RefineOptions()
    near = optimise(scenario, start, replace(options, near_share=0.0))
    assert near.verification.verified
    assert near.verification.min_clearance_m < options.near_share * options.threshold
    wide = optimise(scenario, start, options)
    assert wide.verification.verified and len(wide.rounds) == len(near.rounds) + 1
    assert wide.verification.min_clearance_m > near.verification.min_clearance_m

    solve_once, solves = refine._solve_once, []

    def fails_later(*arguments: Any) -> tuple[Trajectory, refine.Round]:
        trajectory, report = solve_once(*arguments)
        solves.append(report)
        if len(solves) <= len(near.rounds):
            return trajectory, report
        return trajectory, replace(report, success=False, verification=verify(scenario, start))

    monkeypatch.setattr(refine, "_solve_once", fails_later)
    kept = optimise(scenario, start, options)
    assert len(kept.rounds) == len(near.rounds) + 1
    assert kept.verification == near.verification and kept.reason == ""
