"""How promising a hypothesis is: a logistic regression of "the SQP steps from this hypothesis converge".

With the features x of a hypothesis and the weights w of a `Ranking`, the steps converge with probability
1 / (1 + exp(-(w . x + b))), so hypotheses are tried in the order of falling w . x. The weights are fitted to one
network (`python -m drake_gnnocp.train --rank`) and stored with it.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass

import torch
from torch import Tensor

from drake_gnnocp.learning.features import defects
from drake_gnnocp.learning.scene import WIDTH, Scene
from drake_gnnocp.learning.surroundings import signed_distance, stations


@dataclass(frozen=True)
class Ranking:
    """Weights of the features; without a fit, the network's own score decides."""

    score: float = 1.0  # a logit of the network's own score
    defect: float = 0.0  # a metre (or radian) of the mean defect of the kinematic model from point to point
    largest_defect: float = 0.0  # a metre (or radian) of the largest
    penetration: float = 0.0  # a metre of mean penetration of obstacles, over discs along the car at all points
    duration: float = 0.0  # a second

    def promise(self, features: Tensor) -> Tensor:
        """How promising hypotheses with features (..., 5) are: (...)."""
        weights = astuple(self)
        return sum((w * x for w, x in zip(weights, features.unbind(dim=-1), strict=True)), torch.zeros(()))


def rank_features(states: Tensor, duration: Tensor, score: Tensor, scene: Scene) -> Tensor:
    """Features (B, K, 5) of K hypotheses of each of B scenes, in the order of the fields of `Ranking`.

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
    return torch.stack([score, defect.mean(dim=(-1, -2)), defect.amax(dim=(-1, -2)), penetration, duration], dim=-1)
