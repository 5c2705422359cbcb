r"""The motion of the car when it is driven by the inputs of a trajectory.

The inputs are linear between knots. With them v and phi are known in closed form (quadratics in time), so theta, x and
y are plain integrals,

    theta(t) = theta_0 + int v tan(phi) / L_w dt,  x(t) = x_0 + int v cos(theta) dt,  y(t) = y_0 + int v sin(theta) dt,

which Simpson's rule gives on steps of at most 5 ms.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import Vehicle

MAX_STEP = 0.005  # s, of the integration
CHECK_STEP = 2  # footprints are looked at in every second integration step, 10 ms apart


@dataclass(frozen=True)
class DrivenMotion:
    """What the car does when it is driven by a trajectory's inputs."""

    t: np.ndarray  # (M,) s, at most 5 ms apart, every knot among them
    states: np.ndarray  # (M, 5) x, y, theta, v, phi [m, m, rad, m/s, rad]
    steps_per_interval: int  # knot k is sample k * steps_per_interval


def drive(start: np.ndarray, trajectory: Trajectory, vehicle: Vehicle) -> DrivenMotion:
    """Integrate the bicycle model from start, at rest, with the trajectory's inputs.

    Args:
        start: (3,) x, y, theta [m, m, rad].
        trajectory: supplies t, a and w at the knots; its states are not used.
        vehicle: supplies the wheelbase.
    """
    h = np.diff(trajectory.t)
    steps = max(2, CHECK_STEP * math.ceil(float(h.max()) / MAX_STEP / CHECK_STEP))
    tau = np.arange(2 * steps) / (2 * steps)  # fractions of an interval: every step and every half step
    a0, w0 = trajectory.inputs[:-1].T
    da, dw = np.diff(trajectory.inputs, axis=0).T
    v = _integral_of_linear(a0, da, h, tau)
    phi = _integral_of_linear(w0, dw, h, tau)
    step = np.repeat(h / steps, steps)  # (M - 1,) s
    theta_rate = v * np.tan(phi) / vehicle.wheelbase
    theta = _cumulative_at_half_steps(start[2], theta_rate, step)
    x = _cumulative_simpson(start[0], v * np.cos(theta), step)
    y = _cumulative_simpson(start[1], v * np.sin(theta), step)
    t = np.append((trajectory.t[:-1, None] + h[:, None] * tau[None, ::2]).ravel(), trajectory.t[-1])
    return DrivenMotion(t, np.column_stack([x, y, theta[::2], v[::2], phi[::2]]), steps)


def _integral_of_linear(u0: np.ndarray, du: np.ndarray, h: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """Integral of u from 0 at the first knot, for u = u0 + du tau on every interval: (2 steps intervals + 1,)."""
    within = h[:, None] * (u0[:, None] * tau + 0.5 * du[:, None] * tau**2)
    at_knots = np.append(0.0, np.cumsum(h * (u0 + 0.5 * du)))
    return np.append((at_knots[:-1, None] + within).ravel(), at_knots[-1])


def _cumulative_simpson(initial: float, rate: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Integral at every step of a rate known at every half step."""
    area = step / 6 * (rate[:-2:2] + 4 * rate[1:-1:2] + rate[2::2])
    return initial + np.append(0.0, np.cumsum(area))


def _cumulative_at_half_steps(initial: float, rate: np.ndarray, step: np.ndarray) -> np.ndarray:
    """As `_cumulative_simpson`, and in between by the parabola through the same three rates."""
    values = np.empty_like(rate)
    values[::2] = _cumulative_simpson(initial, rate, step)
    values[1::2] = values[:-2:2] + step / 24 * (5 * rate[:-2:2] + 8 * rate[1:-1:2] - rate[2::2])
    return values
