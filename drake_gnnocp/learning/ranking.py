"""How promising a hypothesis is: a logistic regression of "the SQP steps from this hypothesis converge".

With the features x of a hypothesis and the weights w of a `Ranking`, the steps converge with probability
1 / (1 + exp(-(w . x + b))), so hypotheses are tried in the order of falling w . x. The weights and the intercept b are
fitted to one network (`python -m drake_gnnocp.train --rank`) and stored with it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from drake_gnnocp.learning.features import defects
from drake_gnnocp.learning.scene import WIDTH, Scene
from drake_gnnocp.learning.surroundings import signed_distance, stations
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

    def promise(self, features: Tensor) -> Tensor:
        """How promising hypotheses with features (..., N_FEATURES) are: (...)."""
        return features @ features.new_tensor(self.weights)

    def probability(self, promise: float) -> float | None:
        """That the steps from a hypothesis that is so promising converge; None without a fit."""
        return None if self.intercept is None else 0.5 * (1 + math.tanh((promise + self.intercept) / 2))


def rank_features(states: Tensor, duration: Tensor, score: Tensor, scene: Scene) -> Tensor:
    """Features (B, K, N_FEATURES) of K hypotheses of each of B scenes, in the order of the fields of `Ranking`.

    Args:
        states: (B, K, T, 5) in the frames of the scenes [m, m, rad, m/s, rad].
        duration: (B, K) [s].
        score: (B, K) of the network, logits.
        scene: B scenes.
    """
    defect = defects(states, duration, scene.vehicle).abs()
    discs = stations(states[..., :3].flatten(1, 2), scene.vehicle)  # (B, K T, S, 2)
    clearance = signed_distance(discs.flatten(1, 2), scene.edges, scene.mask).amin(dim=1)  # (B, K T S)
    penetration = torch.relu(scene.vehicle[:, [WIDTH]] / 2 - clearance)
    penetration = penetration.unflatten(1, (*states.shape[1:3], discs.shape[2])).mean(dim=(-1, -2))
    mean, largest = defect.mean(dim=(-1, -2)), defect.amax(dim=(-1, -2))
    return torch.stack([score, mean, largest, penetration, duration, _gear_changes(states)], dim=-1)


def _gear_changes(states: Tensor) -> Tensor:
    """How often trajectories (..., T, 5) change gear: (...)."""
    gears = torch.sign(states[..., State.V])
    return (gears[..., 1:-2] * gears[..., 2:-1] < 0).to(states).sum(dim=-1)
