"""How good a network is by what counts: the plans it leads to."""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice

from drake_gnnocp.budget import Budget
from drake_gnnocp.experiments.dataset.records import MapRecord
from drake_gnnocp.guesses import Guess, NoGuess
from drake_gnnocp.learning.checkpoint import Trained
from drake_gnnocp.learning.predict import guesses
from drake_gnnocp.planner import Attempt, FromGuess, PlanOptions
from drake_gnnocp.planner.attempt import attempt
from drake_gnnocp.planner.schedule import screened
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.trajectory import Trajectory

MAX_SECONDS = 5.0  # s, for a plan
FAILURE = 100.0  # work that an unverified plan counts as, and the most that a verified one does
PASSED_OVER = 10  # SQP steps that a hypothesis takes which is passed over


def validation_tasks(records: Iterable[MapRecord], n: int) -> list[Scenario]:
    """N tasks with a known solution, from as many of the maps as possible."""
    solved = [
        [task for task, label in zip(record.tasks, record.labels, strict=True) if label.trajectory is not None]
        for record in records
    ]
    longest = max((len(tasks) for tasks in solved), default=0)
    return [tasks[i] for i in range(longest) for tasks in solved if i < len(tasks)][:n]


def planning_quality(network: Trained, tasks: list[Scenario]) -> dict[str, float]:
    """Plan tasks as the planner does, without its fallback.

    Returns:
        plan_verified: share of the tasks; plan_first: share planned from the hypothesis ranked first; plan_iterations:
        median of the first solve; plan_badness: mean of these, the SQP steps before them and those of hypotheses
        passed over, FAILURE at most, and where the plan is not verified.
    """
    plans = [(rank, plan) for rank, plan in (_planned(network, task) for task in tasks) if plan is not None]
    verified = [(rank, plan) for rank, plan in plans if plan.verified]
    work = [min(FAILURE, plan.first_iterations + plan.sqp_steps + PASSED_OVER * rank) for rank, plan in verified]
    return {
        "plan_verified": len(verified) / len(tasks),
        "plan_first": sum(rank == 0 for rank, _ in verified) / len(tasks),
        "plan_iterations": float(statistics.median([plan.first_iterations for _, plan in plans] or [FAILURE])),
        "plan_badness": (sum(work) + FAILURE * (len(tasks) - len(verified))) / len(tasks),
    }


def _planned(network: Trained, task: Scenario) -> tuple[int, Attempt | None]:
    """Rank of the hypothesis whose SQP steps converged first, and the attempt that it led to."""
    local, options, budget = task.as_planned, PlanOptions(), Budget.of(MAX_SECONDS)
    source = _Hypotheses(list(islice(guesses(network, local, options.knots), options.hypotheses)))
    guess, steps = next(screened(local, source, budget, options), (None, None))
    if guess is None:
        return len(source.ranked), None
    made = attempt(local, guess, FromGuess(), budget, options, steps)
    rank = next(i for i, trajectory in enumerate(source.ranked) if trajectory is guess.trajectory)
    return rank, made if made.solves else None


@dataclass(frozen=True)
class _Hypotheses:
    """Those of a network that is still learning."""

    ranked: list[Trajectory]
    name: str = "gnn"
    proposes_many: bool = True

    def check_available(self) -> None:
        """They are there."""

    def guesses(self, scenario: Scenario, budget: Budget) -> Iterator[Guess | NoGuess]:
        """Most promising first."""
        for trajectory in self.ranked:
            yield Guess(self.name, trajectory, is_timed=True)
