r"""Measures of a guess. The paper's: how far it is from the optimum that the solver made of it.

Cumulated over k = 1..N, N = 120 equal steps of their durations:

    sum_k |p_k - p*_k|,   sum_k |theta_k - theta*_k|,   sum_k |v_k - v*_k|,   sum_k |phi_k - phi*_k|
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import shapely

from drake_gnnocp.ocp.dynamics import defects
from drake_gnnocp.scenario import Scenario
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
    return Disparity(*(float(np.abs(each).sum()) for each in sums))


def blocked_share(scenario: Scenario, guess: Trajectory | None) -> float:
    """Share of a guess's knots at which the car touches an obstacle; NaN without a guess."""
    if guess is None:
        return math.nan
    cars = shapely.polygons(scenario.vehicle.footprints(guess.poses))
    touching = [shapely.intersects(polygon, cars) for polygon in scenario.polygons]
    return float(np.any(touching, axis=0).mean()) if touching else 0.0


def mean_gap(scenario: Scenario, guess: Trajectory | None) -> float:
    """Mean distance by which a guess misses the kinematic model from one knot to the next [m]; NaN without one."""
    if guess is None:
        return math.nan
    knots = np.hstack([guess.states, guess.inputs])
    missed, _ = defects(knots, guess.duration / (len(guess) - 1), scenario.vehicle.wheelbase)
    return float(np.hypot(missed[:, State.X], missed[:, State.Y]).mean())
