r"""The cost J = lambda1 J1 + lambda2 J2 of the paper, each term defined once for all solvers.

    J1 = int a^2 + w^2 dt                                    smoothness
    J2 = sum_j int gamma^(-d_j^2) dt                         d_j: rear axle to the centroid of obstacle j [m]

Integrals are sums over the knots times h (a and w are zero at both ends, so for J1 that is the trapezoid rule).
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from numbers import Real
from typing import ClassVar, Protocol

import numpy as np

from drake_gnnocp.ocp.rows import A, W, X, Y
from drake_gnnocp.trajectory import Trajectory

TINY = 1e-12  # m^2, squared distances below have no direction
LARGEST_WEIGHT = 1e6  # far larger ones leave the solvers no digits


@dataclass(frozen=True)
class CostWeights:
    """Weights of the cost.

    Raises:
        ValueError: a weight is not a number in (0, LARGEST_WEIGHT] (lambda2 may be 0), or gamma is not above 1.
    """

    lambda1: float = 1.0  # of J1, which no problem can do without: Ipopt's first Hessian is made of it
    lambda2: float = 1.0  # of J2
    gamma: float = 1.1  # base of J2, > 1: an obstacle 5 m away costs 0.09 a second (the paper leaves it open)
    time: float = 10.0  # 1/s, weight of t_final where it is minimised: plans then use most of the limits

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            least = 1.0 if name == "gamma" else 0.0
            is_number = isinstance(value, Real) and not isinstance(value, bool)
            if not is_number or not (least < value <= LARGEST_WEIGHT or name == "lambda2" and value == 0):
                at_least = "from" if name == "lambda2" else "above"
                raise ValueError(f"cost.{name}: must be {at_least} {least:g} to {LARGEST_WEIGHT:g}, not {value!r}")


@dataclass(frozen=True)
class Cost:
    """What a trajectory costs."""

    J: float
    J1: float
    J2: float


class CostTerm(Protocol):
    """An integrand over the knots, a function of some columns of a knot."""

    @property
    def description(self) -> str:
        """The paper's name of the term."""
        ...

    @property
    def columns(self) -> np.ndarray:
        """Columns of a knot that it depends on: (C,)."""
        ...

    @property
    def is_quadratic(self) -> bool:
        """Whether its Hessian is the same everywhere and convex."""
        ...

    def evaluate(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values (N,) and gradients (N, C) at the columns' values (N, C)."""
        ...

    def convex_hessian(self, values: np.ndarray) -> np.ndarray:
        """The positive semidefinite part of the Hessian at the columns' values (N, C): (N, C, C)."""
        ...


@dataclass(frozen=True)
class Smoothness:
    """weight (a^2 + w^2)."""

    weight: float
    description: ClassVar[str] = "J1"
    columns: ClassVar[np.ndarray] = np.array([A, W])
    is_quadratic: ClassVar[bool] = True

    def evaluate(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `CostTerm`."""
        return self.weight * np.sum(values**2, axis=1), 2 * self.weight * values

    def convex_hessian(self, values: np.ndarray) -> np.ndarray:
        """See `CostTerm`."""
        return np.broadcast_to(2 * self.weight * np.eye(2), (len(values), 2, 2))


@dataclass(frozen=True, eq=False)
class Proximity:
    """weight sum_j gamma^(-d_j^2).

    Every term bends up along the line to its centroid, from d_j = 1 / sqrt(2 ln gamma) on; across it, it bends down.
    """

    weight: float
    gamma: float  # > 1
    centroids: np.ndarray  # (J, 2) [m]
    description: ClassVar[str] = "J2"
    columns: ClassVar[np.ndarray] = np.array([X, Y])
    is_quadratic: ClassVar[bool] = False

    def evaluate(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `CostTerm`."""
        difference = values[:, None] - self.centroids
        decay = np.exp(-math.log(self.gamma) * np.sum(difference**2, axis=2))
        gradient = -2 * math.log(self.gamma) * np.einsum("nj,njc->nc", decay, difference)
        return self.weight * decay.sum(axis=1), self.weight * gradient

    def convex_hessian(self, values: np.ndarray) -> np.ndarray:
        """See `CostTerm`."""
        difference = values[:, None] - self.centroids
        squared, c = np.sum(difference**2, axis=2), math.log(self.gamma)
        along = 2 * c * np.exp(-c * squared) * np.maximum(2 * c * squared - 1, 0.0) / np.maximum(squared, TINY)
        return self.weight * ((along[..., None] * difference).transpose(0, 2, 1) @ difference)


def cost_terms(weights: CostWeights, centroids: np.ndarray) -> list[CostTerm]:
    """The terms of J for obstacles with the given centroids (J, 2) [m]."""
    terms: list[CostTerm] = [Smoothness(weights.lambda1)]
    if len(centroids) and weights.lambda2:
        terms.append(Proximity(weights.lambda2, weights.gamma, centroids))
    return terms


def total_cost(terms: list[CostTerm], knots: np.ndarray, step: float) -> float:
    """J of knots (N, 7) that are `step` [s] apart."""
    return step * sum(float(term.evaluate(knots[:, term.columns])[0].sum()) for term in terms)


def evaluate_cost(trajectory: Trajectory, centroids: np.ndarray, weights: CostWeights) -> Cost:
    """The paper's cost of a trajectory, for obstacles with the given centroids (J, 2) [m]."""
    h = trajectory.duration / (len(trajectory) - 1)
    j1 = h * float(Smoothness(1.0).evaluate(trajectory.inputs)[0].sum())
    j2 = h * float(Proximity(1.0, weights.gamma, centroids).evaluate(trajectory.poses[:, :2])[0].sum())
    return Cost(weights.lambda1 * j1 + weights.lambda2 * j2, j1, j2)
