"""Training: epochs over the dataset, resumable, with the curves of both splits."""

from __future__ import annotations

import io
import logging
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch import Tensor
from tqdm import tqdm

from drake_gnnocp.experiments.training.curves import write_curves
from drake_gnnocp.experiments.training.losses import LossWeights, loss_of
from drake_gnnocp.experiments.training.samples import Samples
from drake_gnnocp.files import first_line, write_atomically
from drake_gnnocp.learning.trainable import Network

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class TrainingOptions:
    """How to train; learning rate, batch, epochs and warm-up are the paper's."""

    epochs: int = 200
    warm_up: int = 50  # epochs in which the learning rate rises to its full size
    batch: int = 32
    learning_rate: float = 1e-3
    cosine: bool = False  # whether the learning rate falls to zero along a cosine after the warm-up
    weight_decay: float = 0.0
    largest_gradient: float = math.inf  # norm, longer gradients are shortened
    tight_times: int = 1  # that a sample in a tight place counts for one elsewhere
    losses: LossWeights = field(default_factory=LossWeights)  # of the `default` network
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("batch", "tight_times"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name}: must be 1 or more, not {getattr(self, name)}")


PAPER_TRAINING = TrainingOptions()
DEFAULT_TRAINING = TrainingOptions(
    epochs=120, warm_up=2, batch=64, cosine=True, weight_decay=1e-4, largest_gradient=5.0
)


@dataclass
class Progress:
    """Where a training stands; what is in it can be saved and taken up again."""

    epoch: int  # epochs done
    rows: list[dict[str, float]]  # of the curves, one an epoch


def train(
    network: Network,
    training: Samples,
    validation: Samples,
    options: TrainingOptions,
    folder: Path,
    after_epoch: Callable[[Network, Progress], dict[str, float]],
    origin: dict[str, Any] | None = None,
) -> Progress:
    """Train a network, or go on where `folder` says the training was left.

    Args:
        network: changed in place.
        training: samples to learn from, mirrored and reversed at random.
        validation: samples to measure on.
        options: see `TrainingOptions`.
        folder: existing one for `last.pt` and `curves.csv`.
        after_epoch: called after every epoch; what it returns is added to the curves.
        origin: what else the outcome depends on (texts and numbers), such as where the data is from.

    Raises:
        ValueError: the training in `folder` was begun with other options, sizes or origin, or cannot be read.
    """
    settings = asdict(options) | asdict(network.config) | (origin or {})
    optimiser = torch.optim.AdamW(network.parameters(), options.learning_rate, weight_decay=options.weight_decay)
    progress = _resumed(folder / "last.pt", network, optimiser, settings)
    bar = tqdm(total=options.epochs, initial=progress.epoch, unit="epoch")
    while progress.epoch < options.epochs:
        learned = _train_epoch(network, optimiser, training, options, progress.epoch)
        progress.epoch += 1
        row = {"epoch": float(progress.epoch)}
        row |= {f"train_{name}": value for name, value in learned.items()}
        row |= {f"validation_{name}": value for name, value in evaluate(network, validation, options).items()}
        row |= after_epoch(network, progress)
        progress.rows.append(row)
        write_curves(folder / "curves.csv", progress.rows)
        _save(folder / "last.pt", network, optimiser, settings, progress)
        bar.update()
        bar.set_postfix_str(f"position error {row['validation_position']:.2f} m")
    bar.close()
    return progress


def _train_epoch(
    network: Network, optimiser: torch.optim.Optimizer, training: Samples, options: TrainingOptions, epoch: int
) -> dict[str, float]:
    """Learn from every sample once; mean of the loss and its parts over them."""
    generator = torch.Generator(device=training.duration.device).manual_seed(options.seed * 1_000_003 + epoch)
    batches = training.random_batches(options.batch, generator)
    network.train()
    sums: dict[str, float] = {}
    for i, rows in enumerate(batches):
        rate = learning_rate(options, epoch + i / len(batches))
        for group in optimiser.param_groups:
            group["lr"] = rate
        parts = loss_of(network, training.random_batch(rows, generator), options.losses)
        optimiser.zero_grad()
        parts["loss"].backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), options.largest_gradient)
        optimiser.step()
        _add(sums, parts, len(rows))
    return {name: total / len(training) for name, total in sums.items()}


@torch.inference_mode()
def evaluate(network: Network, samples: Samples, options: TrainingOptions) -> dict[str, float]:
    """Mean of the loss and its parts over samples as they are."""
    network.eval()
    sums: dict[str, float] = {}
    for rows in torch.arange(len(samples), device=samples.duration.device).split(options.batch):
        _add(sums, loss_of(network, samples.plain_batch(rows), options.losses), len(rows))
    return {name: total / len(samples) for name, total in sums.items()}


def learning_rate(options: TrainingOptions, epoch: float) -> float:
    """The learning rate at a (fractional) epoch."""
    if epoch < options.warm_up:
        return options.learning_rate * max(epoch / options.warm_up, 0.01)
    if not options.cosine:
        return options.learning_rate
    share = (epoch - options.warm_up) / max(options.epochs - options.warm_up, 1e-9)
    return options.learning_rate * max(0.01, 0.5 * (1 + math.cos(math.pi * share)))


def _add(sums: dict[str, float], parts: dict[str, Tensor], n: int) -> None:
    for name, value in parts.items():
        sums[name] = sums.get(name, 0.0) + float(value.detach()) * n


def _save(
    path: Path, network: Network, optimiser: torch.optim.Optimizer, settings: dict[str, Any], progress: Progress
) -> None:
    content = {
        "settings": settings,
        "epoch": progress.epoch,
        "rows": progress.rows,
        "weights": network.state_dict(),
        "optimiser": optimiser.state_dict(),
    }
    buffer = io.BytesIO()
    torch.save(content, buffer)
    write_atomically(path, buffer.getvalue())


def _resumed(path: Path, network: Network, optimiser: torch.optim.Optimizer, settings: dict[str, Any]) -> Progress:
    if not path.exists():
        return Progress(0, [])
    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
        before, progress = content["settings"], Progress(content["epoch"], content["rows"])
        changed = [name for name in settings if before.get(name) != settings[name]]
        if not changed:
            network.load_state_dict(content["weights"])
            optimiser.load_state_dict(content["optimiser"])
    except Exception as error:  # torch's own errors for other files have no common class
        raise ValueError(f"{path}: not a training of this version: {first_line(error)}; remove it") from None
    if changed:
        other = ", ".join(f"{name} {before.get(name)}" for name in changed)
        raise ValueError(f"{path}: the training here was begun with {other}; choose another --out or remove it")
    logger.info("going on after epoch %d", progress.epoch)
    return progress
