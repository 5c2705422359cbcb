r"""The network of the paper (configuration `paper`), in pure torch.

Every obstacle is a subgraph of its vectors, start and goal are one more subgraph. Three layers of

    G^(l+1) = concat(mlp(G^(l)), agg(mlp(G^(l))))                                        (eq. 1)

with max aggregation, max pooling of every subgraph (eq. 2), three rounds of the same on the graph of all subgraphs, and
five parallel heads for x, y, theta, v and phi at 30 points. The paper's durations are constant; ours follow from the
prediction: the length of the path over the mean speed.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from drake_gnnocp.learning.configs import PaperConfig
from drake_gnnocp.learning.features import LENGTH
from drake_gnnocp.learning.modules import mlp
from drake_gnnocp.learning.network import Prediction
from drake_gnnocp.learning.ranking import UNFITTED, Ranking
from drake_gnnocp.learning.scene import Scene
from drake_gnnocp.vehicle import State

SLOWEST = 0.05  # m/s, least mean speed a duration is computed with
KIND_OF_STATE, KIND_OF_OBSTACLE = 1.0, 0.0


class Fusion(nn.Module):
    """One round of eq. 1: from nodes (N, inputs) to (N, 2 hidden)."""

    def __init__(self, inputs: int, hidden: int) -> None:
        super().__init__()
        self.mlp = mlp(inputs, hidden, hidden, hidden)

    def forward(self, nodes: Tensor, graph: Tensor, n_graphs: int) -> Tensor:
        """Own features beside the largest of the same graph; graph (N,) tells which of n_graphs a node belongs to."""
        own = self.mlp(nodes)
        return torch.cat([own, largest(own, graph, n_graphs)[graph]], dim=-1)


class PaperNetwork(nn.Module):
    """The paper's network, and the ranking of its hypotheses (one from each view of a scene)."""

    def __init__(self, config: PaperConfig, ranking: Ranking = UNFITTED) -> None:
        super().__init__()
        self.config = config
        self.ranking = ranking
        wide = 2 * config.hidden
        self.subgraph = nn.ModuleList(
            Fusion(6 if layer == 0 else wide, config.hidden) for layer in range(config.subgraph_layers)
        )
        self.graph = nn.ModuleList(Fusion(wide, config.hidden) for _ in range(config.graph_rounds))
        self.heads = nn.ModuleList(mlp(wide, config.hidden, config.hidden, config.points) for _ in State)

    def forward(self, scene: Scene, ranks: slice = slice(None)) -> Prediction:
        """One trajectory a scene (K = 1), which has rank 0."""
        vectors, mask = task_graph(scene)  # (B, 1 + J, E, 6)
        here = mask.any(dim=-1)
        scene_of, n_subgraphs = here.nonzero()[:, 0], int(here.sum())
        subgraph_of = torch.arange(n_subgraphs, device=mask.device).repeat_interleave(mask.sum(dim=-1)[here])
        nodes = vectors[mask]
        for layer in self.subgraph:
            nodes = layer(nodes, subgraph_of, n_subgraphs)
        nodes = largest(nodes, subgraph_of, n_subgraphs)
        for layer in self.graph:
            nodes = layer(nodes, scene_of, len(scene))
        feature = largest(nodes, scene_of, len(scene))  # (B, 2 hidden)
        columns = torch.stack([head(feature) for head in self.heads], dim=-1)  # (B, T, 5)
        states = columns * columns.new_tensor([LENGTH, LENGTH, 1.0, 1.0, 1.0])
        score = states.new_zeros(len(scene), 1)
        return Prediction(states[:, None][:, ranks], _duration(states)[:, None][:, ranks], score[:, ranks])


def largest(nodes: Tensor, graph: Tensor, n_graphs: int) -> Tensor:
    """Largest of the nodes (N, D) of each graph: (n_graphs, D); graph (N,) tells which one a node belongs to."""
    # not segment_reduce: where several are the largest, its gradient counts each of them in full (torch 2.13)
    # and not from arbitrary numbers: one that happens to be the largest would get a share of the gradient
    lowest = nodes.new_full((n_graphs, nodes.shape[1]), -torch.inf)
    return lowest.scatter_reduce(0, graph[:, None].expand_as(nodes), nodes, "amax")


def _duration(states: Tensor) -> Tensor:
    """Length of the path over the mean speed, (B,) [s], of states (B, T, 5)."""
    length = torch.linalg.norm(torch.diff(states[..., :2], dim=1), dim=-1).sum(dim=1)
    return length / states[..., State.V].abs().mean(dim=1).clamp(min=SLOWEST)


def task_graph(scene: Scene) -> tuple[Tensor, Tensor]:
    """Vectors of the state subgraph and of all obstacles: (B, 1 + J, max(E, 2), 6) and their mask.

    Obstacle vectors are tail and head; start and goal are position, cosine and sine of the heading; both carry their
    kind.
    """
    b, j, e, _ = scene.edges.shape
    edges = scene.edges.new_zeros(b, 1 + j, max(e, 2), 6)
    mask = torch.zeros(b, 1 + j, max(e, 2), dtype=torch.bool)
    edges[:, 1:, :e, :4] = scene.edges / LENGTH
    edges[:, 1:, :, 4] = KIND_OF_OBSTACLE
    mask[:, 1:, :e] = scene.mask
    x, y, theta = scene.goal.unbind(dim=1)
    edges[:, 0, 0, 2] = 1.0  # the start: the origin, heading 0
    edges[:, 0, 1, :4] = torch.stack([x / LENGTH, y / LENGTH, torch.cos(theta), torch.sin(theta)], dim=1)
    edges[:, 0, :2, 4] = KIND_OF_STATE
    edges[:, 0, 1, 5] = 1.0  # which of the two it is
    mask[:, 0, :2] = True
    return edges, mask
