r"""The motion that the inputs of a trajectory drive, with a bound on every error: an integration of its own.

Between knots a and w are linear, so v and phi are quadratics in time, known exactly; theta, x and y are integrals,

    theta(t) = theta_0 + int v tan(phi) / L_w dt,  x(t) = x_0 + int v cos(theta) dt,  y(t) = y_0 + int v sin(theta) dt,

which Simpson's rule gives on steps s of at most 5 ms, with an error of s^5 / 2880 |f''''| a step.

The derivatives of the integrands are bounded with power series of bounds: a list c_0, c_1, ... with |f^(k)| / k! <= c_k
over an interval. Sums and products of functions have the sums and products of their series; tan and the circular
functions follow from their differential equations, tan' = (1 + tan^2) phi', cos' = -sin theta', sin' = cos theta'.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import Input, Vehicle

MAX_STEP = 0.005  # s, of the integration
ORDER = 5  # coefficients of a series of bounds: up to the fourth derivative
ROUNDING = 1e-9  # m: what a few thousand additions of numbers up to 1e4 may be off

Series = list[np.ndarray]  # ORDER coefficients, (K,) each: one for every interval


@dataclass(frozen=True, eq=False)
class Motion:
    """What the car does, near the origin."""

    t: np.ndarray  # (M,) s, at most MAX_STEP apart, every knot among them
    states: np.ndarray  # (M, 5) x, y, theta, v, phi [m, m, rad, m/s, rad]
    inputs: np.ndarray  # (M, 2) a, w [m/s^2, rad/s]
    wheelbase: float  # m
    errors: np.ndarray  # (M,) most that any point of the car is away from where the states say [m]
    heading_errors: np.ndarray  # (M,) [rad]
    bends: np.ndarray  # (M - 1,) largest acceleration of any point of the car within a step [m/s^2]
    steps_per_interval: int  # knot k is sample k * steps_per_interval
    peaks: np.ndarray  # (2,) largest |v| and |phi| at any time [m/s, rad]

    def step_at(self, times: np.ndarray) -> np.ndarray:
        """The step that times (N,) lie in."""
        return np.clip(np.searchsorted(self.t, times, side="right") - 1, 0, len(self.t) - 2)

    def poses_at(self, times: np.ndarray) -> np.ndarray:
        """Poses (N, 3) at times (N,), within the errors of the next sample: Simpson's rule from the one before."""
        i = self.step_at(times)
        tau, span = times - self.t[i], self.t[i + 1] - self.t[i]
        x, y, theta, v, phi = self.states[i].T
        slope = (self.inputs[i + 1] - self.inputs[i]) / span[:, None]
        at = []  # speed and turning rate now, half-way and then
        for part in (0.0, 0.5, 1.0):
            since = (part * tau)[:, None]
            change = since * self.inputs[i] + since**2 / 2 * slope
            speed = v + change[:, 0]
            at.append((speed, speed * np.tan(phi + change[:, 1]) / self.wheelbase))
        (v0, g0), (v1, g1), (v2, g2) = at
        middle, last = theta + tau / 24 * (5 * g0 + 8 * g1 - g2), theta + tau / 6 * (g0 + 4 * g1 + g2)
        x = x + tau / 6 * (v0 * np.cos(theta) + 4 * v1 * np.cos(middle) + v2 * np.cos(last))
        y = y + tau / 6 * (v0 * np.sin(theta) + 4 * v1 * np.sin(middle) + v2 * np.sin(last))
        return np.stack([x, y, last], axis=1)


def motion_of(start: np.ndarray, trajectory: Trajectory, vehicle: Vehicle) -> Motion:
    """The motion from a pose (3,), at rest, with the trajectory's inputs; its states are not used."""
    h = np.diff(trajectory.t)
    steps = max(2, math.ceil(float(h.max()) / MAX_STEP))
    tau = np.arange(2 * steps) / (2 * steps)  # fractions of an interval: every step and every half step
    a0, w0 = trajectory.inputs[:-1].T
    da, dw = np.diff(trajectory.inputs, axis=0).T
    v, phi = _integral_of_linear(a0, da, h, tau), _integral_of_linear(w0, dw, h, tau)
    step = np.repeat(h / steps, steps)  # (M - 1,) s
    theta = _cumulative_at_half_steps(start[2], v * np.tan(phi) / vehicle.wheelbase, step)
    x = _cumulative_simpson(start[0], v * np.cos(theta), step)
    y = _cumulative_simpson(start[1], v * np.sin(theta), step)
    t = np.append((trajectory.t[:-1, None] + h[:, None] * tau[None, ::2]).ravel(), trajectory.t[-1])
    at_knots = np.stack([v, phi], axis=1)[:: 2 * steps]
    peaks = np.stack([_peaks(at_knots[:, i], trajectory.inputs[:, i], h) for i in (Input.A, Input.W)])  # (2, K)
    heading_error, position_error, bend = _bounds(peaks, trajectory.inputs, h, h / steps, vehicle)
    headings = np.append(0.0, np.cumsum(np.repeat(heading_error, steps)))
    errors = np.append(0.0, np.cumsum(np.repeat(position_error, steps)))
    errors += np.append(0.0, np.cumsum(step * np.repeat(peaks[0], steps) * headings[1:]))
    farthest = float(np.linalg.norm(vehicle.corners, axis=1).max())
    return Motion(
        t=t,
        states=np.column_stack([x, y, theta[::2], v[::2], phi[::2]]),
        inputs=np.stack([np.interp(t, trajectory.t, column) for column in trajectory.inputs.T], axis=1),
        wheelbase=vehicle.wheelbase,
        errors=math.sqrt(2.0) * errors + farthest * headings + ROUNDING,
        heading_errors=headings,
        bends=np.repeat(bend, steps),
        steps_per_interval=steps,
        peaks=peaks.max(axis=1),
    )


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


