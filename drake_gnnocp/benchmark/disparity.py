r"""The paper's measures of a guess: how far it is from the optimum that the solver made of it.

Cumulated over the knots k = 1..N, both at the same times:

    sum_k |p_k - p*_k|,   sum_k |theta_k - theta*_k|,   sum_k |v_k - v*_k|,   sum_k |phi_k - phi*_k|
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import State


@dataclass(frozen=True)
class Disparity:
    """Sums over the knots; NaN where there is no optimum."""

    position: float = math.nan  # m
    theta: float = math.nan  # rad
    v: float = math.nan  # m/s
    phi: float = math.nan  # rad


def disparity(guess: Trajectory | None, optimum: Trajectory | None) -> Disparity:
    """The disparity of a guess and an optimum with as many knots."""
    if guess is None or optimum is None:
        return Disparity()
    off = guess.states - optimum.states
    theta = (off[:, State.THETA] + math.pi) % (2 * math.pi) - math.pi
    sums = (np.hypot(off[:, State.X], off[:, State.Y]), theta, off[:, State.V], off[:, State.PHI])
    return Disparity(*(float(np.abs(each).sum()) for each in sums))
