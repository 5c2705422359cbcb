"""SQP steps: what they make of rough guesses, and when they stop."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import count

import numpy as np
import pytest

from drake_gnnocp import Scenario, Trajectory, Vehicle
from drake_gnnocp.budget import Budget
from drake_gnnocp.guesses.straight import straight_line
from drake_gnnocp.ocp.costs import CostWeights
from drake_gnnocp.ocp.dynamics import defects
from drake_gnnocp.ocp.formulation import Formulation, formulate
from drake_gnnocp.ocp.sqp import SEARCHED, SqpSettings, SqpSteps, sqp_steps
from drake_gnnocp.timing.minimum_effort import with_duration
from drake_gnnocp.verification import LIMIT_TOLERANCE, min_clearance

N_KNOTS = 40
AT_THE_ENDS = 1e-6  # m and rad: the solver is asked for 1e-3 of a step, and the last steps are small
UNLIMITED = Budget.unlimited()
WALL = np.array([[4.0, -20.0], [5.0, -20.0], [5.0, 20.0], [4.0, 20.0]])


def budget_of(steps: int) -> Budget:
    """A budget that is over after so many looks at the clock: before each step there is one."""
    ticks: Iterator[int] = count()
    return Budget(steps + 1, clock=lambda: next(ticks))


def straight(scenario: Scenario, hurry: float = 1.0, roughness: float = 0.0, seed: int = 0) -> Formulation:
    """The problem around the straight line.

    Args:
        scenario: the task.
        hurry: how many times as fast as usual.
        roughness: rms of a smooth random shift of x and y [m].
        seed: of the shift.
    """
    line = straight_line(scenario, N_KNOTS)
    states = line.states.copy()
    modes = np.sin(np.linspace(0.0, np.pi, N_KNOTS)[:, None] * np.arange(1, 6))
    shift = modes @ np.random.default_rng(seed).normal(size=(5, 2))
    states[:, :2] += roughness * shift / np.sqrt(np.mean(shift**2, axis=0))
    states[[0, -1]] = line.states[[0, -1]]
    reference = with_duration(Trajectory(line.t, states, line.inputs), line.duration / hurry)
    return formulate(scenario, reference, CostWeights(), margin=0.1)


def assert_drivable(done: SqpSteps, formulation: Formulation) -> None:
    """The steps converged to a motion of the car within its limits, from start to goal."""
    trajectory, vehicle = done.trajectory, formulation.vehicle
    knots = np.hstack([trajectory.states, trajectory.inputs])
    assert done.converged and done.steps <= SEARCHED.most_steps
    assert np.abs(defects(knots, formulation.step, vehicle)[0]).max() < SEARCHED.converged_defect
    most = np.array([vehicle.v_max, vehicle.phi_max, vehicle.a_max, vehicle.w_max])
    assert (np.abs(knots[:, 3:]).max(axis=0) <= most * (1 + LIMIT_TOLERANCE)).all()
    for knot, state in ((0, formulation.start), (-1, formulation.goal)):
        np.testing.assert_allclose(knots[knot], [*state, 0.0, 0.0], atol=AT_THE_ENDS)


def clearance(done: SqpSteps, scenario: Scenario) -> float:
    """The least at the knots [m]."""
    return min_clearance(scenario, scenario.vehicle.footprints(done.trajectory.poses))


def test_steps_lead_a_straight_guess_through_the_gate(gate: Scenario) -> None:
    formulation = straight(gate)
    assert min_clearance(gate, gate.vehicle.footprints(formulation.reference.poses)) == 0
    done = sqp_steps(formulation, SEARCHED, UNLIMITED)
    assert_drivable(done, formulation)
    assert clearance(done, gate) > 0.05  # 0.1 m were asked


@pytest.mark.parametrize("seed", range(4))
def test_steps_converge_from_rough_guesses(gate: Scenario, seed: int) -> None:
    formulation = straight(gate, roughness=1.0, seed=seed)
    done = sqp_steps(formulation, SEARCHED, UNLIMITED)
    assert_drivable(done, formulation)
    assert clearance(done, gate) > 0.05


def test_steps_hold_the_limits_where_they_are_needed(gate: Scenario) -> None:
    formulation = straight(gate, hurry=1.5)
    done = sqp_steps(formulation, SEARCHED, UNLIMITED)
    assert_drivable(done, formulation)
    assert np.abs(done.trajectory.states[:, 3]).max() == pytest.approx(gate.vehicle.v_max, rel=LIMIT_TOLERANCE)


def test_steps_turn_a_car_round() -> None:
    scenario = Scenario("turn", np.zeros(3), np.array([9.0, 5.0, 1.2]))
    formulation = straight(scenario)
    assert_drivable(sqp_steps(formulation, SEARCHED, UNLIMITED), formulation)


def test_ends_in_motion_are_kept(gate: Scenario) -> None:
    resting = straight(gate)
    moving = replace(
        resting,
        start=np.append(resting.start[:3], [0.6, 0.1]),
        goal=np.append(resting.goal[:3], [0.4, -0.05]),
    )
    assert_drivable(sqp_steps(moving, SEARCHED, UNLIMITED), moving)


def test_steps_follow_the_limits_margin_and_the_vehicle(gate: Scenario) -> None:
    small = replace(gate, vehicle=Vehicle(v_max=2.0))
    formulation = replace(straight(small), limits_margin=0.05)
    done = sqp_steps(formulation, SEARCHED, UNLIMITED)
    assert_drivable(done, formulation)
    assert np.abs(done.trajectory.states[1:-1, 3]).max() <= 1.9 * (1 + LIMIT_TOLERANCE)


def test_a_larger_proximal_weight_makes_the_first_step_shorter(gate: Scenario) -> None:
    """The steps start from a motion of the car, so that one of them leads to another, nearly."""
    converged = sqp_steps(straight(gate), SEARCHED, UNLIMITED).trajectory
    free = Scenario("free", gate.start, gate.goal)
    formulation = formulate(free, converged, CostWeights(), margin=0.1)
    moved = []
    for proximal in (0.1, 10.0):
        done = sqp_steps(formulation, SqpSettings(proximal=proximal), budget_of(1))
        assert done.steps == 1 and done.trajectory is not converged
        moved.append(np.abs(done.trajectory.states - converged.states).max())
    assert 0 < moved[1] < 0.7 * moved[0]


def test_a_guess_that_cannot_be_driven_in_its_time_is_left_alone(gate: Scenario) -> None:
    hasty = straight(gate, hurry=50.0)
    done = sqp_steps(hasty, SEARCHED, UNLIMITED)
    assert not done.converged and done.trajectory is hasty.reference and done.violation == np.inf


def test_steps_that_lead_into_obstacles_are_given_up_when_patience_is_over() -> None:
    walled = straight(Scenario("walled", np.array([-6.0, 0.0, 0.0]), np.array([12.0, 0.0, 0.0]), (WALL,)))
    for patience in (3, 5, SEARCHED.most_steps):
        done = sqp_steps(walled, replace(SEARCHED, patience=patience), UNLIMITED)
        assert not done.converged and done.steps == patience and done.violation > 0.3


def test_steps_that_settle_in_an_obstacle_have_not_converged() -> None:
    blocks = [np.array([[6.0, y], [8.0, y], [8.0, y + 9.0], [6.0, y + 9.0]]) for y in (-9.9, 0.9)]
    narrow = straight(Scenario("narrow", np.zeros(3), np.array([14.0, 0.0, 0.0]), tuple(blocks)))
    done = sqp_steps(narrow, SEARCHED, UNLIMITED)
    assert done.steps == SEARCHED.most_steps and not done.converged
    assert done.violation == pytest.approx(0.95 + 0.1 - 0.9, abs=0.02)  # half the car and the margin, in half the gate


def test_patience_is_for_those_that_lead_into_obstacles_only(gate: Scenario) -> None:
    patient, impatient = (
        sqp_steps(straight(gate), replace(SEARCHED, patience=n), UNLIMITED) for n in (SEARCHED.most_steps, 3)
    )
    assert patient.steps == impatient.steps > 3


@pytest.mark.parametrize("steps", [0, 1, 2])
def test_no_step_begins_when_the_budget_is_over(gate: Scenario, steps: int) -> None:
    done = sqp_steps(straight(gate), SEARCHED, budget_of(steps))
    assert done.steps == steps and not done.converged
    assert (done.violation == np.inf) == (steps == 0)


def test_steps_that_were_cut_short_are_used_where_they_lead_nearly_to_a_motion(gate: Scenario) -> None:
    formulation, used = straight(gate, roughness=1.0), []
    for steps in range(6):
        trajectory = sqp_steps(formulation, SEARCHED, budget_of(steps)).trajectory
        used.append(trajectory is not formulation.reference)
        if used[-1]:
            knots = np.hstack([trajectory.states, trajectory.inputs])
            assert np.abs(defects(knots, formulation.step, gate.vehicle)[0]).max() < 0.2
    assert used == sorted(used) and not used[1] and used[-1]
