"""One training from the dataset to the best weights: the network begins, learns, and is checked by planning."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import torch

from drake_gnnocp.experiments.dataset.generate import DatasetError, load_dataset
from drake_gnnocp.experiments.training.curves import curves_figure
from drake_gnnocp.experiments.training.quality import planning_quality, validation_tasks
from drake_gnnocp.experiments.training.samples import Samples
from drake_gnnocp.experiments.training.training import Progress, TrainingOptions, train
from drake_gnnocp.files import first_line
from drake_gnnocp.learning.checkpoint import load_weights, save_weights
from drake_gnnocp.learning.configs import NetworkConfig, PaperConfig
from drake_gnnocp.learning.trainable import Network, new_network, trainable, trained
from drake_gnnocp.pictures import style


@dataclass(frozen=True)
class Job:
    """What is trained, on what, and how it is checked."""

    config: NetworkConfig | PaperConfig
    options: TrainingOptions
    data: Path  # folder of the dataset
    start: Path | None = None  # weights to begin with; None: random ones
    share: float = 1.0  # of the training maps
    check_every: int = 10  # epochs between checks by planning
    check_tasks: int = 40  # that are planned in a check


def run(job: Job, folder: Path) -> Progress:
    """Train, or go on where `folder` says the training was left; the weights that planned best are best.safetensors.

    Raises:
        ValueError: the dataset, the start or what the folder holds does not fit the job, or no network has its sizes.
    """
    records = load_dataset(job.data)
    learned = [record for record in records if record.split == "train"]
    learned = [learned[int(i / job.share)] for i in range(max(1, int(job.share * len(learned))))]
    unseen = [record for record in records if record.split == "validation"]
    if not any(record.trajectories for record in learned) or not any(record.trajectories for record in unseen):
        raise DatasetError(f"{job.data}: needs trajectories on training and on validation maps")
    training, validation = (Samples.of(maps, job.config.points) for maps in (learned, unseen))
    training = training.with_more_tight(job.options.tight_times)
    network = beginning(job)
    tasks = validation_tasks(unseen, job.check_tasks)

    def after_epoch(network: Network, progress: Progress) -> dict[str, float]:
        due = progress.epoch % job.check_every == 0 or progress.epoch == job.options.epochs
        if not due or not tasks:
            return {}
        quality = planning_quality(trained(network), tasks)
        best = min((row["plan_badness"] for row in progress.rows if "plan_badness" in row), default=float("inf"))
        if quality["plan_badness"] < best:
            start = job.start.name if job.start else "random weights"
            about = {"epoch": progress.epoch, "maps": len(learned), "seed": job.options.seed, "from": start}
            save_weights(folder / "best.safetensors", trained(network), about | quality)
        return quality

    origin = {
        "data": str(job.data),
        "trajectories": len(training),
        "from": str(job.start or ""),
        "check_tasks": len(tasks),  # the best weights are those of the best check of the same tasks
    }
    progress = train(network, training, validation, job.options, folder, after_epoch, origin)
    style.save_figure(curves_figure(progress.rows), folder / "curves.png")
    return progress


def _goes_on(before: NetworkConfig | PaperConfig, config: NetworkConfig | PaperConfig) -> bool:
    """Whether a network has the sizes of one before, or more refinements."""
    if not isinstance(before, NetworkConfig) or not isinstance(config, NetworkConfig):
        return before == config
    return before.refinements <= config.refinements and replace(before, refinements=config.refinements) == config


def beginning(job: Job) -> Network:
    """The network as the training begins: with random weights, or with those of `start` and their ranking."""
    torch.manual_seed(job.options.seed)
    try:
        network = new_network(job.config)
    except (AssertionError, RuntimeError, ValueError) as error:
        raise ValueError(f"--set: no network has these sizes: {first_line(error)}") from None
    if job.start:
        before, _ = load_weights(job.start)
        if not _goes_on(before.config, job.config):
            raise ValueError(f"--from: {job.start}: weights of a network of other sizes: {before.config}")
        # further refinements correct nothing at first
        network.load_state_dict(trainable(before).state_dict(), strict=False)
        network.ranking = before.ranking
    return network
