r"""The motion that the inputs of a trajectory drive, with a bound on every error: an integration of its own.

Between knots a and w are linear, so v and phi are quadratics in time, known exactly; theta, x and y are integrals,

    theta(t) = theta_0 + int v tan(phi) / L_w dt,  x(t) = x_0 + int v cos(theta) dt,  y(t) = y_0 + int v sin(theta) dt,

which Simpson's rule gives on steps s with an error of s^5 / 2880 |f''''| a step. The steps are as long as keeps the
error of the whole motion below MOST_ERROR.

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

MOST_ERROR = 1e-6  # m, that the integration may add up to at any point of the car
SHORTEST_STEP = 5e-4  # s, of the integration, whatever its error
MOST_STEPS, LONGEST = 1_000_000, 1e5  # of the integration; s, the longest drive: more are refused
ORDER = 5  # coefficients of a series of bounds: up to the fourth derivative
ROUNDING = 1e-9  # m: what a few thousand additions of numbers up to 1e4 may be off
SIMPSON = np.array([1, 4, 1]) / 6  # weights of values now, half-way and then in the integral until then
TURNED = np.array([[0, 0, 0], [5, 8, -1], [4, 16, 4]]) / 24  # and in the integrals until now, half-way and then

Series = np.ndarray  # (ORDER, K): coefficients of bounds, one column for every interval


@dataclass(frozen=True, eq=False)
class Motion:
    """What the car does, near the origin."""

    t: np.ndarray  # (M,) s, every knot among them
    states: np.ndarray  # (M, 5) x, y, theta, v, phi [m, m, rad, m/s, rad]
    inputs: np.ndarray  # (M, 2) a, w [m/s^2, rad/s]
    slopes: np.ndarray  # (M - 1, 2) of the inputs, until the next sample
    knots: np.ndarray  # (K + 1,) the samples that are knots
    times: np.ndarray  # (K + 1,) of the knots [s]
    wheelbase: float  # m
    errors: np.ndarray  # (K + 1,) most that any point of the car is away from where the states say until a knot [m]
    heading_error: float  # most that the heading is off at any time [rad]
    bends: np.ndarray  # (K,) largest acceleration of any point of the car between two knots [m/s^2]
    peaks: np.ndarray  # (2, K) largest |v| and |phi| between two knots [m/s, rad]

    def poses_at(self, times: np.ndarray) -> np.ndarray:
        """Poses (N, 3) at times (N,), within the errors of the next knot: Simpson's rule from the sample before."""
        i = self.t[1:-1].searchsorted(times, side="right")
        tau, now = times - self.t[i], self.states[i].T
        rates, slopes = self.inputs[i].T * (tau / 2), self.slopes[i].T * (tau**2 / 8)
        v, phi = np.stack([now[3:], now[3:] + rates + slopes, now[3:] + 2 * rates + 4 * slopes], axis=1)  # (3, N) each
        turn, way = tau / self.wheelbase * v * np.tan(phi), tau * v
        headings = now[2] + TURNED @ turn  # (3, N): now, half-way and then
        poses = np.empty((len(times), 3))
        poses[:, 0] = now[0] + SIMPSON @ (way * np.cos(headings))
        poses[:, 1] = now[1] + SIMPSON @ (way * np.sin(headings))
        poses[:, 2] = headings[2]
        return poses


