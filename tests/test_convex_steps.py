"""Convex steps before Ipopt: the numbers in a step, and what the steps make of rough guesses."""

import time
from dataclasses import replace

import numpy as np
import pytest

from drake_gnnocp import Scenario, Trajectory, Vehicle
from drake_gnnocp.experiments.ocp_benchmark.guesses import with_noise
from drake_gnnocp.guesses.sources import GuessOptions, straight_guess
from drake_gnnocp.ocp.convex_step import ConvexOptions, convex_steps
from drake_gnnocp.ocp.cost import convex_proximity, proximity
from drake_gnnocp.ocp.dynamics import defects
from drake_gnnocp.ocp.half_planes import SWEPT_GAP, half_planes
from drake_gnnocp.ocp.problem import ProblemOptions
from drake_gnnocp.ocp.refine import RefineOptions, optimise
from drake_gnnocp.ocp.rings import ConvexRings
from drake_gnnocp.verification import min_clearance

DIFFERENCE_STEP = 1e-6
GRADIENT_TOLERANCE = 1e-7  # central differences with this step are good to 1e-9 here
ROUNDING = 1e-12
ROUGH_ITERATIONS = 15  # of Ipopt, the target for rough guesses; BFGS alone takes 40 to 80
N_KNOTS = 60

SQUARE = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]])
TRIANGLE = np.array([[7.0, -4.0], [9.0, -3.0], [7.5, -1.0]])
VEHICLE = Vehicle()


@pytest.fixture(scope="module")
def straight(gate: Scenario) -> Trajectory:
    found = straight_guess(gate, GuessOptions(n_knots=N_KNOTS)).trajectory
    assert found is not None and min_clearance(gate, gate.vehicle.footprints(found.poses)) == 0
    return found


def rows_at(poses: np.ndarray) -> dict[tuple[int, int], tuple[np.ndarray, np.ndarray]]:
    planes = half_planes(poses, ConvexRings.of((SQUARE, TRIANGLE)), VEHICLE, near=3.0)
    own = np.flatnonzero(~planes.between)
    return {(int(planes.knot[i]), int(planes.obstacle[i])): (planes.value[i], planes.gradient[i]) for i in own}


def test_gradients_of_half_planes_match_central_differences() -> None:
    poses = np.random.default_rng(0).uniform([-6.0, -8.0, -3.0], [12.0, 8.0, 3.0], (80, 3))
    rows = {pair: row for pair, row in rows_at(poses).items() if row[0].min() > 0.05}  # an axis may change at 0
    assert len(rows) > 20
    for column in range(3):
        step = DIFFERENCE_STEP * np.eye(3)[column]
        ahead, behind = rows_at(poses + step), rows_at(poses - step)
        for pair, (_, gradient) in rows.items():
            difference = (ahead[pair][0] - behind[pair][0]) / (2 * DIFFERENCE_STEP)
            assert np.abs(difference - gradient[:, column]).max() <= GRADIENT_TOLERANCE, pair


def test_the_least_value_is_the_distance_where_a_side_faces_the_obstacle() -> None:
    gap = 0.7
    poses = np.array([[-9.0, 2.0, 0.0], [-gap - VEHICLE.wheelbase - VEHICLE.front_hang, 2.0, 0.0], [9.0, 2.0, 0.0]])
    planes = half_planes(poses, ConvexRings.of((SQUARE,)), VEHICLE, near=1.0)
    assert planes.knot.tolist() == [1]
    assert planes.value.min() == pytest.approx(gap, abs=ROUNDING)


def test_knots_of_one_visit_are_sent_to_the_same_side() -> None:
    x = np.linspace(-12.0, 12.0, 60)
    poses = np.column_stack([x, np.full(60, 3.5), np.zeros(60)])  # over the square, nearer to its upper edge
    planes = half_planes(poses, ConvexRings.of((SQUARE,)), VEHICLE, near=0.0)
    assert len(planes) > 15
    np.testing.assert_allclose(planes.gradient[..., :2], np.broadcast_to([0.0, 1.0], (len(planes), 2, 2)), atol=1e-12)


