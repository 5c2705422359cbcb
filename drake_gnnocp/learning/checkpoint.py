"""Weights on disk: with the configuration of their network and the ranking fitted to it.

Files are loaded without running code from them.
"""

from __future__ import annotations

import hashlib
import io
from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch

from drake_gnnocp.files import first_line, write_atomically
from drake_gnnocp.learning.network import NetworkConfig, TrajectoryNetwork
from drake_gnnocp.learning.paper_network import PaperConfig, PaperNetwork
from drake_gnnocp.learning.ranking import Ranking

CONFIGS = ("default", "paper")
Network = TrajectoryNetwork | PaperNetwork


class WeightsError(ValueError):
    """A file does not hold weights of this package's networks; the message names it."""


def config_of(kind: str) -> NetworkConfig | PaperConfig:
    """The sizes of one of CONFIGS."""
    return NetworkConfig() if kind == "default" else PaperConfig()


def new_network(config: NetworkConfig | PaperConfig) -> Network:
    """An untrained network."""
    return TrajectoryNetwork(config) if isinstance(config, NetworkConfig) else PaperNetwork(config)


def save_weights(path: Path, network: Network, about: dict[str, Any]) -> None:
    """Write weights, configuration and ranking, and what else is to be known of them (texts and numbers)."""
    content = {
        "kind": "default" if isinstance(network, TrajectoryNetwork) else "paper",
        "config": asdict(network.config),
        "ranking": asdict(network.ranking),
        "about": about,
        "weights": network.state_dict(),
    }
    save_atomically(path, content | {"checksum": _checksum(content)})


def _checksum(content: dict[str, Any]) -> str:
    """Of all that a prediction depends on."""
    digest = hashlib.sha256(repr([content[key] for key in ("kind", "config", "ranking")]).encode())
    for name, tensor in sorted(content["weights"].items()):
        digest.update(f"{name} {tensor.dtype} {tuple(tensor.shape)}".encode())
        digest.update(tensor.detach().cpu().contiguous().numpy().tobytes())
    return digest.hexdigest()


def save_atomically(path: Path, content: dict[str, Any]) -> None:
    """`torch.save` that leaves no half-written file."""
    buffer = io.BytesIO()
    torch.save(content, buffer)
    write_atomically(path, buffer.getvalue())


def load_weights(path: Path) -> tuple[Network, dict[str, Any]]:
    """The network in a file with its ranking, ready for use, and what else is to be known of it.

    Raises:
        WeightsError: the file cannot be read, is something else or damaged, or holds numbers that are not finite.
    """
    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
        about = dict(content["about"])
        config = NetworkConfig if content["kind"] == "default" else PaperConfig
        network = new_network(config(**content["config"]))
        network.ranking = Ranking(**content["ranking"])
        network.load_state_dict(content["weights"])
        checksum, saved = _checksum(content), content.get("checksum")  # files from before there was one have none
    except OSError as error:
        raise WeightsError(f"{path}: {error.strerror}") from None
    except Exception as error:  # torch's own errors for other files have no common class
        raise WeightsError(f"{path}: not weights of this version: {first_line(error)}") from None
    if saved not in (None, checksum):
        raise WeightsError(f"{path}: damaged: what it holds is not what was saved")
    numbers = [
        *network.state_dict().values(),
        torch.tensor([*network.ranking.weights, network.ranking.intercept or 0.0]),
    ]
    if not all(torch.isfinite(tensor).all() for tensor in numbers):
        raise WeightsError(f"{path}: holds weights that are not finite")
    return network.eval(), about
