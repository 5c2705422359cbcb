"""Solve, verify, answer: what the loop makes of guesses, and how it ends."""

from dataclasses import replace

import numpy as np
import pytest

from drake_gnnocp import Scenario, Trajectory
from drake_gnnocp.budget import Budget
from drake_gnnocp.guesses import Guess, HybridAStar
from drake_gnnocp.guesses.straight import straight_line
from drake_gnnocp.ocp import refine as module
from drake_gnnocp.ocp.costs import CostWeights, evaluate_cost
from drake_gnnocp.ocp.dynamics import defects
from drake_gnnocp.ocp.formulation import Formulation, formulate
from drake_gnnocp.ocp.ipopt import FINISH, USUAL, IpoptSettings, solve
from drake_gnnocp.ocp.nlp import STATE_SCALE, build
from drake_gnnocp.ocp.refine import MOST_ANSWERS, Refined, Solve, refine
from drake_gnnocp.ocp.sqp import SEARCHED, SqpSteps, sqp_steps
from drake_gnnocp.ocp.triangle_areas import triangle_areas
from drake_gnnocp.timing.minimum_effort import with_minimum_effort
from drake_gnnocp.verification import min_clearance, verify

N_KNOTS = 60
UNLIMITED = Budget.unlimited()
IPOPT_BOUND_RELAXATION = 1e-8  # relative, Ipopt's default bound_relax_factor, in program variables
ROUGH_ITERATIONS = 15  # of Ipopt, the target for rough guesses; BFGS alone takes 40 to 80


def hybrid_astar(scenario: Scenario, knots: int) -> Trajectory:
    found = next(HybridAStar(knots).guesses(scenario, UNLIMITED))
    assert isinstance(found, Guess)
    return found.trajectory


def problem(scenario: Scenario, guess: Trajectory, minimum_time: bool = False) -> Formulation:
    return formulate(scenario, guess, CostWeights(), margin=0.1, minimum_time=minimum_time)


def stepped(scenario: Scenario, formulation: Formulation) -> tuple[SqpSteps, Refined]:
    """SQP steps, and the loop from where they led."""
    steps = sqp_steps(formulation, SEARCHED, UNLIMITED)
    return steps, refine(scenario, formulation, UNLIMITED, steps)


def cost(scenario: Scenario, refined: Refined) -> float:
    assert refined.trajectory is not None
    return evaluate_cost(refined.trajectory, scenario, CostWeights()).J


def with_noise(trajectory: Trajectory, amplitude: float, seed: int) -> Trajectory:
    """The trajectory with x and y moved smoothly by `amplitude` [m] each (rms over the knots), the ends kept."""
    modes = np.sin(np.linspace(0.0, np.pi, len(trajectory))[:, None] * np.arange(1, 6))
    move = modes @ np.random.default_rng(seed).normal(size=(5, 2))
    states = trajectory.states.copy()
    states[:, :2] += amplitude * move / np.sqrt(np.mean(move**2, axis=0))
    states[[0, -1]] = trajectory.states[[0, -1]]  # sin(m pi) is not quite 0
    return Trajectory(trajectory.t, states, trajectory.inputs)


@pytest.fixture(scope="module")
def guess(gate: Scenario) -> Trajectory:
    return hybrid_astar(gate, N_KNOTS)


@pytest.fixture(scope="module")
def plan(gate: Scenario, guess: Trajectory) -> Refined:
    refined = stepped(gate, problem(gate, guess))[1]
    assert refined.verified and refined.reason == ""
    return refined


def test_the_solution_holds_every_constraint_to_the_solvers_tolerance(gate: Scenario, guess: Trajectory) -> None:
    nlp = build(problem(gate, guess))
    solution = solve(nlp.program, nlp.first_iterate, nlp.hessian, 30.0, USUAL)
    assert solution.success, solution
    for binding in nlp.program.GetAllConstraints():
        evaluator = binding.evaluator()
        x = solution.program_values[nlp.program.FindDecisionVariableIndices(binding.variables())]
        assert evaluator.CheckSatisfied(x, USUAL.feasibility), evaluator.get_description()
    trajectory = nlp.trajectory(solution.program_values)
    defect = defects(np.hstack([trajectory.states, trajectory.inputs]), nlp.fixed_step, gate.vehicle)[0]
    assert np.abs(defect[:, :3]).max() <= USUAL.feasibility
    assert np.abs(defect[:, 3:]).max() <= USUAL.feasibility * STATE_SCALE  # v and phi rows are in program units
    ends = trajectory.states[[0, -1], :3]
    np.testing.assert_allclose(ends, [gate.start, gate.goal], atol=IPOPT_BOUND_RELAXATION * STATE_SCALE)