def test_an_obstacle_between_two_clear_knots_gets_rows() -> None:
    post = np.array([[0.0, 0.0], [0.1, 0.0], [0.1, 0.1], [0.0, 0.1]])
    front = VEHICLE.wheelbase + VEHICLE.front_hang
    x = np.array([-20.0, -front - 0.05, VEHICLE.rear_hang + 0.15, 20.0])
    planes = half_planes(np.column_stack([x, np.zeros(4), np.zeros(4)]), ConvexRings.of((post,)), VEHICLE, near=1.0)
    assert sorted(planes.knot[planes.between].tolist()) == [1, 2]
    assert planes.value[planes.between].min() < SWEPT_GAP


def test_the_convex_part_of_the_proximity_is_its_second_derivative_towards_the_obstacle() -> None:
    gamma, away = 1.1, np.array([[3.0, 4.0]])  # beyond 1 / sqrt(2 ln gamma) = 2.3 m
    along, step = away[0] / 5.0, 1e-3
    centroid = np.zeros((1, 2))
    values = [proximity(away + shift * along, centroid, gamma)[0][0] for shift in (-step, 0.0, step)]
    _, _, bend = convex_proximity(away, centroid, gamma)
    assert along @ bend[0] @ along == pytest.approx((values[0] - 2 * values[1] + values[2]) / step**2, rel=1e-5)
    positions = np.random.default_rng(0).uniform(-4.0, 4.0, (50, 2))
    assert np.linalg.eigvalsh(convex_proximity(positions, away, gamma)[2]).min() >= -ROUNDING


def test_steps_lead_a_straight_guess_through_the_gate(gate: Scenario, straight: Trajectory) -> None:
    options = ConvexOptions()
    done = convex_steps(gate, straight, ProblemOptions(), options)
    assert done.settled and done.steps < options.most_steps
    knots = np.hstack([done.trajectory.states, done.trajectory.inputs])
    gap = defects(knots, done.trajectory.t[1], gate.vehicle.wheelbase)[0]
    assert np.abs(gap).max() < options.settled_defect
    assert min_clearance(gate, gate.vehicle.footprints(done.trajectory.poses)) > 0.05  # 0.1 m were asked


def test_a_guess_that_cannot_be_driven_in_its_time_is_left_alone(gate: Scenario, straight: Trajectory) -> None:
    hasty = Trajectory(straight.t / 50, straight.states, straight.inputs)
    done = convex_steps(gate, hasty, ProblemOptions(), ConvexOptions())
    assert not done.settled and done.trajectory is hasty


def test_no_step_begins_after_the_deadline(gate: Scenario, straight: Trajectory) -> None:
    done = convex_steps(gate, straight, ProblemOptions(), ConvexOptions(), time.monotonic())
    assert done.steps == 0 and done.trajectory is straight


def test_rough_guesses_cost_ipopt_few_iterations(gate: Scenario, straight: Trajectory) -> None:
    plan = optimise(gate, straight, RefineOptions())
    assert plan.verification.verified, plan.reason
    for seed in range(3):
        rough = with_noise(plan.trajectory, 0.6, np.random.default_rng(seed))
        result = optimise(gate, rough, RefineOptions())
        assert result.verification.verified, result.reason
        first = result.rounds[0]
        assert first.iterations <= ROUGH_ITERATIONS
        assert first.convex_steps > 0 and 0 < first.convex_seconds < first.solve_seconds
        assert result.cost.J <= 1.1 * plan.cost.J  # the gate can be passed in more than one way


def test_without_steps_ipopt_does_it_all(gate: Scenario, straight: Trajectory) -> None:
    options = RefineOptions()
    result = optimise(gate, straight, replace(options, convex=replace(options.convex, most_steps=0)))
    assert result.verification.verified, result.reason
    assert result.rounds[0].convex_steps == 0
