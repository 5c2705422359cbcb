r"""The losses of the two networks: what a training minimises.

The loss of the `default` network is a sum of

    trajectory   distance to the label's states, headings and steering in units that matter as much as a metre
    duration     error of the logarithm of the duration
    score        cross entropy: the best hypothesis should have the highest score
    kinematics   defects of the kinematic model between points

Winner takes all: only the hypothesis nearest to the label learns from it (and the others a little, so that none is
left behind). The loss of the paper's network is the regression error of its one trajectory.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn.functional import cross_entropy, smooth_l1_loss

from drake_gnnocp.experiments.training.samples import Batch
from drake_gnnocp.learning.features import LENGTH, defects
from drake_gnnocp.learning.modules import TrajectoryNetwork
from drake_gnnocp.learning.paper_network import PaperNetwork
from drake_gnnocp.learning.trainable import Network

LossParts = dict[str, Tensor]  # "loss" is what is minimised, the rest are for the curves

STATE_UNITS = (1.0, 1.0, 0.4, 0.8, 0.4)  # m, m, rad, m/s, rad: errors that count alike
PAPER_UNITS = (LENGTH, LENGTH, 1.0, 1.0, 1.0)
TRAJECTORY_KNEE, KNEE = 0.3, 0.1  # errors below are squared, larger ones count linearly


@dataclass(frozen=True)
class LossWeights:
    """Weights of the parts beside the trajectory's."""

    duration: float = 1.0
    score: float = 0.1
    kinematics: float = 1.0
    others: float = 0.05  # share of the loss for hypotheses that are not nearest


def loss_of(network: Network, batch: Batch, weights: LossWeights) -> LossParts:
    """The loss of a network on a batch of labels, and its parts; the weights are the `default` network's."""
    if isinstance(network, TrajectoryNetwork):
        return _default_loss(network, batch, weights)
    return _paper_loss(network, batch)


def _default_loss(network: TrajectoryNetwork, batch: Batch, weights: LossWeights) -> LossParts:
    scene, states, duration = batch.scene, batch.states, batch.duration
    proposed, latent, tokens = network.propose(scene)
    errors = trajectory_errors(proposed.states, states[:, None])  # (B, K)
    errors = errors + weights.duration * duration_errors(proposed.duration, duration[:, None])
    winner = errors.argmin(dim=1)  # (B,)
    rows = torch.arange(len(winner))
    best = errors[rows, winner]
    parts = {
        "proposal": (1 - weights.others) * best.mean() + weights.others * errors.mean(),
        "score": weights.score * cross_entropy(proposed.score, winner),
    }
    last, time = proposed.states[rows, winner], proposed.duration[rows, winner]
    steps = network.refine(last, time, latent[rows, winner], tokens, scene)
    for i, (last, time) in enumerate(steps):
        parts[f"refined_{i}"] = trajectory_errors(last, states).mean()
        parts[f"duration_{i}"] = weights.duration * duration_errors(time, duration).mean()
        parts[f"kinematics_{i}"] = weights.kinematics * kinematic_errors(last, time, scene.vehicle).mean()
    loss = torch.stack(list(parts.values())).sum()
    top = (proposed.score.argmax(dim=1) == winner).float().mean()
    shown = {"loss": loss, "position": position_error(last, states), "top_score": top}
    return shown | {name: part.detach() for name, part in parts.items()}


def _paper_loss(network: PaperNetwork, batch: Batch) -> LossParts:
    """Regression of the five variables; the duration is not learned."""
    found = network(batch.scene).states[:, 0]
    unit = found.new_tensor(PAPER_UNITS)
    loss = smooth_l1_loss(found / unit, batch.states / unit, beta=KNEE)
    return {"loss": loss, "position": position_error(found, batch.states)}


def position_error(states: Tensor, target: Tensor) -> Tensor:
    """Mean distance of states (B, T, 5) to the labels', without gradients [m]."""
    return torch.linalg.norm((states - target)[..., :2].detach(), dim=-1).mean()


def trajectory_errors(states: Tensor, target: Tensor) -> Tensor:
    """Error (...,) of states (..., T, 5) against the label's."""
    unit = states.new_tensor(STATE_UNITS)
    target = target.expand_as(states)
    return smooth_l1_loss(states / unit, target / unit, beta=TRAJECTORY_KNEE, reduction="none").mean(dim=(-1, -2))


def duration_errors(found: Tensor, duration: Tensor) -> Tensor:
    """Error (...,) of durations (...,) on a logarithmic scale."""
    return smooth_l1_loss(torch.log(found), torch.log(duration).expand_as(found), beta=KNEE, reduction="none")


def kinematic_errors(states: Tensor, duration: Tensor, vehicle: Tensor) -> Tensor:
    """Mean size (B,) of the defects of states (B, T, 5) with durations (B,) and vehicles (B, 8)."""
    found = defects(states, duration, vehicle)
    return smooth_l1_loss(found, torch.zeros_like(found), beta=KNEE, reduction="none").mean(dim=(-1, -2))
