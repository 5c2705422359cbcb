"""How good a network is by what counts: the plans it leads to."""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterable
from itertools import islice

from drake_gnnocp.experiments.dataset.records import MapRecord
from drake_gnnocp.guesses.sources import GuessOptions
from drake_gnnocp.learning.checkpoint import Network
from drake_gnnocp.learning.predict import guesses
from drake_gnnocp.ocp.refine import Optimised, RefineOptions, optimise
from drake_gnnocp.planner.hypotheses import settled_hypotheses
from drake_gnnocp.planner.schedule import PlanOptions
from drake_gnnocp.scenario import Scenario

MAX_SECONDS = 5.0  # s, for a plan
FAILURE = 100.0  # work that an unverified plan counts as, and the most that a verified one does
PASSED_OVER = 10  # convex steps that a hypothesis takes which is passed over


def validation_tasks(records: Iterable[MapRecord], n: int) -> list[Scenario]:
    """N tasks with a known solution, from as many of the maps as possible."""
    solved = [
        [task for task, label in zip(record.tasks, record.labels, strict=True) if label.trajectory is not None]
        for record in records
    ]
    longest = max((len(tasks) for tasks in solved), default=0)
    return [tasks[i] for i in range(longest) for tasks in solved if i < len(tasks)][:n]


def planning_quality(network: Network, tasks: list[Scenario]) -> dict[str, float]:
    """Plan tasks as the planner does, without its fallback.

    Returns:
        plan_verified: share of the tasks; plan_first: share planned from the hypothesis ranked first; plan_iterations:
        median of the first solve; plan_badness: mean of these, the convex steps before them and those of hypotheses
        passed over, FAILURE at most, and where the plan is not verified.
    """
    network.eval()
    plans = [(rank, plan) for rank, plan in (_planned(network, task) for task in tasks) if plan is not None]
    verified = [(rank, plan.rounds[0]) for rank, plan in plans if plan.verification.verified]
    work = [min(FAILURE, each.iterations + each.convex_steps + PASSED_OVER * rank) for rank, each in verified]
    return {
        "plan_verified": len(verified) / len(tasks),
        "plan_first": sum(rank == 0 for rank, _ in verified) / len(tasks),
        "plan_iterations": float(statistics.median([plan.rounds[0].iterations for _, plan in plans] or [FAILURE])),
        "plan_badness": (sum(work) + FAILURE * (len(tasks) - len(verified))) / len(tasks),
    }


def _planned(network: Network, task: Scenario) -> tuple[int, Optimised | None]:
    """Rank of the hypothesis whose convex steps settled first, and the plan it led to."""
    x0, y0, _ = task.start
    local = task.translated(-x0, -y0)
    deadline = time.monotonic() + MAX_SECONDS
    ranked = list(islice(guesses(network, local, GuessOptions().n_knots), PlanOptions().hypotheses))
    chosen = next(settled_hypotheses(local, ranked, RefineOptions(), deadline), None)
    if chosen is None:
        return len(ranked), None
    plan = optimise(local, chosen.guess, RefineOptions(), deadline, chosen.stepped)
    rank = next(i for i, each in enumerate(ranked) if each is chosen.guess)
    return rank, plan if plan.rounds else None
