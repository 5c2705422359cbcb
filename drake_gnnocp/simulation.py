"""The motion of a vehicle when it is driven by the inputs of a trajectory, which are linear between knots.

v and phi are integrals of the inputs; with them the vehicle's rates of x, y and theta are integrated by Simpson's rule.
The verification has an integration of its own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import State, Vehicle

MAX_STEP = 0.005  # s, of the integration
MOTION = [State.V, State.PHI]


@dataclass(frozen=True, eq=False)
class DrivenMotion:
    """What the car does when it is driven by a trajectory's inputs."""

    t: np.ndarray  # (M,) s, at most 5 ms apart, every knot among them
    states: np.ndarray  # (M, 5) x, y, theta, v, phi [m, m, rad, m/s, rad]
    steps_per_interval: int  # even; knot k is sample k * steps_per_interval


def drive(start: np.ndarray, trajectory: Trajectory, vehicle: Vehicle) -> DrivenMotion:
    """Integrate the vehicle's model from start, at rest, with the trajectory's inputs.

    Args:
        start: (3,) x, y, theta [m, m, rad].
        trajectory: supplies t, a and w at the knots; its states are not used.
        vehicle: whose model it is.
    """
    h = np.diff(trajectory.t)
    steps = max(2, 2 * math.ceil(float(h.max()) / MAX_STEP / 2))
    halves = np.arange(2 * steps) / (2 * steps)  # of an interval: every step and every half step
    t = np.append((trajectory.t[:-1, None] + h[:, None] * halves).ravel(), trajectory.t[-1])
    inputs = np.stack([np.interp(t, trajectory.t, column) for column in trajectory.inputs.T], axis=1)
    states = np.zeros((len(t), len(State)))
    # exact: the inputs are linear within every half step
    states[1:, MOTION] = np.cumsum(np.diff(t)[:, None] * (inputs[1:] + inputs[:-1]) / 2, axis=0)
    states[:, State.THETA] = start[State.THETA]
    states[:, State.THETA] += _integral(vehicle.rates(states, inputs)[:, State.THETA], t)
    rates = vehicle.rates(states, inputs)
    for axis in (State.X, State.Y):
        states[:, axis] = start[axis] + _integral(rates[:, axis], t)
    return DrivenMotion(t[::2], states[::2], steps)


def _integral(rate: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Integral of a rate (2 M + 1,) from the first instant to each: Simpson's rule, and its parabola in the middle."""
    step = t[2::2] - t[:-2:2]
    first, middle, last = rate[:-2:2], rate[1:-1:2], rate[2::2]
    integral = np.zeros_like(rate)
    integral[2::2] = np.cumsum(step / 6 * (first + 4 * middle + last))
    integral[1::2] = integral[:-2:2] + step / 24 * (5 * first + 8 * middle - last)
    return integral
