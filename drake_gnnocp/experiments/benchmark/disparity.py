r"""The paper's measure of a guess: how far it is from the optimum that the solver made of it.

Cumulated over k = 1..N, N = 120 equal steps of their durations:

    sum_k |p_k - p*_k|,   sum_k |theta_k - theta*_k|,   sum_k |v_k - v*_k|,   sum_k |phi_k - phi*_k|
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import State

N_COMPARED = 120  # the paper's number of optimised points: sums over more of them would be larger


@dataclass(frozen=True)
class Disparity:
    """Sums over N_COMPARED points; NaN where there is no optimum."""

    position: float = math.nan  # m
    theta: float = math.nan  # rad
    v: float = math.nan  # m/s
    phi: float = math.nan  # rad


def disparity(guess: Trajectory | None, optimum: Trajectory | None) -> Disparity:
    """The disparity of a guess and an optimum."""
    if guess is None or optimum is None:
        return Disparity()
    off = guess.resampled(N_COMPARED).states - optimum.resampled(N_COMPARED).states
    theta = (off[:, State.THETA] + math.pi) % (2 * math.pi) - math.pi
    sums = (np.hypot(off[:, State.X], off[:, State.Y]), theta, off[:, State.V], off[:, State.PHI])
    return Disparity(*(float(np.abs(distance).sum()) for distance in sums))
