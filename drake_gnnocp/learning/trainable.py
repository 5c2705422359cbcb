"""The networks as modules of torch, which can be trained, and the way to them and back from networks that plan."""

from __future__ import annotations

import torch

from drake_gnnocp.learning.checkpoint import Trained
from drake_gnnocp.learning.configs import NetworkConfig, PaperConfig
from drake_gnnocp.learning.modules import TrajectoryNetwork
from drake_gnnocp.learning.paper_network import PaperNetwork

Network = TrajectoryNetwork | PaperNetwork


def new_network(config: NetworkConfig | PaperConfig) -> Network:
    """An untrained network."""
    return TrajectoryNetwork(config) if isinstance(config, NetworkConfig) else PaperNetwork(config)


def trained(network: Network) -> Trained:
    """A network as it is now, ready for use."""
    arrays = {name: tensor.detach().cpu().numpy().copy() for name, tensor in network.state_dict().items()}
    return Trained(network.config, network.ranking, arrays)


def trainable(before: Trained) -> Network:
    """A module with the weights and the ranking of a trained network.

    Raises:
        RuntimeError: the weights are not those of a network of its sizes.
    """
    network = new_network(before.config)
    network.ranking = before.ranking
    network.load_state_dict({name: torch.from_numpy(array.copy()) for name, array in before.arrays.items()})
    return network
