"""How good a network is by what counts: the plans it leads to."""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterable

from drake_gnnocp.dataset.records import MapRecord
from drake_gnnocp.learning.checkpoint import Network
from drake_gnnocp.learning.predict import guesses
from drake_gnnocp.ocp.refine import RefineOptions, optimise
from drake_gnnocp.scenario import Scenario

N_KNOTS = 120
MAX_SECONDS = 5.0  # s, for a plan
FAILURE = 100.0  # iterations that an unverified plan counts as


def validation_tasks(records: Iterable[MapRecord], n: int) -> list[Scenario]:
    """N tasks with a known solution, from as many of the maps as possible."""
    solved = [
        [task for task, label in zip(record.tasks, record.labels, strict=True) if label.trajectory is not None]
        for record in records
    ]
    longest = max((len(tasks) for tasks in solved), default=0)
    return [tasks[i] for i in range(longest) for tasks in solved if i < len(tasks)][:n]


def planning_quality(network: Network, tasks: list[Scenario]) -> dict[str, float]:
    """Plan tasks from the network's best hypothesis alone.

    Returns:
        plan_verified: share of the tasks; plan_iterations: median of the first solve; plan_badness: mean of the first
        solve's iterations, FAILURE where the plan is not verified.
    """
    network.eval()
    iterations, verified = [], []
    for task in tasks:
        x0, y0, _ = task.start
        local = task.translated(-x0, -y0)
        guess = guesses(network, local, N_KNOTS)[0]
        plan = optimise(local, guess, RefineOptions(), time.monotonic() + MAX_SECONDS)
        iterations.append(plan.rounds[0].iterations if plan.rounds else FAILURE)
        verified.append(plan.verification.verified)
    badness = [n if ok else FAILURE for n, ok in zip(iterations, verified, strict=True)]
    return {
        "plan_verified": sum(verified) / len(tasks),
        "plan_iterations": float(statistics.median(iterations)),
        "plan_badness": statistics.fmean(badness),
    }
