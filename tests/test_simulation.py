"""The motion that verification drives, against an independent integrator and closed forms."""

import math

import numpy as np
import pytest

from drake_gnnocp.simulation import MAX_STEP, drive
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import State, Vehicle

SAME_MOTION = 1e-10  # m and rad: Simpson on 5 ms steps and RK4 on 1 ms agree to 4e-12 over the few metres here
EXACT = 1e-11  # m: Simpson's rule is exact for cubics, what is left is rounding over a thousand steps
ORIGIN = np.zeros(3)


def random_inputs(rng: np.random.Generator, n: int = 12) -> Trajectory:
    """Wild but drivable inputs at unequal knots; the states are left empty, as `drive` must not use them."""
    t = 3.0 + np.cumsum(rng.uniform(0.02, 0.8, n))
    return Trajectory(t, np.full((n, 5), np.nan), rng.uniform(-1, 1, (n, 2)) * [2.0, 0.3] + [0.5, 0.1])


def rk4(start: np.ndarray, trajectory: Trajectory, vehicle: Vehicle, step: float = 1e-3) -> np.ndarray:
    """State at every knot by the classical Runge-Kutta method on `Vehicle.rates`: (N, 5)."""

    def inputs(t: float) -> np.ndarray:
        return np.array([np.interp(t, trajectory.t, column) for column in trajectory.inputs.T])

    state = np.append(start, [0.0, 0.0])
    states = [state]
    for begin, end in zip(trajectory.t[:-1], trajectory.t[1:], strict=True):
        n = math.ceil((end - begin) / step)
        h = (end - begin) / n
        for t in begin + h * np.arange(n):
            first, middle, last = inputs(t), inputs(t + h / 2), inputs(t + h)
            k1 = vehicle.rates(state, first)
            k2 = vehicle.rates(state + h / 2 * k1, middle)
            k3 = vehicle.rates(state + h / 2 * k2, middle)
            k4 = vehicle.rates(state + h * k3, last)
            state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        states.append(state)
    return np.array(states)


@pytest.mark.parametrize("seed", range(2))
def test_the_driven_motion_is_that_of_an_independent_integrator(seed: int) -> None:
    trajectory = random_inputs(np.random.default_rng(seed))
    vehicle, start = Vehicle(wheelbase=2.5), np.array([5.0, -3.0, 2.0])
    motion = drive(start, trajectory, vehicle)
    at_knots = motion.states[:: motion.steps_per_interval]
    np.testing.assert_allclose(at_knots, rk4(start, trajectory, vehicle), rtol=0, atol=SAME_MOTION)
    assert np.ptp(at_knots, axis=0).min() > 0.2  # every state moved: the comparison above is one of something


def test_samples_are_at_most_the_step_apart_and_every_knot_is_among_them() -> None:
    trajectory = random_inputs(np.random.default_rng(4))
    motion = drive(ORIGIN, trajectory, Vehicle())
    assert 0 < np.diff(motion.t).min() <= np.diff(motion.t).max() <= MAX_STEP * (1 + EXACT)
    np.testing.assert_allclose(motion.t[:: motion.steps_per_interval], trajectory.t, rtol=EXACT)
    assert len(motion.t) == len(motion.states)


def test_a_straight_line_with_linear_acceleration_is_a_cubic() -> None:
    trajectory = Trajectory(np.array([0.0, 3.0]), np.zeros((2, 5)), np.array([[0.5, 0.0], [1.1, 0.0]]))
    heading = 0.7
    motion = drive(np.array([1.0, 2.0, heading]), trajectory, Vehicle())
    distance = 0.5 * motion.t**2 / 2 + 0.2 * motion.t**3 / 6  # a(t) = 0.5 + 0.2 t
    np.testing.assert_allclose(motion.states[:, State.X], 1 + distance * math.cos(heading), atol=EXACT)
    np.testing.assert_allclose(motion.states[:, State.Y], 2 + distance * math.sin(heading), atol=EXACT)
    np.testing.assert_allclose(motion.states[:, State.V], 0.5 * motion.t + 0.1 * motion.t**2, atol=EXACT)
    np.testing.assert_array_equal(motion.states[:, State.THETA], heading)


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_with_steady_steering_the_rear_axle_follows_a_circle(direction: float) -> None:
    # steer at standstill to phi = 0.5 (w a triangle), then go: v = direction (t - 2)^2 / 4 up to t = 4
    w = [0.0, 0.5, 0.0, 0.0]
    a = [0.0, 0.0, 0.0, direction]
    trajectory = Trajectory(np.array([0.0, 1.0, 2.0, 4.0]), np.zeros((4, 5)), np.column_stack([a, w]))
    motion = drive(ORIGIN, trajectory, Vehicle())
    radius = 2.8 / math.tan(0.5)
    distance = direction * np.maximum(motion.t - 2, 0) ** 3 / 12
    circle = np.column_stack(
        [radius * np.sin(distance / radius), radius * (1 - np.cos(distance / radius)), distance / radius]
    )
    np.testing.assert_allclose(motion.states[:, : State.V], circle, atol=SAME_MOTION)