def _peaks(values: np.ndarray, rates: np.ndarray, h: np.ndarray) -> np.ndarray:
    """Largest size of a quadratic on every interval (K,), from its values and rates at the knots (K + 1,)."""
    change = np.diff(rates)
    # where the rate is zero within the interval, the quadratic has its vertex
    turns = np.divide(-rates[:-1], change, out=np.full(len(h), -1.0), where=change != 0)
    inside = (turns > 0) & (turns < 1)
    vertex = np.where(inside, values[:-1] + h * (rates[:-1] * turns + 0.5 * change * turns**2), 0.0)
    return np.maximum(np.abs(vertex), np.maximum(np.abs(values[:-1]), np.abs(values[1:])))


def _bounds(
    peaks: np.ndarray, inputs: np.ndarray, h: np.ndarray, step: np.ndarray, vehicle: Vehicle
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """For every interval the errors that a step adds to the heading and to x or y, and the largest acceleration.

    Args:
        peaks: (2, K) largest |v| and |phi|.
        inputs: (K + 1, 2) at the knots.
        h: (K,) of the intervals [s].
        step: (K,) of the integration [s].
        vehicle: whose model it is.
    """
    largest = np.maximum(np.abs(inputs[:-1]), np.abs(inputs[1:])).T  # (2, K)
    bends = np.abs(np.diff(inputs, axis=0)).T / (2 * h)
    zero = np.zeros(len(h))
    v: Series = [peaks[0], largest[0], bends[0], zero, zero]
    phi: Series = [peaks[1], largest[1], bends[1], zero, zero]
    with np.errstate(over="ignore", invalid="ignore"):
        tan = _tan(phi)
    turn = [c / vehicle.wheelbase for c in _product(v, tan)]  # theta'
    along = _product(v, _circular(turn))  # x' and y'
    # Simpson's rule: step^5 / 2880 times the fourth derivative, 24 c_4
    heading = step**5 / 120 * turn[4]
    # the heading in the middle of a step is the parabola's, (step / 2)^4 / 24 times the third derivative off
    position = step**5 / 120 * along[4] + step * peaks[0] * step**4 / 64 * turn[3]
    farthest = float(np.linalg.norm(vehicle.corners, axis=1).max())
    # p = x + R c:  p'' = a e + v theta' e_perp + theta'' c_perp - theta'^2 c
    acceleration = np.hypot(largest[0], peaks[0] * turn[0]) + farthest * (turn[1] + turn[0] ** 2)
    return tuple(np.where(np.isnan(bound), np.inf, bound) for bound in (heading, position, acceleration))  # type: ignore[return-value]


def _product(first: Series, second: Series) -> Series:
    return [sum(first[i] * second[k - i] for i in range(k + 1)) for k in range(ORDER)]  # type: ignore[misc]


def _tan(phi: Series) -> Series:
    """Bounds of tan(phi); infinite where the steering angle reaches a right angle."""
    with np.errstate(invalid="ignore"):
        series: Series = [np.where(phi[0] < math.pi / 2, np.tan(phi[0]), np.inf)]
        for k in range(ORDER - 1):
            known = [*series, *[np.zeros_like(phi[0])] * (ORDER - len(series))]
            square = _product(known, known)
            square[0] = square[0] + 1.0
            series.append(sum(square[i] * (k - i + 1) * phi[k - i + 1] for i in range(k + 1)) / (k + 1))  # type: ignore[arg-type]
    return series


def _circular(rate: Series) -> Series:
    """Bounds of the cosine and the sine of an angle with a rate: each is the integral of the other times the rate."""
    series: Series = [np.ones_like(rate[0])]
    for k in range(ORDER - 1):
        series.append(sum(series[i] * rate[k - i] for i in range(k + 1)) / (k + 1))  # type: ignore[arg-type]
    return series
