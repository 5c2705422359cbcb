"""Sizes of the networks."""

from __future__ import annotations

from dataclasses import dataclass

CONFIGS = ("default", "paper")


@dataclass(frozen=True)
class NetworkConfig:
    """Sizes of the `default` network."""

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
class PaperConfig:
    """Sizes of the paper's network, the paper's."""

    points: int = 30  # N_out
    hidden: int = 128  # neurons of the hidden layers
    subgraph_layers: int = 3
    graph_rounds: int = 3


def config_of(kind: str) -> NetworkConfig | PaperConfig:
    """The sizes of one of CONFIGS."""
    return NetworkConfig() if kind == "default" else PaperConfig()
