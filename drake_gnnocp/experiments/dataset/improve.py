"""Better labels: training tasks solved again from the network's own hypotheses (expert iteration).

Hybrid A* proposes one way; the network has seen thousands and proposes several. Where one of them leads to a verified
plan of the same duration that costs less, that plan becomes the label, so that the next network learns from it. Tasks
that Hybrid A* could not solve get a label as well, where a hypothesis leads to one.
"""

from __future__ import annotations

import hashlib
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np

from drake_gnnocp.experiments.dataset.generate import DatasetSettings, load_map
from drake_gnnocp.experiments.dataset.label import KEPT, LEARNED, Label, LabelOptions, label_of
from drake_gnnocp.experiments.dataset.records import MapRecord
from drake_gnnocp.guesses.sources import GuessOptions, bundled_weights, check_available, gnn_guesses
from drake_gnnocp.ocp.convex_step import ConvexSteps
from drake_gnnocp.ocp.cost import evaluate_cost
from drake_gnnocp.ocp.refine import optimise, take_convex_steps
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.timing.minimum_effort import with_duration
from drake_gnnocp.trajectory import Trajectory


@dataclass(frozen=True)
class ImproveOptions:
    """How labels are improved."""

    weights: Path | None = None  # of the network; None: those that come with the package
    hypotheses: int = 4  # that are looked at
    same: float = 0.5  # m, from the label at most, everywhere: such hypotheses lead to it again and are passed over
    solves: int = 2  # of them, the cheapest after their convex steps, at most
    cheaper: float = 0.99  # of the label's cost: what is worth another way
    labels: LabelOptions = LabelOptions()


def improving(dataset: Path, options: ImproveOptions) -> Callable[[DatasetSettings, int], MapRecord]:
    """The function that makes map `index` of a dataset from the same map of another one.

    Raises:
        GuessUnavailable: there are no weights.
    """
    check_available("gnn", GuessOptions(weights=options.weights))
    return partial(improved_map, dataset=dataset, options=options)


def origin_of(dataset: Path, options: ImproveOptions) -> str:
    """What the labels of `improving` depend on, in words: the dataset's folder and the content of the weights."""
    weights = options.weights or bundled_weights()
    return f"labels of {dataset.resolve()} improved by weights {hashlib.sha256(weights.read_bytes()).hexdigest()[:16]}"


def improved_map(settings: DatasetSettings, index: int, dataset: Path, options: ImproveOptions) -> MapRecord:
    """Map `index` of a dataset with better labels; called in the executor's workers."""
    record = load_map(dataset, settings, index)
    pairs = zip(record.tasks, record.labels, strict=True)
    return replace(record, labels=tuple(improved_label(task, label, options) for task, label in pairs))


def improved_label(scenario: Scenario, label: Label, options: ImproveOptions) -> Label:
    """The label, or a better one from the network's hypotheses.

    Args:
        scenario: the task, anywhere.
        label: how it was solved before.
        options: see `ImproveOptions`.
    """
    x0, y0, _ = scenario.start
    local = scenario.translated(-x0, -y0)
    refine, best = options.labels.refine, label
    deadline = time.monotonic() + options.labels.solve_seconds
    settled: list[tuple[float, Trajectory, ConvexSteps]] = []
    for hypothesis in islice(gnn_guesses(local, GuessOptions(weights=options.weights)), options.hypotheses):
        # the same duration for all: more time always costs less
        guess = with_duration(hypothesis, label.trajectory.duration) if label.trajectory else hypothesis
        if label.trajectory and _farthest(guess, label.trajectory.translated(-x0, -y0)) < options.same:
            continue
        stepped = take_convex_steps(local, guess, refine, deadline)
        if stepped.settled:
            cost = evaluate_cost(stepped.trajectory, local.centroids, refine.problem.weights).J
            settled.append((cost, guess, stepped))
    for cost, guess, stepped in sorted(settled, key=lambda each: each[0])[: options.solves]:
        known = best.cost if best.outcome == KEPT else math.inf
        if cost < options.cheaper * known:
            found = label_of(optimise(local, guess, refine, deadline, stepped), scenario)
            if found.outcome == KEPT and found.cost < options.cheaper * known:
                best = replace(found, source=LEARNED)
    return best


def _farthest(guess: Trajectory, label: Trajectory) -> float:
    """The largest distance between two trajectories of the same number of knots, knot by knot [m]."""
    return float(np.linalg.norm(guess.poses[:, :2] - label.poses[:, :2], axis=1).max())
