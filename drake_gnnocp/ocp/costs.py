r"""The cost J = lambda1 J1 + lambda2 J2, each term defined once for all solvers.

    J1 = int a^2 + w^2 dt                                    smoothness

J2 has two definitions. The paper's counts obstacles, with d_j from the rear axle to the centroid of obstacle j [m]:

    J2 = sum_j int gamma^(-d_j^2) dt                         "paper"

The default depends on the free space alone, not on how obstacles are cut. With sigma half the width of the car, and p
the middles of both axles, it integrates over the outline of the region that is blocked,

    J2 = int sum_p 1 / (sqrt(2 pi) sigma) oint exp(-|p - s|^2 / (2 sigma^2)) ds dt        "free space"

so that a long straight wall at the distance d from an axle counts exp(-d^2 / (2 sigma^2)). Gaps narrower than sigma,
which no car can enter, count as blocked. The outline is summed over points: a step of sigma would do on straight walls,
half of it is taken for corners.

Integrals are sums over the knots times h (a and w are zero at both ends, so for J1 that is the trapezoid rule).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from numbers import Real
from typing import ClassVar, Protocol

import numpy as np
import shapely

from drake_gnnocp.ocp.rows import POSE, A, W
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import State

LARGEST_WEIGHT = 1e6  # far larger ones leave the solvers no digits
FREE_SPACE, PAPER = "free space", "paper"  # definitions of J2
REACH = 4.0  # sigma: what is farther away counts less than 4e-4 of what it would nearby
STRAY = 2.0  # m, that a plan may be away from its reference
FEW_TERMS, TOGETHER = 20_000, 40  # of a sum that is not worth parting; poses that are near each other
NOTHING = 36.0  # an exponent at which what is left is below the sum's rounding


@dataclass(frozen=True)
class CostWeights:
    """Weights of the cost; `CostWeights.paper()` are those of the paper.

    Raises:
        ValueError: a weight is not a number in (0, LARGEST_WEIGHT] (lambda2 may be 0), or gamma is not above 1.
    """

    lambda1: float = 1.0  # of J1, which no problem can do without: Ipopt's first Hessian is made of it
    lambda2: float = 0.5  # of J2
    gamma: float = 1.1  # > 1, the paper leaves it open: an obstacle 5 m away costs 0.09 a second ("paper" only)
    time: float = 10.0  # 1/s, weight of t_final where it is minimised: plans then use most of the limits
    definition: str = FREE_SPACE  # of J2: FREE_SPACE or PAPER

    @classmethod
    def paper(cls) -> CostWeights:
        """The paper's cost."""
        return cls(lambda2=1.0, definition=PAPER)

    def __post_init__(self) -> None:
        if self.definition not in (FREE_SPACE, PAPER):
            raise ValueError(f"cost.definition: must be {FREE_SPACE!r} or {PAPER!r}, not {self.definition!r}")
        for name in ("lambda1", "lambda2", "gamma", "time"):
            value, least = getattr(self, name), 1.0 if name == "gamma" else 0.0
            is_number = isinstance(value, Real) and not isinstance(value, bool)
            if not is_number or not (least < value <= LARGEST_WEIGHT or name == "lambda2" and value == 0):
                at_least = "from" if name == "lambda2" else "above"
                raise ValueError(f"cost.{name}: must be {at_least} {least:g} to {LARGEST_WEIGHT:g}, not {value!r}")