def test_a_hybrid_astar_guess_becomes_a_verified_plan_that_is_cheaper(
    gate: Scenario, guess: Trajectory, plan: Refined
) -> None:
    assert plan.trajectory is not None and plan.best is not None
    assert verify(gate, plan.trajectory) == plan.solves[plan.best].verification
    assert cost(gate, plan) < evaluate_cost(guess, gate, CostWeights()).J


def test_a_start_at_the_optimum_stays_there(gate: Scenario, guess: Trajectory, plan: Refined) -> None:
    assert plan.trajectory is not None
    before = sqp_steps(problem(gate, guess), SEARCHED, UNLIMITED)
    steps, again = stepped(gate, problem(gate, plan.trajectory))
    assert again.verified
    assert again.solves[0].iterations <= plan.solves[0].iterations
    assert steps.steps < before.steps
    assert cost(gate, again) == pytest.approx(cost(gate, plan), rel=0.01)  # the solver stops at changes of 0.1 %


@pytest.mark.parametrize("seed", range(3))
def test_rough_guesses_cost_ipopt_few_iterations(gate: Scenario, plan: Refined, seed: int) -> None:
    assert plan.trajectory is not None
    steps, refined = stepped(gate, problem(gate, with_noise(plan.trajectory, 0.6, seed)))
    assert refined.verified, refined.reason
    assert steps.converged and refined.solves[0].iterations <= ROUGH_ITERATIONS
    assert cost(gate, refined) <= 1.1 * cost(gate, plan)  # the gate can be passed in more than one way


def test_without_steps_a_straight_guess_through_a_block_is_pulled_out_by_lines_alone(gate: Scenario) -> None:
    straight = straight_line(gate, N_KNOTS)
    assert min_clearance(gate, gate.vehicle.footprints(straight.poses)) == 0
    refined = refine(gate, problem(gate, straight), UNLIMITED)
    assert refined.verified, refined.reason
    assert refined.solves[0].lines > 0


def test_where_time_is_minimised_the_plan_is_shorter_and_uses_the_limits(
    gate: Scenario, guess: Trajectory, plan: Refined
) -> None:
    free = refine(gate, problem(gate, guess, minimum_time=True), UNLIMITED)
    assert free.verified and free.trajectory is not None and plan.trajectory is not None, free.reason
    assert free.trajectory.duration < 0.95 * plan.trajectory.duration
    assert np.abs(free.trajectory.states[:, 3]).max() > 0.9 * gate.vehicle.v_max


def test_a_guess_through_the_tip_of_a_thin_wall_goes_round_it() -> None:
    wall = np.array([[9.0, 0.5], [9.1, 0.5], [9.1, 30.0], [9.0, 30.0]])
    scenario = Scenario("wall", np.zeros(3), np.array([18.0, 0.0, 0.0]), (wall,))
    refined = stepped(scenario, problem(scenario, straight_line(scenario, N_KNOTS)))[1]
    assert refined.verified, refined.reason


def test_margins_yield_to_what_start_and_goal_allow() -> None:
    side = np.array([[-3.0, 1.0], [20.0, 1.0], [20.0, 2.0], [-3.0, 2.0]])  # 5 cm beside the car
    scenario = Scenario("beside a wall", np.zeros(3), np.array([10.0, 0.0, 0.0]), (side,))
    formulation = problem(scenario, straight_line(scenario, N_KNOTS))
    assert stepped(scenario, formulation)[1].verified
    assert refine(scenario, formulation, UNLIMITED).verified


def test_an_impossible_task_ends_with_the_reason_and_the_best_solve() -> None:
    ring = np.array([[4.0, -9.0], [5.0, -9.0], [5.0, 9.0], [4.0, 9.0]])
    scenario = Scenario("walled", np.array([-6.0, 0, 0]), np.array([12.0, 0.0, 0.0]), (ring,), (-10, 20, -9, 9))
    brief = replace(USUAL, max_iterations=10)
    refined = refine(scenario, problem(scenario, straight_line(scenario, 20)), UNLIMITED, settings=brief)
    assert not refined.verified and refined.best is not None
    assert refined.solves[refined.best].merit == min(solve.merit for solve in refined.solves)
    faults = ", ".join(refined.solves[refined.best].verification.faults)
    assert refined.reason.startswith(f"the optimised plan {faults} after {len(refined.solves)} solve")
    assert refined.solves[-1].status not in refined.reason


