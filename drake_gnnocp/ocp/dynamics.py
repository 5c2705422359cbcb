r"""Direct collocation of the kinematic bicycle model (Hermite-Simpson; Hargraves and Paris 1987).

States are cubic and inputs linear between knots k and k+1, h apart, and the model holds at the middle:

    x_m = (x_k + x_{k+1}) / 2 + h / 8 (f_k - f_{k+1}),        u_m = (u_k + u_{k+1}) / 2
    x_{k+1} - x_k - h / 6 (f_k + 4 f(x_m, u_m) + f_{k+1}) = 0

which is 2 h / 3 times the defect of Drake's `DirectCollocationConstraint`. For v and phi it reduces to the trapezoid
rule: linear in the knots as long as h is fixed, and then given to the solver as linear constraints.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from pydrake.solvers import LinearEqualityConstraint, MathematicalProgram

from drake_gnnocp.ocp.variables import N_KNOT, N_STATES, STEP_SCALE, Variables, add_block
from drake_gnnocp.vehicle import Input, State, Vehicle

BLOCK = 20  # intervals in one callback: one interval each is 3 times slower, all in one slower too
POSE_ROWS, ALL_ROWS = 3, 5  # rows an interval: x, y, theta; with a free horizon v and phi as well
X, Y, THETA, V, PHI = State
A, W = (N_STATES + column for column in Input)


def defects(knots: np.ndarray, h: float, wheelbase: float) -> tuple[np.ndarray, np.ndarray]:
    """Defects of every interval and their derivatives.

    Args:
        knots: (K + 1, 7) x, y, theta, v, phi, a, w in SI units.
        h: time step [s].
        wheelbase: L_w [m].

    Returns:
        (K, 5) defects of x, y, theta, v, phi, and (K, 5, 15) their derivatives with respect to the 7 values of the left
        knot, the 7 of the right knot, and h.
    """
    left, right = knots[:-1], knots[1:]
    rates, d_rates = _pose_rates(knots, wheelbase)  # (K + 1, 3), (K + 1, 3, 7)
    f0, f1 = rates[:-1], rates[1:]
    middle, d_middle = _middle(left, right, f0[:, 2], f1[:, 2], d_rates, h)
    fm, d_fm = _pose_rates(middle, wheelbase)
    d_fm = d_fm[..., THETA : PHI + 1] @ d_middle  # (K, 3, 15)

    value = np.empty((len(left), ALL_ROWS))
    derivative = np.zeros((len(left), ALL_ROWS, 2 * N_KNOT + 1))
    value[:, :3] = right[:, :3] - left[:, :3] - h / 6 * (f0 + 4 * fm + f1)
    derivative[:, :3] = -2 * h / 3 * d_fm
    derivative[:, :3, :N_KNOT] -= h / 6 * d_rates[:-1]
    derivative[:, :3, N_KNOT : 2 * N_KNOT] -= h / 6 * d_rates[1:]
    derivative[:, :3, -1] -= (f0 + 4 * fm + f1) / 6
    for state, rate in ((V, A), (PHI, W)):
        mean_rate = (left[:, rate] + right[:, rate]) / 2
        value[:, state] = right[:, state] - left[:, state] - h * mean_rate
        derivative[:, state, [rate, N_KNOT + rate]] = -h / 2
        derivative[:, state, -1] = -mean_rate
    for row in range(ALL_ROWS):
        derivative[:, row, row] -= 1
        derivative[:, row, N_KNOT + row] += 1
    return value, derivative


def _pose_rates(knots: np.ndarray, wheelbase: float) -> tuple[np.ndarray, np.ndarray]:
    """x', y', theta' (K, 3) and their derivatives (K, 3, 7) with respect to a knot's values."""
    theta, v, phi = knots[:, THETA], knots[:, V], knots[:, PHI]
    cos, sin, tan = np.cos(theta), np.sin(theta), np.tan(phi)
    rates = np.stack([v * cos, v * sin, v * tan / wheelbase], axis=1)
    derivative = np.zeros((len(knots), POSE_ROWS, N_KNOT))
    derivative[:, X, THETA], derivative[:, X, V] = -rates[:, Y], cos
    derivative[:, Y, THETA], derivative[:, Y, V] = rates[:, X], sin
    derivative[:, THETA, V] = tan / wheelbase
    derivative[:, THETA, PHI] = v * (1 + tan**2) / wheelbase
    return rates, derivative


def _middle(
    left: np.ndarray, right: np.ndarray, turn0: np.ndarray, turn1: np.ndarray, d_rates: np.ndarray, h: float
) -> tuple[np.ndarray, np.ndarray]:
    """The knot in the middle of every interval (K, 7), and the derivatives (K, 3, 15) of its theta, v and phi.

    Its x and y, which no rate depends on, are not those of the cubic.
    """
    middle = (left + right) / 2
    derivative = np.zeros((len(left), 3, 2 * N_KNOT + 1))
    middle[:, THETA] += h / 8 * (turn0 - turn1)
    derivative[:, 0, :N_KNOT] = h / 8 * d_rates[:-1, THETA]
    derivative[:, 0, N_KNOT : 2 * N_KNOT] = -h / 8 * d_rates[1:, THETA]
    derivative[:, 0, -1] = (turn0 - turn1) / 8
    for row, (state, rate) in ((1, (V, A)), (2, (PHI, W))):
        difference = left[:, rate] - right[:, rate]
        middle[:, state] += h / 8 * difference
        derivative[:, row, rate], derivative[:, row, N_KNOT + rate] = h / 8, -h / 8
        derivative[:, row, -1] = difference / 8
    for row, state in enumerate((THETA, V, PHI)):
        derivative[:, row, state] += 0.5
        derivative[:, row, N_KNOT + state] += 0.5
    return middle, derivative


def add_dynamics(program: MathematicalProgram, variables: Variables, vehicle: Vehicle) -> None:
    """Require all defects to vanish."""
    if not variables.free_horizon:
        _add_trapezoid_rule(program, variables)
    for first in range(0, len(variables) - 1, BLOCK):
        _add_block_of_defects(program, variables, vehicle, first, min(first + BLOCK, len(variables) - 1))


def _add_trapezoid_rule(program: MathematicalProgram, variables: Variables) -> None:
    """v_{k+1} - v_k = h (a_k + a_{k+1}) / 2 and phi likewise, for a fixed h."""
    half = variables.fixed_step / 2 / variables.state_scale
    # one evaluator for all rows: making one takes pydrake a search for scipy
    row = LinearEqualityConstraint(np.array([[-1.0, 1.0, -half, -half]]), np.zeros(1))
    row.set_description("trapezoid rule")
    for state, rate in ((V, A), (PHI, W)):
        x, u = variables.knots[:, state], variables.knots[:, rate]
        for k in range(len(variables) - 1):
            program.AddConstraint(row, np.array([x[k], x[k + 1], u[k], u[k + 1]]))


def _add_block_of_defects(
    program: MathematicalProgram, variables: Variables, vehicle: Vehicle, first: int, last: int
) -> None:
    n_intervals, n_step = last - first, len(variables.step)
    n_rows = ALL_ROWS if variables.free_horizon else POSE_ROWS
    entries = _structure(n_rows, n_step)
    interval, row = np.arange(n_intervals)[:, None], entries[:, 0]
    in_knots = entries[:, 1] < 2 * N_KNOT
    rows = (interval * n_rows + row).ravel()
    columns = np.where(in_knots, interval * N_KNOT + entries[:, 1], (n_intervals + 1) * N_KNOT).ravel()
    knot_scale = variables.knot_scale
    scale = np.concatenate([knot_scale, knot_scale, [STEP_SCALE]])[entries[:, 1]]

    def evaluate(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        h = float(x[-1]) * STEP_SCALE if n_step else variables.fixed_step
        knots = x[: (n_intervals + 1) * N_KNOT].reshape(-1, N_KNOT) * knot_scale
        value, derivative = defects(knots, h, vehicle.wheelbase)
        return value[:, :n_rows].ravel(), (derivative[:, row, entries[:, 1]] * scale).ravel()

    zeros = np.zeros(n_intervals * n_rows)
    block = np.append(variables.knots[first : last + 1].ravel(), variables.step)
    add_block(program, evaluate, zeros, zeros, block, rows, columns, f"dynamics of intervals {first} to {last - 1}")


@lru_cache
def _structure(n_rows: int, n_step: int) -> np.ndarray:
    """Entries (row, column) of one interval's derivative that are not always zero: (P, 2)."""
    generic = np.random.default_rng(0).uniform(0.1, 0.5, (2, N_KNOT))
    _, derivative = defects(generic, 0.3, 2.8)
    return np.argwhere(derivative[0, :n_rows, : 2 * N_KNOT + n_step] != 0)
