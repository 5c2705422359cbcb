"""Better labels: training tasks solved again from the network's own hypotheses (expert iteration).

Hybrid A* proposes one way; the network has seen thousands and proposes several. Where one of them leads to a verified
plan of the same duration that costs less, that plan becomes the label, so that the next network learns from it. Tasks
that Hybrid A* could not solve get a label as well, where a hypothesis leads to one.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from drake_gnnocp.budget import Budget
from drake_gnnocp.experiments.dataset.generate import DatasetSettings, MakeMap, load_map
from drake_gnnocp.experiments.dataset.label import KEPT, LEARNED, PLAN, SOLVE_SECONDS, Label, label_of
from drake_gnnocp.experiments.dataset.records import MapRecord
from drake_gnnocp.guesses import Guess, Learned, NoGuess
from drake_gnnocp.guesses.learned import bundled_weights
from drake_gnnocp.ocp.costs import evaluate_cost
from drake_gnnocp.ocp.formulation import formulate
from drake_gnnocp.ocp.sqp import SEARCHED, SqpSteps, sqp_steps
from drake_gnnocp.planner import FromGuess
from drake_gnnocp.planner.attempt import attempt
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.timing.minimum_effort import with_duration
from drake_gnnocp.trajectory import Trajectory

HYPOTHESES = 4  # of the network that are looked at
SAME = 0.5  # m, from the label at most, everywhere: such hypotheses lead to it again and are passed over
SOLVES = 2  # of them, the cheapest after their SQP steps, at most
CHEAPER = 0.99  # of the label's cost: what is worth another way


def improving(dataset: Path, weights: Path | None) -> MakeMap:
    """The function that makes map `index` of a dataset from the same map of another one; None: the package's weights.

    Raises:
        GuessUnavailable: there are no weights.
    """
    Learned(PLAN.knots, weights).check_available()
    return partial(improved_map, dataset=dataset, weights=weights)


def origin_of(dataset: Path, weights: Path | None) -> str:
    """What the labels of `improving` depend on, in words: the dataset's folder and the content of the weights."""
    content = (weights or bundled_weights()).read_bytes()
    return f"labels of {dataset.resolve()} improved by weights {hashlib.sha256(content).hexdigest()[:16]}"


def improved_map(settings: DatasetSettings, index: int, dataset: Path, weights: Path | None) -> MapRecord:
    """Map `index` of a dataset with better labels; called in the executor's workers."""
    record = load_map(dataset, settings, index)
    pairs = zip(record.tasks, record.labels, strict=True)
    return replace(record, labels=tuple(improved_label(task, label, weights) for task, label in pairs))


def improved_label(scenario: Scenario, label: Label, weights: Path | None = None) -> Label:
    """The label of a task, anywhere, or a better one from the network's hypotheses."""
    x0, y0, _ = scenario.start
    local, best, budget = scenario.as_planned, label, Budget.of(SOLVE_SECONDS)
    converged: list[tuple[float, Guess, SqpSteps]] = []
    for guess in Learned(PLAN.knots, weights, HYPOTHESES).guesses(local, budget):
        if isinstance(guess, NoGuess):
            continue
        if label.trajectory:  # the same duration for all: more time always costs less
            guess = replace(guess, trajectory=with_duration(guess.trajectory, label.trajectory.duration))
            if _farthest(guess.trajectory, label.trajectory.translated(-x0, -y0).scaled(1 / local.unit)) < SAME:
                continue
        steps = sqp_steps(formulate(local, guess.trajectory, PLAN.cost, PLAN.margin), SEARCHED, budget)
        if steps.converged:
            cost = evaluate_cost(steps.trajectory, local, PLAN.cost).J
            converged.append((cost, guess, steps))
    for cost, guess, steps in sorted(converged, key=lambda candidate: candidate[0])[:SOLVES]:
        known = best.cost if best.outcome == KEPT else math.inf
        if cost < CHEAPER * known:
            found = label_of(attempt(local, guess, FromGuess(), budget, PLAN, steps), scenario, local.unit)
            if found.outcome == KEPT and found.cost < CHEAPER * known:
                best = replace(found, source=LEARNED)
    return best


def _farthest(guess: Trajectory, label: Trajectory) -> float:
    """The largest distance between two trajectories of the same number of knots, knot by knot [m]."""
    return float(np.linalg.norm(guess.poses[:, :2] - label.poses[:, :2], axis=1).max())
