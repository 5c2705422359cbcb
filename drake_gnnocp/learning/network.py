r"""The network of the `default` configuration, top-down: from a scene to several trajectories with a score each.

1. `ObstacleEncoder`: the vectors of an obstacle, seen from start and from goal, become one token (subgraphs, as in the
   paper).
2. A transformer over the task's token and the obstacles' (the paper's global graph, with attention).
3. `Proposer`: K hypotheses look at the tokens; each predicts T points, a duration and a score. Solutions are multimodal
   (left or right of an obstacle, forwards or backwards first), and one regression would average them.
4. `Refiner`, several times: what lies around every point (nearest points of all obstacles in the car's frame, the
   defects of the kinematic model to its neighbours) corrects the point; convolutions along the trajectory keep it
   together.

Limits hold by construction: |v| <= v_max and |phi| <= phi_max by tanh; both ends are exact.

Shapes: B scenes, J obstacles, E edges, K hypotheses, T points, D width. Lengths are in units of LENGTH.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from drake_gnnocp.learning.attention import Decoder, Encoder
from drake_gnnocp.learning.features import (
    LENGTH,
    MOTION,
    POINT_FEATURES,
    POSE,
    TASK_FEATURES,
    point_features,
    task_features,
)
from drake_gnnocp.learning.ranking import Ranking
from drake_gnnocp.learning.scene import PHI_MAX, V_MAX, Scene, evaluated_by_length, into_frame, with_obstacles
from drake_gnnocp.learning.surroundings import SURROUNDINGS, nearest_obstacles, surroundings
from drake_gnnocp.vehicle import State

DILATIONS = (1, 2, 4, 8, 1)  # of the convolutions along a trajectory
NEIGHBOURS = 10  # obstacles the refinements look at: those nearest to the proposed trajectory
UNFITTED = Ranking()
LIMITS = slice(V_MAX, PHI_MAX + 1, PHI_MAX - V_MAX)  # columns of vehicles


@dataclass(frozen=True)
class NetworkConfig:
    """Sizes of the network."""

    points: int = 30  # T, predicted points of a trajectory (the paper's N_out)
    width: int = 128  # D
    heads: int = 4  # of the attention
    encoder_layers: int = 3  # of the transformer over obstacles
    proposer_layers: int = 2  # of the transformer from hypotheses to obstacles
    hypotheses: int = 8  # K
    refinements: int = 2
    channels: int = 96  # of the convolutions along a trajectory

    def __post_init__(self) -> None:
        if self.hypotheses < 1 or self.points < 2:
            raise ValueError(f"hypotheses, points: must be 1 and 2 or more, not {self.hypotheses} and {self.points}")


@dataclass(frozen=True)
class Prediction:
    """K trajectories of each of B scenes, in the frames of the starts."""

    states: Tensor  # (B, K, T, 5) x, y, theta, v, phi at equal steps [m, m, rad, m/s, rad]
    duration: Tensor  # (B, K) [s]
    score: Tensor  # (B, K) logits of which one to take, or their log_softmax over all hypotheses


def mlp(*sizes: int) -> nn.Sequential:
    """Linear layers with ReLU in between."""
    layers: list[nn.Module] = []
    for before, after in zip(sizes, sizes[1:], strict=False):
        layers += [nn.Linear(before, after), nn.ReLU()]
    return nn.Sequential(*layers[:-1])


class ObstacleEncoder(nn.Module):
    """Vectors of every obstacle to one token."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.first = mlp(8, width, width)
        self.second = mlp(2 * width, width, width)

    def forward(self, edges: Tensor, mask: Tensor, goal: Tensor) -> Tensor:
        """Tokens (B, J, D) of edges (B, J, E, 4)."""
        return evaluated_by_length(self._tokens, goal, edges, mask)[0]

    def _tokens(self, goal: Tensor, edges: Tensor, mask: Tensor) -> tuple[Tensor]:
        seen = torch.cat([edges, into_frame(edges, goal)], dim=-1) / LENGTH  # (B, J, E, 8)
        hidden = self.first(seen)
        pooled = masked_max(hidden, mask)[:, :, None].expand_as(hidden)
        return (masked_max(self.second(torch.cat([hidden, pooled], dim=-1)), mask),)


