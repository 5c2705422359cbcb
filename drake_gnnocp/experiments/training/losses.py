r"""What training makes small.

    trajectory   distance to the label's states, headings and steering in units that matter as much as a metre
    duration     of its logarithm
    score        cross entropy: the best hypothesis should have the highest score
    kinematics   the error of the kinematic model between points
    clearance    discs along the car nearer to an obstacle than both their radius and the label

Winner takes all: only the hypothesis nearest to the label learns from it (and the others a little, so that none is
left behind).
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn.functional import cross_entropy, smooth_l1_loss

from drake_gnnocp.learning.features import defects
from drake_gnnocp.learning.network import NEIGHBOURS, TrajectoryNetwork
from drake_gnnocp.learning.scene import WIDTH, Scene, with_obstacles
from drake_gnnocp.learning.surroundings import nearest, nearest_obstacles, stations

LossParts = dict[str, Tensor]  # "loss" is what is minimised, the rest are for the curves

STATE_UNITS = (1.0, 1.0, 0.4, 0.8, 0.4)  # m, m, rad, m/s, rad: errors that count alike
KNEE = 0.3  # errors below are squared, larger ones count linearly


@dataclass(frozen=True)
class LossWeights:
    """Weights of the parts beside the trajectory's."""

    duration: float = 1.0
    score: float = 0.1
    kinematics: float = 1.0
    clearance: float = 0.5
    others: float = 0.05  # share of the loss for hypotheses that are not nearest
    disc_margin: float = 0.2  # m, discs want to be this much farther from obstacles than their radius


def trajectory_errors(states: Tensor, target: Tensor) -> Tensor:
    """Error (...,) of states (..., T, 5) against the label's."""
    unit = states.new_tensor(STATE_UNITS)
    target = target.expand_as(states)
    return smooth_l1_loss(states / unit, target / unit, beta=KNEE, reduction="none").mean(dim=(-1, -2))


def network_loss(
    network: TrajectoryNetwork, scene: Scene, states: Tensor, duration: Tensor, weights: LossWeights
) -> LossParts:
    """Loss of the `default` network on labels (B, T, 5) and durations (B,)."""
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
    chosen, its_time = proposed.states[rows, winner], proposed.duration[rows, winner]
    steps = network.refine(chosen, its_time, latent[rows, winner], tokens, scene)
    for i, (found, time) in enumerate(steps):
        parts[f"refined_{i}"] = trajectory_errors(found, states).mean()
        parts[f"duration_{i}"] = weights.duration * duration_errors(time, duration).mean()
        parts[f"kinematics_{i}"] = weights.kinematics * kinematic_error(found, time, scene).mean()
    last = steps[-1][0] if steps else chosen
    parts["clearance"] = weights.clearance * clearance_error(last, states, scene, weights.disc_margin).mean()
    loss = torch.stack(list(parts.values())).sum()
    position = torch.linalg.norm((last - states)[..., :2], dim=-1).mean()
    share = (proposed.score.argmax(dim=1) == winner).float().mean()
    return {"loss": loss, "position": position.detach(), "top_score": share} | {
        name: part.detach() for name, part in parts.items()
    }


def duration_errors(found: Tensor, duration: Tensor) -> Tensor:
    """Error of durations on a logarithmic scale."""
    return smooth_l1_loss(torch.log(found), torch.log(duration).expand_as(found), beta=0.1, reduction="none")


def kinematic_error(states: Tensor, duration: Tensor, scene: Scene) -> Tensor:
    """Mean error of the kinematic model (B,), against none."""
    gaps = defects(states, duration, scene.vehicle)
    return smooth_l1_loss(gaps, torch.zeros_like(gaps), beta=0.1, reduction="none").mean(dim=(-1, -2))


def clearance_error(states: Tensor, target: Tensor, scene: Scene, margin: float) -> Tensor:
    """How far discs along the car reach into obstacles where the label's do not: (B,) [m]."""
    scene = with_obstacles(scene, nearest_obstacles(target, scene, NEIGHBOURS))
    wanted = torch.minimum(disc_distance(target, scene), scene.vehicle[:, WIDTH, None, None] / 2 + margin)
    return torch.relu(wanted - disc_distance(states, scene)).mean(dim=(1, 2))


def disc_distance(states: Tensor, scene: Scene) -> Tensor:
    """Distance (B, T, S) of the stations along the car to the nearest obstacle, negative inside [m]."""
    points = stations(states[..., :3], scene.vehicle)
    x, y, side = nearest(points.flatten(1, 2), scene.edges, scene.mask)
    distance = side * torch.hypot(x + 1e-9, y)  # (B, J, T S)
    return distance.amin(dim=1).unflatten(1, points.shape[1:3])
