"""Plans as rows of a fixed rate: the same motion, verified as it is written."""

from __future__ import annotations

import math

import numpy as np
import pytest

from drake_gnnocp import Plan, Scenario, Trajectory, Vehicle, plan, verify
from drake_gnnocp.timing.at_rate import MOST_ROWS, at_rate
from drake_gnnocp.vehicle import State

STEP = 1e-3  # s, of the midpoint rule below, whose error in x and y is STEP^2 / 24 of the second derivative, a second
MIDPOINT_ERROR = 1e-5  # m
SAME_MOTION = 1e-3  # m: rows at 50 Hz miss knots that are 0.2 s apart by 10 ms at most


@pytest.fixture(scope="module")
def made() -> Plan:
    """A plan among obstacles."""
    result = plan("map_d")
    assert result.verified
    return result


def driven(rows: Trajectory, vehicle: Vehicle) -> np.ndarray:
    """Poses at the rows, by the midpoint rule in small steps: an integration that shares nothing with the package's."""
    x, y, theta = rows.poses[0]
    v = phi = 0.0
    poses = [(x, y, theta)]
    for k in range(len(rows) - 1):
        h = rows.t[k + 1] - rows.t[k]
        n = math.ceil(h / STEP)
        for i in range(n):
            a, w = rows.inputs[k] + (i + 0.25) / n * (rows.inputs[k + 1] - rows.inputs[k])  # mean of the first half
            half = h / n / 2
            v_half, phi_half = v + half * a, phi + half * w
            turn = half * v_half * math.tan(phi_half) / vehicle.wheelbase
            x += 2 * half * v_half * math.cos(theta + turn)
            y += 2 * half * v_half * math.sin(theta + turn)
            theta += 2 * turn
            a, w = rows.inputs[k] + (i + 0.5) / n * (rows.inputs[k + 1] - rows.inputs[k])
            v, phi = v + 2 * half * a, phi + 2 * half * w
        poses.append((x, y, theta))
    return np.array(poses)


@pytest.mark.parametrize("rate", [7.0, 30.0, 50.0])
def test_rows_are_exactly_at_the_rate_and_say_where_their_inputs_drive(made: Plan, rate: float) -> None:
    rows = made.resampled(rate).trajectory
    assert rows is not None and made.trajectory is not None
    np.testing.assert_array_equal(rows.t, np.arange(len(rows)) / rate)
    assert 0 <= rows.duration - made.trajectory.duration < 1 / rate
    assert not rows.inputs[[0, -1]].any()
    np.testing.assert_allclose(driven(rows, made.scenario.vehicle), rows.poses, atol=MIDPOINT_ERROR)


def test_the_motion_is_that_of_the_plan_slowed_down_to_end_on_a_row(made: Plan) -> None:
    rows, before = made.resampled(50.0).trajectory, made.trajectory
    assert rows is not None and before is not None
    slowness = rows.duration / before.duration
    at_knots = [np.interp(before.t * slowness, rows.t, column) for column in rows.poses.T]
    # between rows the linear interpolation is off by v^2 / R h^2 / 8, which is less than 0.1 mm here
    np.testing.assert_allclose(np.transpose(at_knots), before.poses, atol=SAME_MOTION)


def test_rows_that_hit_all_knots_keep_the_inputs(made: Plan) -> None:
    before = made.trajectory
    assert before is not None
    rows = at_rate(before, made.scenario.vehicle, 3 * (len(before) - 1) / before.duration)
    np.testing.assert_allclose(rows.inputs[::3], before.inputs, atol=1e-5)  # the plan ends 1e-5 m off its own last knot
    np.testing.assert_allclose(rows.inputs[1::3], (2 * before.inputs[:-1] + before.inputs[1:]) / 3, atol=1e-5)


def test_what_is_verified_is_what_is_written(made: Plan) -> None:
    result = made.resampled(20.0)
    assert result.verified and result.trajectory is not None and result.verification is not None
    again = verify(made.scenario, result.trajectory)
    assert again.verified
    assert again.min_clearance_m == pytest.approx(result.verification.min_clearance_m, abs=1e-9)
    assert result.to_dict()["t_final"] == result.trajectory.duration
    assert made.verified and made.trajectory is not result.trajectory  # the plan itself stays as it is


def test_samples_of_the_inputs_would_drive_elsewhere(made: Plan) -> None:
    """The reason why inputs are fitted."""
    before, vehicle = made.trajectory, made.scenario.vehicle
    assert before is not None
    fitted = at_rate(before, vehicle, 5.0)
    sampled = before.resampled(len(fitted))
    wrong, right = driven(sampled, vehicle)[-1], driven(fitted, vehicle)[-1]
    assert np.abs(right - before.poses[-1])[:2].max() < 1e-4 < np.abs(wrong - before.poses[-1])[:2].max()


def test_rows_that_are_too_far_apart_are_not_called_verified(made: Plan) -> None:
    result = made.resampled(0.5)
    assert result.status == "unverified" and result.reason


def test_a_plan_far_away_is_resampled_there() -> None:
    far = Scenario("far", np.array([7e9, -8e9, 4 * np.pi]), np.array([7e9 + 9, -8e9 + 3, 0.3]))
    result = plan(far).resampled(40.0)
    assert result.verified and result.trajectory is not None
    np.testing.assert_allclose(result.trajectory.states[0, : State.V], far.start, rtol=1e-15)


def test_a_car_that_stays_is_resampled() -> None:
    pose = np.array([1.0, 2.0, 0.5])
    assert plan(Scenario("stay", pose, pose)).resampled(50.0).verified


@pytest.mark.parametrize("rate", [27.0, 203.0])
def test_limits_are_kept_where_inputs_jump_between_them(rate: float) -> None:
    """Full throttle, then full braking: projections overshoot there."""
    vehicle = Vehicle()
    t = np.linspace(0.0, 2.0, 9)
    a = np.array([0.0, 2.0, 2.0, 2.0, 0.0, -2.0, -2.0, -2.0, 0.0])  # 1.5 m/s at its middle
    before = Trajectory(t, np.zeros((9, 5)), np.column_stack([a, 0 * a]))
    rows = at_rate(before, vehicle, rate)
    assert np.abs(rows.inputs[:, 0]).max() <= vehicle.a_max
    # the way of a trapezoidal acceleration up and down: 1.5 m/s for a second in the mean
    assert rows.states[-1, State.X] == pytest.approx(1.5, abs=1e-6)
    np.testing.assert_allclose(rows.states[-1, State.V :], 0.0, atol=1e-9)


@pytest.mark.parametrize("rate", [1e-3, 2e6])
def test_too_few_and_too_many_rows_are_refused(made: Plan, rate: float) -> None:
    with pytest.raises(ValueError, match=f"must have 2 to {MOST_ROWS} rows"):
        made.resampled(rate)
