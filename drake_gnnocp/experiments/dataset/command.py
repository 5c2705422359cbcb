"""Make the dataset from the command line: `python -m drake_gnnocp.dataset`."""

from __future__ import annotations

import argparse
import logging
import os
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor
from contextlib import AbstractContextManager
from functools import partial
from pathlib import Path

from drake_gnnocp.console import OneLineParser, count, reported
from drake_gnnocp.experiments.dataset.datasheet import write_datasheet
from drake_gnnocp.experiments.dataset.generate import (
    DatasetError,
    DatasetSettings,
    MakeMap,
    check_settings,
    generate,
    load_dataset,
    make_map,
    missing_maps,
    settings_of,
)
from drake_gnnocp.experiments.dataset.improve import improving, origin_of
from drake_gnnocp.experiments.tasks.place import KINDS
from drake_gnnocp.files import locked
from drake_gnnocp.workers import workers

logger = logging.getLogger(__name__)
DEFAULTS = DatasetSettings()


def _parser() -> argparse.ArgumentParser:
    parser = OneLineParser(
        prog="python -m drake_gnnocp.dataset",
        description="Draw random maps and tasks, solve each by Hybrid A* and optimal control, keep the verified plans. "
        "What is in the folder already is not made again: a run that was stopped goes on.",
        epilog="Exit code: 0 done; 2 bad input. The whole takes about 6 hours on 2 cores.",
    )
    add = parser.add_argument
    add("--maps", type=count, default=DEFAULTS.maps, metavar="N", help="number of maps (default: %(default)s)")
    pairs = "pairs of start and goal on each map (default: %(default)s)"
    add("--pairs", type=count, default=DEFAULTS.pairs, metavar="N", help=pairs)
    add("--seed", type=count, default=DEFAULTS.seed, metavar="N", help="seed of everything (default: %(default)s)")
    kinds = "make only maps of these kinds now (default: all)"
    add("--kinds", nargs="+", choices=KINDS, default=list(KINDS), help=kinds)
    jobs = "processes (default: %(default)s, the cores)"
    add("--jobs", type=count, default=os.cpu_count() or 1, metavar="N", help=jobs)
    add("--dask", metavar="ADDRESS", help="a Dask cluster instead of processes, such as tcp://host:8786")
    improve = (
        "solve the tasks of the dataset in DIR, all of them whatever --maps, --pairs and --seed say, again from a "
        "network's hypotheses; keep cheaper plans"
    )
    add("--improve", type=Path, metavar="DIR", help=improve)
    add("--weights", type=Path, metavar="FILE", help="weights for --improve (default: those of the package)")
    out = Path("artifacts") / "dataset"
    add("--out", type=Path, default=out, metavar="DIR", help="folder to write (default: %(default)s)")
    return parser


def main(argv: list[str] | None = None) -> int:
    """Parse the arguments and make what is missing; returns the exit code."""
    arguments = _parser().parse_args(argv)
    settings = DatasetSettings(arguments.seed, arguments.maps, arguments.pairs)
    executor = partial(workers, max(1, arguments.jobs), arguments.dask)
    made = _made(settings, tuple(arguments.kinds), arguments.out, executor, arguments.improve, arguments.weights)
    return reported(made, arguments.out)


def _made(
    settings: DatasetSettings,
    kinds: tuple[str, ...],
    out: Path,
    executor: Callable[[], AbstractContextManager[Executor]],
    improve: Path | None,
    weights: Path | None,
) -> Iterator[str]:
    make: MakeMap = make_map
    origin = ""
    if weights and not improve:
        raise ValueError("--weights: only with --improve")
    if improve:
        if improve.resolve() == out.resolve():
            raise ValueError("--improve: choose another --out; the dataset itself is not changed")
        settings, make, origin = settings_of(improve), improving(improve, weights), origin_of(improve, weights)
    with locked(out):
        check_settings(out, settings, origin)
        while missing := missing_maps(out, settings, kinds):
            try:
                with executor() as workers:
                    generate(settings, kinds, out, workers, make, origin)
            except BrokenExecutor:
                if len(missing_maps(out, settings, kinds)) == len(missing):
                    raise DatasetError("workers end before they have finished a map: is there enough memory?") from None
                logger.warning("a worker has ended; the maps that were being made are tried again")
    records = load_dataset(out)
    write_datasheet(records, out)
    yield f"{len(records)} maps, {sum(len(record.trajectories) for record in records)} verified trajectories"
