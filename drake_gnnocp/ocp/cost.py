r"""The cost J = lambda1 J1 + lambda2 J2 of the paper, and a weight on time where the horizon is free.

    J1 = int a^2 + w^2 dt                                    smoothness
    J2 = sum_j int gamma^(-d_j^2) dt                         d_j: rear axle to the centroid of obstacle j [m]

Integrals are sums over the knots times h (a and w are zero at both ends, so for J1 that is the trapezoid rule).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from pydrake.autodiffutils import ExtractValue, InitializeAutoDiff
from pydrake.solvers import MathematicalProgram

from drake_gnnocp.ocp.variables import STEP_SCALE, Variables
from drake_gnnocp.trajectory import Trajectory

IPOPT_LARGEST_GRADIENT = 100.0  # its nlp_scaling_max_gradient: larger gradients at the start make it scale the cost


@dataclass(frozen=True)
class CostWeights:
    """Weights of the cost."""

    lambda1: float = 1.0  # of J1
    lambda2: float = 1.0  # of J2
    gamma: float = 1.1  # base of J2, > 1: an obstacle 5 m away costs 0.09 a second (the paper leaves it open)
    time: float = 10.0  # 1/s, weight of t_final where the horizon is free: plans then use most of the limits


@dataclass(frozen=True)
class Cost:
    """What a trajectory costs."""

    J: float
    J1: float
    J2: float


def proximity(positions: np.ndarray, centroids: np.ndarray, gamma: float) -> tuple[np.ndarray, np.ndarray]:
    """gamma^(-d^2) summed over the centroids, at every position, and its gradient.

    Args:
        positions: (N, 2) [m].
        centroids: (J, 2) [m].
        gamma: base, > 1.

    Returns:
        (N,) values and (N, 2) gradients [1/m].
    """
    difference = positions[:, None] - centroids[None]
    near = np.exp(-math.log(gamma) * np.sum(difference**2, axis=2))
    return near.sum(axis=1), -2 * math.log(gamma) * np.einsum("nj,njc->nc", near, difference)


def convex_proximity(
    positions: np.ndarray, centroids: np.ndarray, gamma: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """J2's integrand, its gradient and the convex part of its Hessian.

    Every term bends up along the line to its centroid, from 1 / sqrt(2 ln gamma) on; across it, it bends down.

    Args:
        positions: (N, 2) [m].
        centroids: (J, 2) [m].
        gamma: base, > 1.

    Returns:
        (N,) values, (N, 2) gradients [1/m] and (N, 2, 2) positive semidefinite matrices [1/m^2].
    """
    value, gradient = proximity(positions, centroids, gamma)
    difference = positions[:, None] - centroids
    squared = np.sum(difference**2, axis=2)
    c = math.log(gamma)
    along = 2 * c * np.exp(-c * squared) * np.maximum(2 * c * squared - 1, 0.0) / np.maximum(squared, 1e-12)
    bend = (along[..., None] * difference).transpose(0, 2, 1) @ difference
    return value, gradient, bend


def evaluate_cost(trajectory: Trajectory, centroids: np.ndarray, weights: CostWeights) -> Cost:
    """The paper's cost of a trajectory, for obstacles with the given centroids (J, 2) [m]."""
    h = trajectory.duration / (len(trajectory) - 1)
    j1 = h * float(np.sum(trajectory.inputs**2))
    j2 = h * float(np.sum(proximity(trajectory.poses[:, :2], centroids, weights.gamma)[0]))
    return Cost(weights.lambda1 * j1 + weights.lambda2 * j2, j1, j2)


def add_cost(program: MathematicalProgram, variables: Variables, centroids: np.ndarray, weights: CostWeights) -> float:
    """Add lambda1 J1 (at the guess's h where the horizon is free), lambda2 J2 and the weighted time.

    Returns:
        What the whole cost was multiplied by, so that Ipopt does not scale it: it would scale neither the first BFGS
        matrix nor the tolerances with it.
    """
    h, scale = variables.fixed_step, 1.0
    time_weight = weights.time * (len(variables) - 1) * STEP_SCALE
    if variables.free_horizon:
        scale = min(1.0, IPOPT_LARGEST_GRADIENT / time_weight)
        program.AddLinearCost(np.array([scale * time_weight]), 0.0, variables.step)
    inputs = variables.knots[1:-1, 5:].ravel()
    # diagonal by blocks: one dense matrix over all inputs would cost its square in every evaluation
    for block in np.array_split(inputs, max(1, len(inputs) // 8)):
        hessian = 2 * scale * weights.lambda1 * h * np.eye(len(block))
        program.AddQuadraticCost(hessian, np.zeros(len(block)), block, is_convex=True)
    if len(centroids) and weights.lambda2:
        _add_proximity_cost(program, variables, centroids, weights.gamma, scale * weights.lambda2 * h)
    return scale


def _add_proximity_cost(
    program: MathematicalProgram, variables: Variables, centroids: np.ndarray, gamma: float, factor: float
) -> None:
    def evaluate(x: np.ndarray) -> object:
        with_gradient = x.dtype != float
        values = ExtractValue(x).ravel() if with_gradient else x
        value, gradient = proximity(values.reshape(-1, 2) * variables.state_scale, centroids, gamma)
        total = np.array([factor * value.sum()])
        if not with_gradient:
            return float(total[0])
        return InitializeAutoDiff(total, factor * variables.state_scale * gradient.reshape(1, -1)).item()

    positions = variables.knots[1:-1, :2].ravel()
    program.AddCost(evaluate, positions).evaluator().set_description("J2")
