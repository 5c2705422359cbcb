"""Train a network from the command line: `python -m drake_gnnocp.train`."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import torch

from drake_gnnocp.command_line import BAD_INPUT, DONE, OneLineParser, count, positive, share
from drake_gnnocp.experiments.dataset.generate import DatasetError, load_dataset
from drake_gnnocp.experiments.training.comparison import comparison
from drake_gnnocp.experiments.training.curves_plot import save_curves_picture
from drake_gnnocp.experiments.training.overrides import override
from drake_gnnocp.experiments.training.quality import planning_quality, validation_tasks
from drake_gnnocp.experiments.training.samples import Samples
from drake_gnnocp.experiments.training.training import (
    DEFAULT_TRAINING,
    PAPER_TRAINING,
    Progress,
    TrainingOptions,
    train,
)
from drake_gnnocp.files import first_line
from drake_gnnocp.learning.checkpoint import (
    CONFIGS,
    Network,
    config_of,
    load_weights,
    new_network,
    save_weights,
)
from drake_gnnocp.learning.network import NetworkConfig
from drake_gnnocp.learning.paper_network import PaperConfig


def _parser() -> argparse.ArgumentParser:
    parser = OneLineParser(
        prog="python -m drake_gnnocp.train",
        description="Train a network on the dataset. A training that was stopped goes on where it was. Writes last.pt "
        "(to go on), best.pt (the weights that planned best on validation maps), curves.csv and curves.png.",
        epilog="Exit code: 0 done; 2 bad input. To use other weights than the package's: "
        "plan(..., options=PlanOptions(guess=GuessOptions(weights=Path('best.pt')))).",
    )
    add = parser.add_argument
    add("--config", choices=CONFIGS, default="default", help="which network (default: %(default)s)")
    data = Path("artifacts") / "dataset"
    add("--data", type=Path, default=data, metavar="DIR", help="folder of the dataset (default: %(default)s)")
    add("--out", type=Path, metavar="DIR", help="folder to write (default: artifacts/training/CONFIG)")
    start = "weights to begin with, of a network of the same sizes (default: random ones)"
    add("--from", type=Path, dest="start", metavar="FILE", help=start)
    add("--epochs", type=positive, metavar="N", help="passes over the dataset (default: the configuration's)")
    add("--share", type=share, default=1.0, metavar="X", help="share of the training maps, 0 to 1 (default: 1)")
    add("--seed", type=count, default=0, metavar="N", help="seed of weights and batches (default: %(default)s)")
    changes = "other sizes of the network, weights of the losses or options, such as hypotheses=1 kinematics=0 batch=32"
    add("--set", type=_setting, nargs="+", default=[], metavar="NAME=X", help=changes)
    add("--device", default="cpu", metavar="NAME", help="cpu, cuda, ... (default: %(default)s)")
    add("--threads", type=count, default=0, metavar="N", help="threads of torch (default: its own choice)")
    add("--check-every", type=positive, default=10, metavar="N", help="epochs between checks by planning (default: 10)")
    add("--check-tasks", type=positive, default=40, metavar="N", help="tasks planned in a check (default: %(default)s)")
    compare = "train nothing; print a table of the trainings whose folders are in DIR"
    add("--compare", type=Path, metavar="DIR", help=compare)
    return parser


def _setting(text: str) -> tuple[str, str]:
    name, sign, value = text.partition("=")
    if not sign:
        raise argparse.ArgumentTypeError(f"must be NAME=VALUE, not {text!r}")
    return name, value


def main(argv: list[str] | None = None) -> int:
    """Parse the arguments, train and write; returns the exit code."""
    arguments = _parser().parse_args(argv)
    if arguments.compare:
        try:
            print(comparison(arguments.compare), end="")
        except OSError as error:
            print(f"--compare: {error.filename}: {error.strerror}", file=sys.stderr)
            return BAD_INPUT
        return DONE
    folder: Path = arguments.out or Path("artifacts") / "training" / arguments.config
    options = DEFAULT_TRAINING if arguments.config == "default" else PAPER_TRAINING
    options = replace(options, seed=arguments.seed, epochs=arguments.epochs or options.epochs)
    config, settings = config_of(arguments.config), dict(arguments.set)
    if arguments.threads:
        torch.set_num_threads(arguments.threads)
    try:
        config, options = override(config, settings), override(options, settings)
        if settings:
            raise ValueError(f"--set: {', '.join(settings)}: no size of this network, loss or option")
        folder.mkdir(parents=True, exist_ok=True)
        with _device(arguments.device):
            run_training(config, folder, options, arguments)
    except ValueError as error:
        print(first_line(error), file=sys.stderr)
        return BAD_INPUT
    except OSError as error:
        print(f"{error.filename or folder}: {error.strerror}", file=sys.stderr)
        return BAD_INPUT
    print(f"written to {folder}")
    return DONE


def _device(name: str) -> torch.device:
    try:
        device = torch.device(name)
        torch.zeros(1, device=device).item()  # it is there, and holds numbers
        return device
    except (AssertionError, RuntimeError) as error:  # the former where torch was built without it
        raise ValueError(f"--device: {first_line(error)}") from None


def run_training(
    config: NetworkConfig | PaperConfig, folder: Path, options: TrainingOptions, arguments: argparse.Namespace
) -> Progress:
    """Train with a check by planning now and then; the best weights are kept."""
    records = load_dataset(arguments.data)
    learned = [record for record in records if record.split == "train"]
    learned = [learned[int(i / arguments.share)] for i in range(max(1, int(arguments.share * len(learned))))]
    unseen = [record for record in records if record.split == "validation"]
    torch.manual_seed(options.seed)
    try:
        network = new_network(config)
    except (AssertionError, RuntimeError, ValueError) as error:
        raise ValueError(f"--set: no network has these sizes: {first_line(error)}") from None
    if arguments.start:
        network.load_state_dict(started_from(arguments.start, config))
    points = network.config.points
    tasks = validation_tasks(unseen, arguments.check_tasks)

    def after_epoch(network: Network, progress: Progress) -> dict[str, float]:
        due = progress.epoch % arguments.check_every == 0 or progress.epoch == options.epochs
        if not due or not tasks:
            return {}
        quality = planning_quality(network, tasks)
        best = min((row["plan_badness"] for row in progress.rows if "plan_badness" in row), default=float("inf"))
        if quality["plan_badness"] < best:
            start = arguments.start.name if arguments.start else "random weights"
            about = {"epoch": progress.epoch, "maps": len(learned), "seed": options.seed, "from": start}
            save_weights(folder / "best.pt", network, about | quality)
        return quality

    training, validation = Samples.of(learned, points), Samples.of(unseen, points)
    if not len(training) or not len(validation):
        raise DatasetError(f"{arguments.data}: needs trajectories on training and on validation maps")
    origin = {
        "data": str(arguments.data),
        "trajectories": len(training),
        "from": str(arguments.start or ""),
        "check_tasks": len(tasks),  # the best weights are those of the best check of the same tasks
    }
    progress = train(network, training, validation, options, folder, after_epoch, origin)
    save_curves_picture(progress.rows, folder / "curves.png")
    return progress


def started_from(path: Path, config: NetworkConfig | PaperConfig) -> dict[str, torch.Tensor]:
    """The weights in a file.

    Raises:
        ValueError: they are of a network of other sizes, or none.
    """
    network, _ = load_weights(path)
    if network.config != config:
        raise ValueError(f"--from: {path}: weights of a network of other sizes: {network.config}")
    return network.state_dict()
