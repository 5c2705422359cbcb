"""Train a network from the command line: `python -m drake_gnnocp.train`."""

from __future__ import annotations

import argparse
import sys
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import torch

from drake_gnnocp.console import BAD_INPUT, DONE, OneLineParser, count, positive, share
from drake_gnnocp.experiments.dataset.generate import load_dataset
from drake_gnnocp.experiments.training.curves import comparison
from drake_gnnocp.experiments.training.job import Job, run
from drake_gnnocp.experiments.training.quality import validation_tasks
from drake_gnnocp.experiments.training.ranking_fit import fit_ranking
from drake_gnnocp.experiments.training.training import DEFAULT_TRAINING, PAPER_TRAINING, TrainingOptions
from drake_gnnocp.files import first_line
from drake_gnnocp.learning.configs import CONFIGS, NetworkConfig, PaperConfig, config_of

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

T = TypeVar("T", bound="DataclassInstance")


def _parser() -> argparse.ArgumentParser:
    parser = OneLineParser(
        prog="python -m drake_gnnocp.train",
        description="Train a network on the dataset. A training that was stopped goes on where it was. Writes last.pt "
        "(to go on), best.safetensors (the weights that planned best on validation maps), curves.csv and curves.png.",
        epilog="Exit code: 0 done; 2 bad input. To use other weights than the package's: "
        "plan(..., options=PlanOptions(weights=Path('best.safetensors'))).",
    )
    add = parser.add_argument
    add("--config", choices=CONFIGS, default="default", help="which network (default: %(default)s)")
    data = Path("artifacts") / "dataset"
    add("--data", type=Path, default=data, metavar="DIR", help="folder of the dataset (default: %(default)s)")
    add("--out", type=Path, metavar="DIR", help="folder to write (default: artifacts/training/CONFIG)")
    start = "weights to begin with, of a network of the same sizes or fewer refinements (default: random ones)"
    add("--from", type=Path, dest="start", metavar="FILE", help=start)
    add("--epochs", type=positive, metavar="N", help="passes over the dataset (default: the configuration's)")
    add("--share", type=share, default=1.0, metavar="X", help="share of the training maps, 0 to 1 (default: 1)")
    add("--seed", type=count, default=0, metavar="N", help="seed of weights and batches (default: %(default)s)")
    changes = "other sizes of the network, weights of the losses or options, such as hypotheses=1 kinematics=0 batch=32"
    add("--set", type=_setting, nargs="+", default=[], metavar="NAME=X", help=changes)
    add("--device", default="cpu", metavar="NAME", help="cpu, cuda, ... (default: %(default)s)")
    add("--threads", type=count, default=0, metavar="N", help="threads of torch (default: its own choice)")
    add("--check-every", type=positive, default=10, metavar="N", help="epochs between checks by planning (default: 10)")
    tasks = "validation tasks in a check, or for --rank (default: %(default)s)"
    add("--check-tasks", type=positive, default=40, metavar="N", help=tasks)
    rank = "train nothing; fit the ranking of hypotheses to the network in FILE on validation tasks and write it there"
    add("--rank", type=Path, metavar="FILE", help=rank)
    compare = "train nothing; print a table of the trainings whose folders are in DIR"
    add("--compare", type=Path, metavar="DIR", help=compare)
    return parser


def _setting(text: str) -> tuple[str, str]:
    name, sign, value = text.partition("=")
    if not sign:
        raise argparse.ArgumentTypeError(f"must be NAME=VALUE, not {text!r}")
    return name, value


def main(argv: list[str] | None = None) -> int:
    """Parse the arguments, then train, fit a ranking or compare; returns the exit code."""
    arguments = _parser().parse_args(argv)
    if arguments.threads:
        torch.set_num_threads(arguments.threads)
    try:
        if arguments.compare:
            print(comparison(arguments.compare), end="")
        elif arguments.rank:
            unseen = (record for record in load_dataset(arguments.data) if record.split == "validation")
            print(fit_ranking(arguments.rank, validation_tasks(unseen, arguments.check_tasks)))
        else:
            folder = arguments.out or Path("artifacts") / "training" / arguments.config
            options = _options(arguments.config, arguments.seed, arguments.epochs, dict(arguments.set))
            data = (arguments.data, arguments.start, arguments.share)
            _train(Job(*options, *data, arguments.check_every, arguments.check_tasks), folder, arguments.device)
            print(f"written to {folder}")
    except ValueError as error:
        print(first_line(error), file=sys.stderr)
        return BAD_INPUT
    except OSError as error:
        option = "--compare: " if arguments.compare else ""
        print(f"{option}{error.filename or arguments.out}: {error.strerror}", file=sys.stderr)
        return BAD_INPUT
    return DONE


def _options(
    config: str, seed: int, epochs: int | None, settings: dict[str, str]
) -> tuple[NetworkConfig | PaperConfig, TrainingOptions]:
    """Sizes and options of one of CONFIGS with what the command line changes."""
    options = DEFAULT_TRAINING if config == "default" else PAPER_TRAINING
    options = replace(options, seed=seed, epochs=epochs or options.epochs)
    sizes, options = override(config_of(config), settings), override(options, settings)
    if settings:
        raise ValueError(f"--set: {', '.join(settings)}: no size of this network, loss or option")
    return sizes, options


def _train(job: Job, folder: Path, device: str) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    try:
        chosen = torch.device(device)
        torch.zeros(1, device=chosen).item()  # it is there, and holds numbers
    except (AssertionError, RuntimeError) as error:  # the former where torch was built without it
        raise ValueError(f"--device: {first_line(error)}") from None
    with chosen:
        run(job, folder)


def override(options: T, settings: dict[str, str]) -> T:
    """A dataclass with some fields changed, those of dataclasses inside it as well; what is used up is taken out.

    Args:
        options: whose fields are bool, int, float or such dataclasses.
        settings: new values by field name; on return those that are no field of `options`.

    Raises:
        ValueError: a value does not fit its field.
    """
    changed: dict[str, Any] = {}
    for field in fields(options):
        value = getattr(options, field.name)
        if is_dataclass(value) and not isinstance(value, type):
            changed[field.name] = override(value, settings)
        elif field.name in settings:
            changed[field.name] = _parsed(field.name, settings.pop(field.name), type(value))
    return replace(options, **changed)


def _parsed(name: str, text: str, kind: type) -> Any:
    try:
        return bool(int(text)) if kind is bool else kind(text)
    except ValueError:
        raise ValueError(f"--set {name}: must be a number ({kind.__name__}), not {text!r}") from None
