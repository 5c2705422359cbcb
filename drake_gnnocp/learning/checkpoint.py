"""Weights on disk: with the configuration of their network and the ranking fitted to it.

The file is one of safetensors, which holds numbers and texts and no code. To plan with the `default` network nothing
of torch is needed.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from drake_gnnocp.files import first_line, write_atomically
from drake_gnnocp.learning.configs import NetworkConfig, PaperConfig
from drake_gnnocp.learning.layers import Weights, nested
from drake_gnnocp.learning.network import EVERY_RANK, Prediction, predicted
from drake_gnnocp.learning.ranking import Ranking
from drake_gnnocp.learning.scene import Scene, vehicle_row
from drake_gnnocp.vehicle import Vehicle

if TYPE_CHECKING:
    from drake_gnnocp.learning.trainable import Network


# goal and vehicle of a task to try weights out with
TRIAL = (np.array([[9.0, 3.0, 1.0]], np.float32), np.array([vehicle_row(Vehicle())], np.float32))


class WeightsError(ValueError):
    """A file does not hold weights of this package's networks; the message names it."""


@dataclass(frozen=True, eq=False)
class Trained:
    """A network ready for use, a function of scenes in numpy."""

    config: NetworkConfig | PaperConfig
    ranking: Ranking
    arrays: dict[str, np.ndarray]  # weights by their names

    def __call__(self, scene: Scene, ranks: slice = EVERY_RANK) -> Prediction:
        """Trajectories of every scene, the likeliest first; of some ranks only, where that is enough."""
        if not isinstance(self.config, NetworkConfig):
            return self._by_torch(scene, ranks)
        with np.errstate(all="ignore"):  # numbers that are not finite are noticed where they are used
            return predicted(self.weights, self.config, scene, ranks)

    @cached_property
    def weights(self) -> Weights:
        """Them by the parts of the network."""
        return nested(self.arrays)

    @cached_property
    def _module(self) -> Network:
        from drake_gnnocp.learning.trainable import trainable

        return trainable(self).eval()

    def _by_torch(self, scene: Scene, ranks: slice) -> Prediction:
        """The paper's network is there to compare with: torch computes it."""
        import torch

        with torch.inference_mode():
            found = self._module(scene.each(torch.from_numpy), ranks)
        return Prediction(found.states.numpy(), found.duration.numpy(), found.score.numpy())


def save_weights(path: Path, trained: Trained, about: dict[str, Any]) -> None:
    """Write weights, configuration and ranking, and what else is to be known of them (texts and numbers)."""
    texts = {
        "kind": "default" if isinstance(trained.config, NetworkConfig) else "paper",
        "config": json.dumps(asdict(trained.config)),
        "ranking": json.dumps(asdict(trained.ranking)),
        "about": json.dumps(about),
    }
    write_atomically(path, save(trained.arrays, texts | {"checksum": _checksum(texts, trained.arrays)}))


def _checksum(texts: dict[str, str], arrays: dict[str, np.ndarray]) -> str:
    """Of all that a prediction depends on."""
    digest = hashlib.sha256(repr([texts[key] for key in ("kind", "config", "ranking")]).encode())
    for name, array in sorted(arrays.items()):
        digest.update(f"{name} {array.dtype} {array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def load_weights(path: Path) -> tuple[Trained, dict[str, Any]]:
    """The network in a file with its ranking, and what else is to be known of it.

    Raises:
        WeightsError: the file cannot be read, is something else or damaged, or holds numbers that are not finite.
    """
    try:
        path.open("rb").close()  # whose errors say what is the matter, and those of the library do not
        with safe_open(path, framework="numpy") as file:
            texts = file.metadata() or {}
            arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - it is no mapping
        sizes = {"default": NetworkConfig, "paper": PaperConfig}[texts["kind"]](**json.loads(texts["config"]))
        trained = Trained(sizes, Ranking(**json.loads(texts["ranking"])), arrays)
        about, saved = dict(json.loads(texts["about"])), texts["checksum"]
    except OSError as error:
        raise WeightsError(f"{path}: {error.strerror}") from None
    except (SafetensorError, KeyError, TypeError, ValueError) as error:
        raise WeightsError(f"{path}: not weights of this version: {first_line(error)}") from None
    if saved != _checksum(texts, arrays):
        raise WeightsError(f"{path}: damaged: what it holds is not what was saved")
    ranking = trained.ranking
    if not all(np.isfinite(array).all() for array in (*arrays.values(), [*ranking.weights, ranking.intercept or 0.0])):
        raise WeightsError(f"{path}: holds weights that are not finite")
    try:
        _try_out(trained)
    except (KeyError, RuntimeError, ValueError) as error:
        raise WeightsError(f"{path}: not weights of this version: {first_line(error)}") from None
    return trained, about


def _try_out(trained: Trained) -> None:
    """Predict something; raises an error where the weights are not those of a network of its sizes."""
    if isinstance(trained.config, NetworkConfig):
        for name, size in _sizes(trained.weights).items():
            if size != getattr(trained.config, name):
                raise ValueError(f"{name}: {getattr(trained.config, name)} by the configuration, {size} by the weights")
    trained(Scene(np.zeros((1, 1, 1, 4), np.float32), np.zeros((1, 1, 1), bool), *TRIAL))


def _sizes(weights: Weights) -> dict[str, int]:
    """The fields of `NetworkConfig` that can be told from weights; others make a prediction impossible."""
    refiners, queries = weights.get("refiners", {}), weights["proposer"]["queries"]
    sizes = {
        "width": queries.shape[1],
        "encoder_layers": len(weights["encoder"]["layers"]),
        "proposer_layers": len(weights["proposer"]["layers"]["layers"]),
        "hypotheses": len(queries),
        "refinements": len(refiners),
    }
    return sizes | ({"channels": refiners["0"]["leave"]["weight"].shape[1]} if refiners else {})