def motion_of(start: np.ndarray, trajectory: Trajectory, vehicle: Vehicle) -> Motion:
    """The motion from a pose (3,), at rest, with the trajectory's inputs; its states are not used.

    Raises:
        OverflowError: it takes longer than LONGEST, or more than MOST_STEPS steps.
    """
    h, inputs = np.diff(trajectory.t), trajectory.inputs
    slope = np.diff(inputs, axis=0) / h[:, None]
    at_knots = np.zeros_like(inputs)  # v, phi
    at_knots[1:] = np.cumsum(h[:, None] * (inputs[:-1] + inputs[1:]) / 2, axis=0)
    peaks = np.stack([_peaks(at_knots[:, i], inputs[:, i], h) for i in (Input.A, Input.W)])  # (2, K)
    heading_errors, position_errors, bends = _bounds(peaks, inputs, h, vehicle)
    ways, farthest = h * peaks[0], float(np.linalg.norm(vehicle.corners, axis=1).max())
    off = math.sqrt(2.0) * (position_errors + heading_errors * ways.sum()) + farthest * heading_errors
    shares = off * h.sum() / (MOST_ERROR * h)  # of what may be added up, in one step; NaN where there is no bound
    steps = np.ceil(np.fmin(np.maximum(shares, 1.0) ** 0.25, np.ceil(h / SHORTEST_STEP)))
    if steps.sum() > MOST_STEPS or h.sum() > LONGEST:
        raise OverflowError(f"{h.sum():.3g} s in {steps.sum():.3g} steps are too many to be integrated")
    n = steps.astype(int)
    knots = np.append(0, np.cumsum(n))
    interval = np.repeat(np.arange(len(n)), 2 * n)  # of every half step
    since = (np.arange(2 * knots[-1]) - 2 * knots[interval]) * (h / (2 * n))[interval]
    since, interval = np.append(since, h[-1]), np.append(interval, len(n) - 1)
    reached = inputs[interval] + since[:, None] * slope[interval]
    v, phi = (at_knots[interval] + since[:, None] / 2 * (inputs[interval] + reached)).T
    step = np.repeat(h / n, n)  # (M - 1,) s
    theta = _cumulative_at_half_steps(start[2], v * np.tan(phi) / vehicle.wheelbase, step)
    x = _cumulative_simpson(start[0], v * np.cos(theta), step)
    y = _cumulative_simpson(start[1], v * np.sin(theta), step)
    headings = np.append(0.0, np.cumsum(heading_errors / n**4))
    errors = np.append(0.0, np.cumsum(position_errors / n**4 + ways * headings[1:]))
    errors = np.nan_to_num(math.sqrt(2.0) * errors + farthest * headings + ROUNDING, nan=np.inf, posinf=np.inf)
    return Motion(
        t=(trajectory.t[interval] + since)[::2],
        states=np.column_stack([x, y, theta[::2], v[::2], phi[::2]]),
        inputs=reached[::2],
        slopes=slope[interval[:-1:2]],
        knots=knots,
        times=trajectory.t,
        wheelbase=vehicle.wheelbase,
        errors=errors,
        heading_error=float(headings[-1]),
        bends=bends,
        peaks=peaks,
    )


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
    peaks: np.ndarray, inputs: np.ndarray, h: np.ndarray, vehicle: Vehicle
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """For every interval the errors that one step adds to the heading and to x or y, and the largest acceleration.

    In n steps the errors are n^4 times smaller.

    Args:
        peaks: (2, K) largest |v| and |phi|.
        inputs: (K + 1, 2) at the knots.
        h: (K,) of the intervals [s].
        vehicle: whose model it is.
    """
    largest = np.maximum(np.abs(inputs[:-1]), np.abs(inputs[1:])).T  # (2, K)
    v, phi = np.zeros((2, ORDER, len(h)))
    for i, series in ((Input.A, v), (Input.W, phi)):
        series[:3] = peaks[i], largest[i], np.abs(np.diff(inputs[:, i])) / (2 * h)
    with np.errstate(over="ignore", invalid="ignore"):  # infinite times zero, which is no bound
        turn = _product(v, _tan(phi)) / vehicle.wheelbase  # theta'
        along = _product(v, _circular(turn))  # x' and y'
    # Simpson's rule: step^5 / 2880 times the fourth derivative, 24 c_4
    heading = h**5 / 120 * turn[4]
    # the heading in the middle of a step is the parabola's, (step / 2)^4 / 24 times the third derivative off
    position = h**5 / 120 * along[4] + h * peaks[0] * h**4 / 64 * turn[3]
    farthest = float(np.linalg.norm(vehicle.corners, axis=1).max())
    # p = x + R c:  p'' = a e + v theta' e_perp + theta'' c_perp - theta'^2 c
    acceleration = np.hypot(largest[0], peaks[0] * turn[0]) + farthest * (turn[1] + turn[0] ** 2)
    heading, position, acceleration = np.nan_to_num([heading, position, acceleration], nan=np.inf, posinf=np.inf)
    return heading, position, acceleration


def _product(first: Series, second: Series) -> Series:
    product = np.zeros_like(first)
    for k in range(ORDER):
        product[k:] += first[k] * second[: ORDER - k]
    return product


def _tan(phi: Series) -> Series:
    """Bounds of tan(phi); infinite where the steering angle reaches a right angle."""
    series = np.zeros_like(phi)
    series[0] = np.where(phi[0] < math.pi / 2, np.tan(phi[0]), np.inf)
    rate, square = phi[1:] * np.arange(1, ORDER)[:, None], np.empty_like(phi)  # phi', and 1 + tan^2
    for k in range(ORDER - 1):
        square[k] = (series[: k + 1] * series[k::-1]).sum(axis=0) + (k == 0)
        series[k + 1] = (rate[: k + 1] * square[k::-1]).sum(axis=0) / (k + 1)
    return series


def _circular(rate: Series) -> Series:
    """Bounds of the cosine and the sine of an angle with a rate: each is the integral of the other times the rate."""
    series = np.ones_like(rate)
    for k in range(ORDER - 1):
        series[k + 1] = (series[: k + 1] * rate[k::-1]).sum(axis=0) / (k + 1)
    return series