def test_without_time_nothing_is_solved(gate: Scenario, guess: Trajectory) -> None:
    budget = Budget(0.0)
    refined = refine(gate, problem(gate, guess), budget)
    assert refined.solves == () and refined.reason == "the budget of 0 s ended before the first solve"
    assert budget.ended
    assert refined.trajectory is None and not refined.verified


def test_ipopt_stops_with_the_budget(gate: Scenario) -> None:
    formulation = problem(gate, straight_line(gate, N_KNOTS))
    budget = Budget(0.0)
    solved = module.solve_once(gate, formulation, USUAL, budget)
    assert not solved.success and solved.status == "Wall time exceeded" and budget.ended


def test_a_plan_keeps_clear_of_what_its_guess_kept_clear_of() -> None:
    scenario = Scenario.load("map_b")
    scenario = scenario.translated(-scenario.start[0], -scenario.start[1])
    found = hybrid_astar(scenario, 120)
    start = with_minimum_effort(found, 1.1 * found.duration, scenario.vehicle)
    refined = stepped(scenario, problem(scenario, start))[1]
    assert refined.verified and refined.best is not None
    assert refined.solves[refined.best].verification.min_clearance_m > 0.01


# --- what the loop hands to the solver ---


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Formulation, IpoptSettings]]:
    """The problems and settings of all solves, each of which fails."""
    found: list[tuple[Formulation, IpoptSettings]] = []

    def fail(scenario: Scenario, formulation: Formulation, settings: IpoptSettings, budget: Budget) -> Solve:
        found.append((formulation, settings))
        reference = formulation.reference
        check = replace(verify(scenario, reference), collision_free=False)
        return Solve(0.0, 0.0, 1, False, "failed", (), 0, 0, reference, check)

    monkeypatch.setattr(module, "solve_once", fail)
    return found


def test_after_steps_that_converged_the_solver_only_finishes(
    gate: Scenario, guess: Trajectory, asked: list[tuple[Formulation, IpoptSettings]]
) -> None:
    formulation = problem(gate, guess)
    steps = sqp_steps(formulation, SEARCHED, UNLIMITED)
    assert steps.converged
    refine(gate, formulation, UNLIMITED, steps)
    (finish, settings), (again, usual) = asked[:2]
    assert settings == FINISH and finish.reference is steps.trajectory
    rows = sum(len(block.lower) for block in triangle_areas(finish))
    assert rows < sum(len(block.lower) for block in triangle_areas(replace(formulation, reference=steps.trajectory)))
    # what the steps left is asked for: the cost would lead nearer
    nearest = min(block.function(block.numbers(finish.knots, finish.step))[0].min() for block in triangle_areas(finish))
    lowest = min(block.lower.min() for block in triangle_areas(finish))
    assert lowest == pytest.approx(min(nearest, 0.1))

    # it failed: the guess as it was given
    assert again.reference is guess and usual == USUAL
    assert (again.reference_share, again.rows_within) == (formulation.reference_share, formulation.rows_within)


def test_steps_that_did_not_converge_are_a_start_for_the_usual_solver(
    gate: Scenario, guess: Trajectory, asked: list[tuple[Formulation, IpoptSettings]]
) -> None:
    formulation = problem(gate, guess)
    steps = replace(sqp_steps(formulation, SEARCHED, UNLIMITED), converged=False)
    patient = replace(USUAL, max_iterations=300)
    refine(gate, formulation, UNLIMITED, steps, settings=patient)
    (first, settings), *_ = asked
    assert settings == patient and first.reference is steps.trajectory
    assert first.rows_within == formulation.rows_within


def test_a_failed_solve_from_the_guess_is_not_made_again(
    gate: Scenario, guess: Trajectory, asked: list[tuple[Formulation, IpoptSettings]]
) -> None:
    refined = refine(gate, problem(gate, guess), UNLIMITED)
    assert len(refined.solves) == len(asked) == 1
    assert not refined.verified and refined.reason.endswith("after 1 solve")


def test_there_are_no_more_answers_than_these(
    gate: Scenario, guess: Trajectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    def collide(scenario: Scenario, formulation: Formulation, *_: object) -> Solve:
        check = replace(verify(scenario, formulation.reference), collision_free=False)
        return Solve(0.0, 0.0, 1, True, "solved", (), 0, 0, formulation.reference, check)

    monkeypatch.setattr(module, "solve_once", collide)
    refined = refine(gate, problem(gate, guess), UNLIMITED)
    assert len(refined.solves) == 1 + MOST_ANSWERS and not refined.verified
    monkeypatch.setattr(module, "MOST_ITERATIONS", 2)  # of which each takes one
    assert len(refine(gate, problem(gate, guess), UNLIMITED).solves) == 2
