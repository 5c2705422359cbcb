"""One task solved: Hybrid A*, speed planner, optimal control, verification. Only what is verified is kept."""

from __future__ import annotations

from dataclasses import dataclass

from drake_gnnocp.budget import Budget
from drake_gnnocp.guesses import HybridAStar, NoGuess
from drake_gnnocp.ocp.costs import CostWeights
from drake_gnnocp.planner import Attempt, FromGuess, PlanOptions
from drake_gnnocp.planner.attempt import attempt
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.trajectory import Trajectory

KEPT, NO_PATH, UNVERIFIED, TOO_LONG = "kept", "no path", "unverified", "too long"  # also for its knots
OUTCOMES = (KEPT, NO_PATH, UNVERIFIED, TOO_LONG)
SEARCHED, LEARNED = "hybrid_astar", "gnn"  # whose guess led to a label


PLAN = PlanOptions(cost=CostWeights.paper())  # of all labels
SEARCH_SECONDS, SOLVE_SECONDS = 8.0, 15.0  # s, most for Hybrid A*, and for the optimal control problem
LONGEST = 150.0  # s, of a trajectory: longer ones are left out


@dataclass(frozen=True)
class Label:
    """How a task ended."""

    outcome: str  # one of OUTCOMES
    trajectory: Trajectory | None = None  # where it is kept, in the scenario's frame
    cost: float = float("nan")  # J
    iterations: int = 0  # of the first solve
    rounds: int = 0
    source: str = SEARCHED  # of the guess, SEARCHED or LEARNED


def label(scenario: Scenario) -> Label:
    """Solve a task, anywhere, and keep the plan if it is verified."""
    x0, y0, _ = scenario.start
    local = scenario.translated(-x0, -y0)
    guess = next(HybridAStar(PLAN.knots, PLAN.search).guesses(local, Budget.of(SEARCH_SECONDS)))
    if isinstance(guess, NoGuess):
        return Label(NO_PATH)
    if PLAN.slack * guess.trajectory.duration > LONGEST or len(guess.trajectory) != PLAN.knots:
        return Label(TOO_LONG)
    return label_of(attempt(local, guess, FromGuess(), Budget.of(SOLVE_SECONDS), PLAN, closely=False), scenario)


def label_of(made: Attempt, scenario: Scenario) -> Label:
    """The label that an attempt, made in the frame of the start, is for a scenario."""
    kept = made.trajectory.translated(*scenario.start[:2]) if made.verified and made.trajectory else None
    cost = float("nan") if made.cost is None else made.cost.J
    return Label(KEPT if kept else UNVERIFIED, kept, cost, made.first_iterations, len(made.solves))
