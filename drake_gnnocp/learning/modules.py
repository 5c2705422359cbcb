"""The `default` network as a module of torch, which learns: it holds the weights, and `network` computes with them."""

from __future__ import annotations

import torch
from torch import nn

from drake_gnnocp.learning import network
from drake_gnnocp.learning.arrays import Array
from drake_gnnocp.learning.configs import NetworkConfig
from drake_gnnocp.learning.features import POINT_FEATURES, TASK_FEATURES
from drake_gnnocp.learning.layers import Weights, nested
from drake_gnnocp.learning.network import Prediction
from drake_gnnocp.learning.ranking import UNFITTED, Ranking
from drake_gnnocp.learning.scene import Scene
from drake_gnnocp.learning.surroundings import SURROUNDINGS


def mlp(*sizes: int) -> nn.Sequential:
    """Linear layers with ReLU in between."""
    layers: list[nn.Module] = []
    for before, after in zip(sizes, sizes[1:], strict=False):
        layers += [nn.Linear(before, after), nn.ReLU()]
    return nn.Sequential(*layers[:-1])


class Attention(nn.Module):
    """Weights of an attention of several heads."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        if width % heads:
            raise ValueError(f"width: must be a multiple of heads, {heads}, not {width}")
        self.in_proj_weight = nn.Parameter(torch.empty(3 * width, width))
        self.in_proj_bias = nn.Parameter(torch.zeros(3 * width))
        self.out_proj = nn.Linear(width, width)
        nn.init.xavier_uniform_(self.in_proj_weight)
        nn.init.zeros_(self.out_proj.bias)


class TransformerLayer(nn.Module):
    """Weights of attention among tokens and, in decoders, to other tokens, and of two linear layers."""

    def __init__(self, width: int, heads: int, is_decoder: bool) -> None:
        super().__init__()
        self.self_attn = Attention(width, heads)
        if is_decoder:
            self.multihead_attn = Attention(width, heads)
        self.linear1, self.linear2 = nn.Linear(width, 2 * width), nn.Linear(2 * width, width)
        self.norm1, self.norm2 = nn.LayerNorm(width), nn.LayerNorm(width)
        if is_decoder:
            self.norm3 = nn.LayerNorm(width)


class Transformer(nn.Module):
    """Weights of several layers."""

    def __init__(self, width: int, heads: int, layers: int, is_decoder: bool) -> None:
        super().__init__()
        self.layers = nn.ModuleList(TransformerLayer(width, heads, is_decoder) for _ in range(layers))


class ObstacleEncoder(nn.Module):
    """Weights of `network.obstacle_tokens`."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.first = mlp(8, width, width)
        self.second = mlp(2 * width, width, width)


class Proposer(nn.Module):
    """Weights of `network.proposed`."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        width = config.width
        self.queries = nn.Parameter(torch.randn(config.hypotheses, width) * 0.5)
        self.layers = Transformer(width, config.heads, config.proposer_layers, is_decoder=True)
        self.head = mlp(width, 2 * width, config.points * 5 + 2)


class Refiner(nn.Module):
    """Weights of `network.corrected`; it corrects nothing at first."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        c = config.channels
        self.around = mlp(SURROUNDINGS + config.width // 4, c // 2, c // 2)
        self.token = nn.Linear(config.width, config.width // 4)
        self.latent = nn.Linear(config.width, c)
        self.enter = nn.Linear(POINT_FEATURES + c // 2, c)
        self.blocks = nn.ModuleList(nn.Linear(3 * c, c) for _ in network.DILATIONS)
        self.norms = nn.ModuleList(nn.LayerNorm(c) for _ in self.blocks)
        self.leave = nn.Linear(c, 5)
        self.last = nn.Linear(c, 1)
        for layer in (self.leave, self.last):
            nn.init.zeros_(layer.weight)
            nn.init.zeros_(layer.bias)


class TrajectoryNetwork(nn.Module):
    """The network of the `default` configuration, and the ranking of its hypotheses."""

    def __init__(self, config: NetworkConfig, ranking: Ranking = UNFITTED) -> None:
        super().__init__()
        self.config = config
        self.ranking = ranking
        width = config.width
        self.obstacles = ObstacleEncoder(width)
        self.task = mlp(TASK_FEATURES, width, width)
        self.encoder = Transformer(width, config.heads, config.encoder_layers, is_decoder=False)
        self.proposer = Proposer(config)
        self.refiners = nn.ModuleList(Refiner(config) for _ in range(config.refinements))

    @property
    def weights(self) -> Weights:
        """Those that learn."""
        return nested(dict(self.named_parameters()))

    def propose(self, scene: Scene) -> tuple[Prediction, Array, Array]:
        """See `network.proposed`."""
        return network.proposed(self.weights, self.config, scene)

    def refine(
        self, states: Array, duration: Array, latent: Array, tokens: Array, scene: Scene
    ) -> list[tuple[Array, Array]]:
        """See `network.refined`."""
        return list(network.refined(self.weights, states, duration, latent, tokens, scene))

    def forward(self, scene: Scene, ranks: slice = network.EVERY_RANK) -> Prediction:
        """See `network.predicted`."""
        return network.predicted(self.weights, self.config, scene, ranks)