@dataclass(frozen=True)
class Cost:
    """What a trajectory costs."""

    J1: float
    J2: float
    weights: CostWeights

    @property
    def J(self) -> float:
        """The weighted sum."""
        return self.weights.lambda1 * self.J1 + self.weights.lambda2 * self.J2

    def to_dict(self) -> dict[str, float | str]:
        """The cost in the keys of result.json."""
        weights = {"lambda1": self.weights.lambda1, "lambda2": self.weights.lambda2}
        return {"definition": self.weights.definition, "J": self.J, "J1": self.J1, "J2": self.J2, **weights}


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
    """weight sum_p sum_k share_k exp(-decay |p - s_k|^2) over points p of the car's axis and fixed points s_k."""

    weight: float
    decay: float  # 1/m^2
    points: np.ndarray  # (K, 2) s_k [m]
    shares: np.ndarray  # (K,)
    along: np.ndarray  # (B,) of the points p, how far they are in front of the rear axle [m]
    description: ClassVar[str] = "J2"
    columns: ClassVar[np.ndarray] = POSE
    is_quadratic: ClassVar[bool] = False

    def evaluate(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `CostTerm`."""
        totals, gradients = zip(*[near._evaluate(part) for near, part in self._by_parts(values)], strict=True)
        return np.concatenate(totals), np.concatenate(gradients)

    def _evaluate(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        on_car, arm, terms = self._terms(values)
        total = terms.sum(axis=2)
        of_points = -2 * self.decay * (on_car * total[..., None] - terms @ self.points)  # (N, B, 2)
        gradient = np.column_stack([of_points.sum(axis=1), np.sum(of_points * arm, axis=(1, 2))])
        return self.weight * total.sum(axis=1), self.weight * gradient

    def convex_hessian(self, values: np.ndarray) -> np.ndarray:
        """Of every point of the car the part that bends up, carried over to the pose; see `CostTerm`."""
        return np.concatenate([near._convex_hessian(part) for near, part in self._by_parts(values)])

    def _convex_hessian(self, values: np.ndarray) -> np.ndarray:
        on_car, arm, terms = self._terms(values)
        total, first = terms.sum(axis=2)[..., None, None], (terms @ self.points)[..., None]
        second = (terms @ np.einsum("ki,kj->kij", self.points, self.points).reshape(-1, 4)).reshape(
            *total.shape[:2], 2, 2
        )
        at = on_car[..., None]
        cross = at @ np.swapaxes(first, 2, 3)
        spread = total * at @ np.swapaxes(at, 2, 3) - cross - np.swapaxes(cross, 2, 3) + second  # sum of |p - s|^2
        bends, directions = np.linalg.eigh(4 * self.decay**2 * spread - 2 * self.decay * total * np.eye(2))
        up = (directions * np.maximum(bends, 0.0)[..., None, :]) @ np.swapaxes(directions, 2, 3)
        carried = np.concatenate([np.broadcast_to(np.eye(2), up.shape), arm[..., None]], axis=3)  # (N, B, 2, 3)
        return self.weight * np.sum(np.swapaxes(carried, 2, 3) @ up @ carried, axis=1)

    def _by_parts(self, values: np.ndarray) -> Iterator[tuple[Proximity, np.ndarray]]:
        """Parts of many poses (N, 3), each with the points that count there."""
        if len(values) * len(self.points) <= FEW_TERMS:
            yield self, values
            return
        reach = math.sqrt(NOTHING / self.decay) + float(np.abs(self.along).max())
        for part in np.array_split(values, math.ceil(len(values) / TOGETHER)):
            low, high = part[:, : State.THETA].min(axis=0) - reach, part[:, : State.THETA].max(axis=0) + reach
            counts = ((self.points >= low) & (self.points <= high)).all(axis=1)
            yield replace(self, points=self.points[counts], shares=self.shares[counts]), part

    def _terms(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The points p (N, B, 2), their derivatives by theta (N, B, 2), and the terms of the sum (N, B, K)."""
        theta = values[:, None, State.THETA]
        axis = np.stack([np.cos(theta), np.sin(theta)], axis=2)  # (N, 1, 2)
        on_car = values[:, None, : State.THETA] + self.along[:, None] * axis
        arm = self.along[:, None] * np.stack([-axis[..., 1], axis[..., 0]], axis=2)
        squares = np.sum(on_car**2, axis=2)[..., None] + np.sum(self.points**2, axis=1) - 2 * on_car @ self.points.T
        return on_car, arm, self.shares * np.exp(-self.decay * squares)


def proximity(scenario: Scenario, reference: np.ndarray, weights: CostWeights) -> Proximity:
    """lambda2 J2 for poses that stay within STRAY of reference ones (N, 3) [m, m, rad]."""
    if weights.definition == PAPER:
        centroids = scenario.centroids
        return Proximity(weights.lambda2, math.log(weights.gamma), centroids, np.ones(len(centroids)), np.zeros(1))
    vehicle = scenario.vehicle
    sigma = vehicle.width / 2
    margin = REACH * sigma + vehicle.wheelbase + STRAY
    low, high = reference[:, :2].min(axis=0) - margin, reference[:, :2].max(axis=0) + margin
    near = shapely.get_parts(shapely.clip_by_rect(scenario.outline, *low, *high))
    lengths = shapely.length(near)
    counts = np.ceil(lengths / (sigma / 2)).astype(int)
    first = np.repeat(np.cumsum(counts) - counts, counts)
    steps = np.repeat(lengths / np.maximum(counts, 1), counts)
    along = (np.arange(counts.sum()) - first + 0.5) * steps
    points = shapely.get_coordinates(shapely.line_interpolate_point(np.repeat(near, counts), along))
    at_hand = _within(points, reference[:, :2], margin)
    shares = steps[at_hand] / (math.sqrt(2 * math.pi) * sigma)
    return Proximity(weights.lambda2, 1 / (2 * sigma**2), points[at_hand], shares, np.array([0.0, vehicle.wheelbase]))


def _within(points: np.ndarray, path: np.ndarray, distance: float) -> np.ndarray:
    """Whether points (K, 2) are within a distance of a polyline (N, 2): (K,) bool [m]."""
    line = shapely.LineString(path)
    shapely.prepare(line)
    return np.asarray(shapely.dwithin(line, shapely.points(points), distance))


def cost_terms(weights: CostWeights, proximity: Proximity) -> list[CostTerm]:
    """The terms of J."""
    terms: list[CostTerm] = [Smoothness(weights.lambda1)]
    if len(proximity.points) and proximity.weight:
        terms.append(proximity)
    return terms


def total_cost(terms: list[CostTerm], knots: np.ndarray, step: float) -> float:
    """J of knots (N, 7) that are `step` [s] apart."""
    return step * sum(float(term.evaluate(knots[:, term.columns])[0].sum()) for term in terms)


def evaluate_cost(trajectory: Trajectory, scenario: Scenario, weights: CostWeights) -> Cost:
    """The cost of a trajectory of a scenario, in units of the car (see `Scenario.in_car_lengths`)."""
    trajectory = trajectory.scaled(scenario.unit / scenario.in_car_lengths.unit)
    scenario = scenario.in_car_lengths
    h = trajectory.duration / (len(trajectory) - 1)
    near = replace(proximity(scenario, trajectory.poses, weights), weight=1.0)
    j1 = h * float(Smoothness(1.0).evaluate(trajectory.inputs)[0].sum())
    j2 = h * float(near.evaluate(trajectory.poses)[0].sum())
    return Cost(j1, j2, weights)
