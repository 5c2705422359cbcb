r"""Direct collocation of the vehicle's model (Hermite-Simpson; Hargraves and Paris 1987).

States are cubic and inputs linear between knots k and k+1, h apart, and the model holds at the middle:

    x_m = (x_k + x_{k+1}) / 2 + h / 8 (f_k - f_{k+1}),        u_m = (u_k + u_{k+1}) / 2
    x_{k+1} - x_k - h / 6 (f_k + 4 f(x_m, u_m) + f_{k+1}) = 0

which is 2 h / 3 times the defect of Drake's `DirectCollocationConstraint`. For v and phi it reduces to the trapezoid
rule, linear in the knots as long as h is fixed.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from drake_gnnocp.ocp.formulation import Formulation
from drake_gnnocp.ocp.rows import N_KNOT, N_STATES, PHI, THETA, A, RowBlock, V, W
from drake_gnnocp.vehicle import Vehicle

BLOCK = 20  # intervals in one callback: one interval each is 3 times slower, all in one slower too
POSE_ROWS = 3  # of an interval: x, y, theta
INTEGRATED = ((V, A), (PHI, W))  # states whose rate is an input


def dynamics(formulation: Formulation, states: int, intervals: int = BLOCK) -> list[RowBlock]:
    """All defects vanish, in blocks of intervals.

    Args:
        formulation: the problem; where it minimises time, h is one of the numbers.
        states: rows of an interval, of the first so many states: 3 leave out those that are linear for a fixed h.
        intervals: in a block, at most.
    """
    n = len(formulation.reference)
    firsts = range(0, n - 1, intervals)
    return [_block(formulation, first, min(first + intervals, n - 1), states) for first in firsts]


def _block(formulation: Formulation, first: int, last: int, states: int) -> RowBlock:
    n_intervals, with_step = last - first, formulation.minimum_time
    entries = _structure(states, with_step)
    row, column = entries.T
    interval = np.arange(n_intervals)[:, None]
    in_knots = column < 2 * N_KNOT
    n_knot_numbers = (n_intervals + 1) * N_KNOT

    def evaluate(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        h = float(x[-1]) if with_step else formulation.step
        value, derivative = defects(x[:n_knot_numbers].reshape(-1, N_KNOT), h, formulation.vehicle)
        return value[:, :states].ravel(), derivative[:, row, column].ravel()

    zeros = np.zeros(n_intervals * states)
    return RowBlock(
        description=f"dynamics of intervals {first} to {last - 1}",
        function=evaluate,
        lower=zeros,
        upper=zeros,
        rows=(interval * states + row).ravel(),
        columns=np.where(in_knots, interval * N_KNOT + column, n_knot_numbers).ravel(),
        knots=np.arange(first, last + 1),
        knot_columns=np.arange(N_KNOT),
        with_step=with_step,
    )


@lru_cache
def _structure(states: int, with_step: bool) -> np.ndarray:
    """Entries (row, column) of one interval's derivative that are not always zero: (P, 2)."""
    generic = np.random.default_rng(0).uniform(0.1, 0.5, (2, N_KNOT))
    _, derivative = defects(generic, 0.3, Vehicle())
    return np.argwhere(derivative[0, :states, : 2 * N_KNOT + with_step] != 0)


def defects(knots: np.ndarray, h: float, vehicle: Vehicle) -> tuple[np.ndarray, np.ndarray]:
    """Defects of every interval and their derivatives.

    Args:
        knots: (K + 1, 7) x, y, theta, v, phi, a, w in SI units.
        h: time step [s].
        vehicle: whose model it is.

    Returns:
        (K, 5) defects of x, y, theta, v, phi, and (K, 5, 15) their derivatives with respect to the 7 values of the left
        knot, the 7 of the right knot, and h.
    """
    left, right = knots[:-1], knots[1:]
    rates, d_rates = vehicle.pose_rates(knots[:, :N_STATES])  # (K + 1, 3), (K + 1, 3, 5)
    f0, f1 = rates[:-1], rates[1:]
    middle, d_middle = _middle(left, right, f0[:, 2], f1[:, 2], d_rates[:, THETA], h)
    fm, d_fm = vehicle.pose_rates(middle[:, :N_STATES])
    d_fm = d_fm[..., THETA : PHI + 1] @ d_middle  # (K, 3, 15)

    value = np.empty((len(left), N_STATES))
    derivative = np.zeros((len(left), N_STATES, 2 * N_KNOT + 1))
    value[:, :POSE_ROWS] = right[:, :POSE_ROWS] - left[:, :POSE_ROWS] - h / 6 * (f0 + 4 * fm + f1)
    derivative[:, :POSE_ROWS] = -2 * h / 3 * d_fm
    derivative[:, :POSE_ROWS, :N_STATES] -= h / 6 * d_rates[:-1]
    derivative[:, :POSE_ROWS, N_KNOT : N_KNOT + N_STATES] -= h / 6 * d_rates[1:]
    derivative[:, :POSE_ROWS, -1] -= (f0 + 4 * fm + f1) / 6
    for state, rate in INTEGRATED:
        mean_rate = (left[:, rate] + right[:, rate]) / 2
        value[:, state] = right[:, state] - left[:, state] - h * mean_rate
        derivative[:, state, [rate, N_KNOT + rate]] = -h / 2
        derivative[:, state, -1] = -mean_rate
    for row in range(N_STATES):
        derivative[:, row, row] -= 1
        derivative[:, row, N_KNOT + row] += 1
    return value, derivative


def _middle(
    left: np.ndarray, right: np.ndarray, turn0: np.ndarray, turn1: np.ndarray, d_turn: np.ndarray, h: float
) -> tuple[np.ndarray, np.ndarray]:
    """The knot in the middle of every interval (K, 7), and the derivatives (K, 3, 15) of its theta, v and phi.

    Its x and y, which no rate depends on, are not those of the cubic. `turn0` and `turn1` (K,) are theta' at the ends
    of the intervals, `d_turn` (K + 1, 5) its derivatives at the knots.
    """
    middle = (left + right) / 2
    derivative = np.zeros((len(left), 3, 2 * N_KNOT + 1))
    middle[:, THETA] += h / 8 * (turn0 - turn1)
    derivative[:, 0, :N_STATES] = h / 8 * d_turn[:-1]
    derivative[:, 0, N_KNOT : N_KNOT + N_STATES] = -h / 8 * d_turn[1:]
    derivative[:, 0, -1] = (turn0 - turn1) / 8
    for row, (state, rate) in enumerate(INTEGRATED, start=1):
        difference = left[:, rate] - right[:, rate]
        middle[:, state] += h / 8 * difference
        derivative[:, row, rate], derivative[:, row, N_KNOT + rate] = h / 8, -h / 8
        derivative[:, row, -1] = difference / 8
    for row, state in enumerate((THETA, V, PHI)):
        derivative[:, row, state] += 0.5
        derivative[:, row, N_KNOT + state] += 0.5
    return middle, derivative
