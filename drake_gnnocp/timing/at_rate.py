r"""A trajectory at rows of a fixed rate whose inputs, linear between the rows, drive the same motion.

The inputs u = (a, w) are linear between knots. A table of rows that misses the knots cannot hold them, and samples of
them drive elsewhere: every knot between two rows leaves an error that adds up. Therefore the rows' inputs are fitted.

1. So that all rows are 1 / rate apart and the last one is the end, the plan is slowed down by less than one row: with
   s = t_final' / t_final the path is the same, v and w are divided by s and a by s^2.
2. u is projected on the functions that are linear between the rows, phi_k being the one that is 1 at row k:

       int (u' - u) phi_k dt = 0  for all rows but the ends, where u' = 0

   Where no knot is missed, u' = u. Elsewhere the errors of v and of the way have ended a few rows after each knot.
3. What is left at the end, e = (x, y, theta, v, phi), is taken away by Newton steps of least size in units of the
   limits, which are kept: u' += W A^T (A W A^T)^-1 e, with A = de/du' along the motion. For a change du of the inputs

       dtheta' = tan(phi) / L_w dv + v / cos(phi)^2 / L_w dphi
       dx(T) = int cos(theta) dv - (y(T) - y) dtheta' dt,  dy(T) = int sin(theta) dv + (x(T) - x) dtheta' dt

The states are those that the inputs drive. What comes out is another trajectory: `verify` it.
"""

from __future__ import annotations

import math

import numpy as np

from drake_gnnocp.simulation import DrivenMotion, drive
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import Input, State, Vehicle

MOST_ROWS = 1_000_000
ON_A_ROW = 1e-6  # rows: an end this near one is on it
NEWTON_STEPS, ARRIVED = 10, 1e-10  # m, rad, m/s: rounding adds up to less
FEWEST = 2  # intervals, of which the plan takes more than one


def at_rate(trajectory: Trajectory, vehicle: Vehicle, rate: float) -> Trajectory:
    """The trajectory with rows every 1 / rate, driven from its first pose at rest; see the module.

    Args:
        trajectory: with inputs of zero at both ends, as plans have.
        vehicle: whose model and limits it is.
        rate: rows a second [Hz].

    Raises:
        ValueError: there would be fewer than FEWEST or more than MOST_ROWS intervals.
    """
    exact = trajectory.duration * rate
    if not FEWEST - 1 < exact <= MOST_ROWS:
        raise ValueError(f"{rate:g} Hz: a plan of {trajectory.duration:.3g} s must have {FEWEST} to {MOST_ROWS} rows")
    n = math.ceil(exact - ON_A_ROW)
    t = np.arange(n + 1) / rate
    slowness = t[-1] / trajectory.duration
    knots = (trajectory.t - trajectory.t[0]) * slowness
    knots[-1] = t[-1]
    inputs = trajectory.inputs / [slowness**2, slowness]
    x0, y0, theta0 = trajectory.poses[0]
    start = np.array([0.0, 0.0, theta0])  # near the origin, where digits are
    states = np.zeros((len(knots), len(State)))
    end = drive(start, Trajectory(knots, states, inputs), vehicle).states[-1]
    end[[State.V, State.PHI]] = 0.0
    fitted, motion = _reaching(end, _projected(t, knots, inputs), start, t, vehicle)
    rows = motion.states[:: motion.steps_per_interval]
    return Trajectory(trajectory.t[0] + t, rows, fitted).translated(x0, y0)


def _projected(t: np.ndarray, knots: np.ndarray, inputs: np.ndarray) -> np.ndarray:
    """The inputs at rows t, in the mean as near to those at knots as functions that are linear between rows can be."""
    parts = np.union1d(t, knots)  # u and phi_k are both linear between these
    u = np.stack([np.interp(parts, knots, column) for column in inputs.T], axis=1)
    row, _ = _places(t, (parts[:-1] + parts[1:]) / 2)
    h, length = t[1] - t[0], np.diff(parts)[:, None]
    later = np.stack([(parts[:-1] - t[row]) / h, (parts[1:] - t[row]) / h])[..., None]  # phi of the next row
    moments = np.zeros((len(t), len(Input)))
    for k, phi in ((row, 1 - later), (row + 1, later)):
        product = phi[0] * (2 * u[:-1] + u[1:]) + phi[1] * (u[:-1] + 2 * u[1:])
        np.add.at(moments, k, length / 6 * product)
    fitted = np.zeros_like(moments)
    fitted[1:-1] = _tridiagonal(4 / 6 * h, h / 6, moments[1:-1])
    return fitted