def masked_max(values: Tensor, mask: Tensor) -> Tensor:
    """Largest of values (..., E, D) where mask (..., E) is True; 0 where none is."""
    largest = values.masked_fill(~mask[..., None], -torch.inf).amax(dim=-2)
    return torch.where(mask.any(dim=-1)[..., None], largest, 0.0)


class Proposer(nn.Module):
    """Tokens to K trajectories."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.config = config
        self.queries = nn.Parameter(torch.randn(config.hypotheses, config.width) * 0.5)
        self.layers = Decoder(config.width, config.heads, config.proposer_layers)
        self.head = mlp(config.width, 2 * config.width, config.points * 5 + 2)

    def forward(self, tokens: Tensor, mask: Tensor, scene: Scene) -> tuple[Prediction, Tensor]:
        """K trajectories of tokens (B, 1 + J, D), and what the hypotheses know (B, K, D)."""
        query = self.queries + tokens[:, :1]  # (B, K, D)
        latent = self.layers(query, tokens, mask)
        out = self.head(latent)  # (B, K, 5 T + 2)
        raw = out[..., :-2].unflatten(-1, (self.config.points, 5))
        distance = torch.linalg.norm(scene.goal[:, None, :2], dim=-1)
        duration = torch.exp(out[..., -2].clamp(-3.0, 3.0)) * (6.0 + distance)  # a car at about 1 m/s
        return Prediction(
            composed(raw, straight_line(scene, self.config.points), scene), duration, out[..., -1]
        ), latent


def straight_line(scene: Scene, points: int) -> Tensor:
    """What trajectories are counted from: the straight line to the goal, (B, 1, T, 5) without speed and steering."""
    u = torch.linspace(0.0, 1.0, points)
    line = torch.zeros(len(scene), 1, points, 5)
    line[:, 0, :, :3] = u[:, None] * scene.goal[:, None]
    return line


def composed(raw: Tensor, base: Tensor, scene: Scene) -> Tensor:
    """States (B, K, T, 5): base states and raw corrections (B, K, T, 5), within the limits and with exact ends.

    Positions are corrected in units of LENGTH, headings in rad, v and phi on a tanh scale of their limits.
    """
    limits = scene.vehicle[:, None, None, LIMITS]
    pose = base[..., POSE] + raw[..., POSE] * raw.new_tensor([LENGTH, LENGTH, 1.0])
    before = torch.atanh((base[..., MOTION] / limits).clamp(-0.999, 0.999))
    motion = limits * torch.tanh(before + raw[..., MOTION])
    states = torch.cat([pose, motion], dim=-1)
    goal = scene.goal[:, None]
    # the goal's heading in the turn that the trajectory arrives in
    turns = torch.round((pose[..., -1, 2] - goal[..., 2]) / (2 * math.pi)).detach()
    end = torch.zeros_like(states[..., :1, :])
    end[..., 0, :3] = goal
    end[..., 0, State.THETA] += 2 * math.pi * turns
    return torch.cat([torch.zeros_like(end), states[..., 1:-1, :], end], dim=-2)


class Convolution(nn.Linear):
    """Three taps along the points of a trajectory, `dilation` apart: on a CPU a matrix product is the fastest way."""

    def __init__(self, channels: int, dilation: int) -> None:
        super().__init__(3 * channels, channels)
        self.dilation = dilation

    def forward(self, x: Tensor) -> Tensor:
        """(B, T, C) of x (B, T, C)."""
        t, d = x.shape[1], self.dilation
        padded = nn.functional.pad(x, (0, 0, d, d))
        return super().forward(torch.cat([padded[:, i * d : i * d + t] for i in range(3)], dim=-1))


class Refiner(nn.Module):
    """Corrects one trajectory a scene by what lies around its points."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        c = config.channels
        self.around = mlp(SURROUNDINGS + config.width // 4, c // 2, c // 2)
        self.token = nn.Linear(config.width, config.width // 4)
        self.latent = nn.Linear(config.width, c)
        self.enter = nn.Linear(POINT_FEATURES + c // 2, c)
        self.blocks = nn.ModuleList(Convolution(c, d) for d in DILATIONS)
        self.norms = nn.ModuleList(nn.LayerNorm(c) for _ in self.blocks)
        self.leave = nn.Linear(c, 5)
        self.last = nn.Linear(c, 1)
        for layer in (self.leave, self.last):
            nn.init.zeros_(layer.weight)
            nn.init.zeros_(layer.bias)

    def forward(
        self, states: Tensor, duration: Tensor, latent: Tensor, tokens: Tensor, scene: Scene
    ) -> tuple[Tensor, Tensor]:
        """Better states (B, T, 5) and durations (B,) of states (B, T, 5), with latents (B, D), tokens (B, J, D)."""
        around = surroundings(states[..., POSE], scene)  # (B, T, J, SURROUNDINGS)
        token = self.token(tokens)[:, None].expand(-1, around.shape[1], -1, -1)
        pooled = masked_max(self.around(torch.cat([around, token], dim=-1)), scene.mask.any(dim=-1)[:, None])
        features = point_features(states, duration, scene)
        x = self.enter(torch.cat([features, pooled], dim=-1)) + self.latent(latent)[:, None]  # (B, T, C)
        for block, norm in zip(self.blocks, self.norms, strict=True):
            x = x + torch.relu(block(norm(x)))
        raw = self.leave(x)[:, None]  # (B, 1, T, 5)
        better = composed(raw, states[:, None], scene)[:, 0]
        return better, duration * torch.exp(self.last(x.mean(dim=1))[:, 0].clamp(-1.0, 1.0))


class TrajectoryNetwork(nn.Module):
    """The network of the `default` configuration, and the ranking of its hypotheses."""

    def __init__(self, config: NetworkConfig, ranking: Ranking = UNFITTED) -> None:
        super().__init__()
        self.config = config
        self.ranking = ranking
        width = config.width
        self.obstacles = ObstacleEncoder(width)
        self.task = mlp(TASK_FEATURES, width, width)
        self.encoder = Encoder(width, config.heads, config.encoder_layers)
        self.proposer = Proposer(config)
        self.refiners = nn.ModuleList(Refiner(config) for _ in range(config.refinements))

    def propose(self, scene: Scene) -> tuple[Prediction, Tensor, Tensor]:
        """K unrefined trajectories, what the hypotheses know (B, K, D), and the obstacles' tokens (B, J, D)."""
        obstacles = self.obstacles(scene.edges, scene.mask, scene.goal)  # (B, J, D)
        tokens = torch.cat([self.task(task_features(scene))[:, None], obstacles], dim=1)  # (B, 1 + J, D)
        here = scene.mask.any(dim=-1)  # (B, J)
        mask = torch.cat([torch.ones_like(here[:, :1]), here], dim=1)
        tokens = self.encoder(tokens, mask)
        proposed, latent = self.proposer(tokens, mask, scene)
        return proposed, latent, tokens[:, 1:]

    def refine(
        self, states: Tensor, duration: Tensor, latent: Tensor, tokens: Tensor, scene: Scene
    ) -> list[tuple[Tensor, Tensor]]:
        """States (B, T, 5) and durations (B,) after each refinement of one trajectory a scene."""
        which = nearest_obstacles(states[..., POSE], scene, NEIGHBOURS)
        scene, tokens = with_obstacles(scene, which), tokens[torch.arange(len(scene))[:, None], which]
        steps = []
        for refiner in self.refiners:
            # gradients end here: every refinement learns to correct what it is given
            states, duration = refiner(states.detach(), duration.detach(), latent, tokens, scene)
            steps.append((states, duration))
        return steps

    def forward(self, scene: Scene, ranks: slice = slice(None)) -> Prediction:
        """Refined trajectories of every scene, the likeliest first; of some ranks only, where that is enough."""
        proposed, latent, tokens = self.propose(scene)
        score, which = proposed.score.log_softmax(dim=1).sort(dim=1, descending=True)
        score, which = score[:, ranks], which[:, ranks]
        b, k = score.shape
        rows = torch.arange(b).repeat_interleave(k)
        chosen = rows, which.flatten()
        states, duration = proposed.states[chosen], proposed.duration[chosen]
        steps = self.refine(states, duration, latent[chosen], tokens[rows], scene.subset(rows)) if k else []
        if steps:
            states, duration = steps[-1]
        return Prediction(states.unflatten(0, (b, k)), duration.unflatten(0, (b, k)), score)
