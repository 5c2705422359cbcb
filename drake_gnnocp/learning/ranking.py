"""How promising a hypothesis is: a logistic regression of "the SQP steps from this hypothesis converge".

With the features x of a hypothesis and the weights w of a `Ranking`, the steps converge with probability
1 / (1 + exp(-(w . x + b))), so hypotheses are tried in the order of falling w . x. The weights and the intercept b are
fitted to one network (`python -m drake_gnnocp.train --rank`) and stored with it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from drake_gnnocp.learning.arrays import Array, array_namespace, relu
from drake_gnnocp.learning.features import defects
from drake_gnnocp.learning.scene import WIDTH, Scene
from drake_gnnocp.learning.surroundings import STATIONS, signed_distance, stations
from drake_gnnocp.vehicle import State

N_FEATURES = 6


@dataclass(frozen=True)
class Ranking:
    """Weights of the features; without a fit, the network's own score decides."""

    score: float = 1.0  # a logit of the network's own score
    defect: float = 0.0  # a metre (or radian) of the mean defect of the kinematic model from point to point
    largest_defect: float = 0.0  # a metre (or radian) of the largest
    penetration: float = 0.0  # a metre of mean penetration of obstacles, over discs along the car at all points
    duration: float = 0.0  # a second
    gear_changes: float = 0.0  # a change of gear
    intercept: float | None = None  # None without a fit

    @property
    def weights(self) -> tuple[float, ...]:
        """Of the features, in their order."""
        return (self.score, self.defect, self.largest_defect, self.penetration, self.duration, self.gear_changes)

    def promise(self, features: Array) -> Array:
        """How promising hypotheses with features (..., N_FEATURES) are: (...)."""
        return features @ array_namespace(features).asarray(self.weights, dtype=features.dtype)

    def probability(self, promise: float) -> float | None:
        """That the steps from a hypothesis that is so promising converge; None without a fit."""
        return None if self.intercept is None else 0.5 * (1 + math.tanh((promise + self.intercept) / 2))


UNFITTED = Ranking()


def rank_features(states: Array, duration: Array, score: Array, scene: Scene) -> Array:
    """Features (B, K, N_FEATURES) of K hypotheses of each of B scenes, in the order of the fields of `Ranking`.

    Args:
        states: (B, K, T, 5) in the frames of the scenes [m, m, rad, m/s, rad].
        duration: (B, K) [s].
        score: (B, K) of the network, logits.
        scene: B scenes.
    """
    xp, (b, k, t) = array_namespace(states), states.shape[:3]
    defect = abs(defects(states, duration, scene.vehicle))
    discs = stations(states[..., :3].reshape((b, k * t, 3)), scene.vehicle)  # (B, K T, S, 2)
    discs = discs.reshape((b, k * t * len(STATIONS), 2))
    clearance = xp.min(signed_distance(discs, scene.edges, scene.mask), axis=1)  # (B, K T S)
    penetration = relu(scene.vehicle[:, [WIDTH]] / 2 - clearance).reshape((b, k, t * len(STATIONS)))
    mean, largest = xp.mean(defect, axis=(-1, -2)), xp.max(defect, axis=(-1, -2))
    return xp.stack([score, mean, largest, xp.mean(penetration, axis=-1), duration, _gear_changes(states)], axis=-1)


def _gear_changes(states: Array) -> Array:
    """How often trajectories (..., T, 5) change gear: (...)."""
    xp = array_namespace(states)
    gears = xp.sign(states[..., State.V])
    return xp.sum(xp.astype(gears[..., 1:-2] * gears[..., 2:-1] < 0, states.dtype), axis=-1)