def _tridiagonal(diagonal: float, beside: float, right: np.ndarray) -> np.ndarray:
    """The solution of equations with constant coefficients on and beside the diagonal, by elimination."""
    ratio, reduced = np.zeros(len(right)), np.zeros_like(right)
    for k in range(len(right)):
        pivot = diagonal - beside * ratio[k - 1] if k else diagonal
        ratio[k] = beside / pivot
        reduced[k] = (right[k] - beside * reduced[k - 1]) / pivot if k else right[k] / pivot
    for k in range(len(right) - 2, -1, -1):
        reduced[k] -= ratio[k] * reduced[k + 1]
    return reduced


def _reaching(
    end: np.ndarray, inputs: np.ndarray, start: np.ndarray, t: np.ndarray, vehicle: Vehicle
) -> tuple[np.ndarray, DrivenMotion]:
    """The inputs at rows changed as little as lets them end in a state (5,), and their motion."""
    limits = np.array([vehicle.a_max, vehicle.w_max])
    blank = np.zeros((len(t), len(State)))
    inputs = np.clip(inputs, -limits, limits)
    motion = drive(start, Trajectory(t, blank, inputs), vehicle)
    for _ in range(NEWTON_STEPS):
        error = end - motion.states[-1]
        if np.abs(error).max() < ARRIVED:
            break
        effect = _effects(motion, t, vehicle)  # (5, N, 2)
        weight = np.where(np.abs(inputs) < limits, limits**2, 0.0)
        weight[[0, -1]] = 0.0
        weighted = (effect * weight).reshape(len(State), -1)
        step = weighted.T @ np.linalg.lstsq(weighted @ effect.reshape(len(State), -1).T, error, rcond=1e-12)[0]
        inputs = np.clip(inputs + step.reshape(inputs.shape), -limits, limits)
        motion = drive(start, Trajectory(t, blank, inputs), vehicle)
    return inputs, motion


def _effects(motion: DrivenMotion, t: np.ndarray, vehicle: Vehicle) -> np.ndarray:
    """A: how the states at the end change with the inputs at the rows, (5, N, 2)."""
    x, y, theta, v, phi = motion.states.T
    turn_v, turn_phi = np.tan(phi) / vehicle.wheelbase, v / np.cos(phi) ** 2 / vehicle.wheelbase
    left, up = y[-1] - y, x[-1] - x
    by_v = np.stack([np.cos(theta) - left * turn_v, np.sin(theta) + up * turn_v, turn_v])  # (3, M)
    by_phi = np.stack([-left * turn_phi, up * turn_phi, turn_phi])
    row, share = _places(t, motion.t)
    step = np.diff(motion.t)
    weight = np.zeros(len(motion.t))  # of the trapezoid rule
    weight[:-1] += step / 2
    weight[1:] += step / 2
    effect = np.zeros((len(State), len(t), len(Input)))
    for column, state, gradient in ((Input.A, State.V, by_v), (Input.W, State.PHI, by_phi)):
        kernels = np.zeros((len(State), len(motion.t)))
        kernels[state] = 1.0
        kernels[: State.V] = _until_the_end(gradient, step)
        for i, kernel in enumerate(kernels * weight):
            effect[i, :, column] = np.bincount(row, kernel * (1 - share), len(t))
            effect[i, :, column] += np.bincount(row + 1, kernel * share, len(t))
    return effect


def _until_the_end(rates: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Integrals (K, M) of rates (K, M) from every sample to the last, by the trapezoid rule."""
    areas = step / 2 * (rates[:, :-1] + rates[:, 1:])
    sums = np.zeros_like(rates)
    sums[:, :-1] = areas[:, ::-1].cumsum(axis=1)[:, ::-1]
    return sums


def _places(t: np.ndarray, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For times (M,) the last of the equally spaced rows t before them, and the share of the way to the next."""
    row = np.clip(t.searchsorted(times, side="right") - 1, 0, len(t) - 2)
    return row, (times - t[row]) / (t[1] - t[0])
