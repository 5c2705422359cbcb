"""The numbers of the problem that the peers solve: ours, around the same guess, before any refinement."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from drake_gnnocp.experiments.ocp_benchmark.pair_rows import PairRows, near_pair_rows
from drake_gnnocp.ocp.cost import CostWeights
from drake_gnnocp.ocp.refine import RefineOptions
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.verification import min_clearance

N_STATES, N_KNOT = 5, 7  # x, y, theta, v, phi; and a, w
POINTS_PER_PAIR = 2  # as ours; with all corners and vertices the peer took 1.5 times as long


@dataclass(frozen=True)
class SideRows:
    """Rows of one side of the bounds: sign * (coordinate - bound) >= margin of all corners."""

    axis: int  # 0: x, 1: y
    sign: float
    bound: float  # m
    knots: np.ndarray  # (K,) that come near the side at the guess


@dataclass(frozen=True)
class PeerProblem:
    """One program in numbers."""

    scenario: Scenario
    guess: Trajectory
    goal: np.ndarray  # (3,) with the turns of the guess [m, m, rad]
    pairs: list[PairRows]
    sides: list[SideRows]
    margin: float  # m, of the pairs
    bounds_margin: float  # m, of the sides
    limits: np.ndarray  # (4,) of |v|, |phi|, |a|, |w| [m/s, rad, m/s^2, rad/s]
    weights: CostWeights
    centroids: np.ndarray  # (J, 2) [m]

    @property
    def step(self) -> float:
        """The time step h, fixed [s]."""
        return self.guess.duration / (len(self.guess) - 1)

    @property
    def n_rows(self) -> int:
        """Scalar constraints, bounds on variables aside."""
        dynamics = N_STATES * (len(self.guess) - 1)
        corners = sum(len(self.scenario.vehicle.corners) * len(side.knots) for side in self.sides)
        return dynamics + corners + sum(len(rows.knot) for rows in self.pairs)


def peer_problem(scenario: Scenario, guess: Trajectory, options: RefineOptions) -> PeerProblem:
    """The problem of a scenario near the origin around a guess, with the margins and the weights of our options."""
    problem, vehicle, poses = options.problem, scenario.vehicle, guess.poses
    ends = vehicle.footprints(np.stack([scenario.start, scenario.goal]))
    turns = 2 * math.pi * round((poses[-1, 2] - scenario.goal[2]) / (2 * math.pi))
    pairs = near_pair_rows(poses, scenario.convex_obstacles, vehicle, problem.near, POINTS_PER_PAIR)
    bounds_margin = problem.bounds_margin
    for axis, sign, bound in _sides(scenario):
        bounds_margin = min(bounds_margin, options.end_share * float((sign * (ends[..., axis] - bound)).min()))
    return PeerProblem(
        scenario=scenario,
        guess=guess,
        goal=scenario.goal + [0.0, 0.0, turns],
        pairs=pairs,
        sides=[_near_side(vehicle.footprints(poses), *side, problem.near) for side in _sides(scenario)],
        margin=min(problem.margin, options.end_share * min_clearance(scenario, ends)),
        bounds_margin=max(bounds_margin, 0.0),
        limits=np.array([vehicle.v_max, vehicle.phi_max, vehicle.a_max, vehicle.w_max]),
        weights=problem.weights,
        centroids=np.array([[p.centroid.x, p.centroid.y] for p in scenario.polygons]).reshape(-1, 2),
    )


def _sides(scenario: Scenario) -> list[tuple[int, float, float]]:
    """(axis, sign, bound) of xmin, xmax, ymin, ymax."""
    if scenario.bounds is None:
        return []
    xmin, xmax, ymin, ymax = scenario.bounds
    return [(0, 1.0, xmin), (0, -1.0, xmax), (1, 1.0, ymin), (1, -1.0, ymax)]


def _near_side(footprints: np.ndarray, axis: int, sign: float, bound: float, near: float) -> SideRows:
    distance = (sign * (footprints[..., axis] - bound)).min(axis=1)
    distance[[0, -1]] = np.inf  # fixed
    return SideRows(axis, sign, bound, np.flatnonzero(distance < near))
