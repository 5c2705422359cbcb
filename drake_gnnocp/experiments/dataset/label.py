"""One task solved: Hybrid A*, speed planner, optimal control, verification. Only what is verified is kept."""

from __future__ import annotations

from dataclasses import dataclass

from drake_gnnocp.budget import Budget
from drake_gnnocp.guesses import HybridAStar, NoGuess
from drake_gnnocp.planner import Attempt, FromGuess, PlanOptions
from drake_gnnocp.planner.attempt import attempt
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.trajectory import Trajectory

KEPT, NO_PATH, UNVERIFIED, TOO_LONG = "kept", "no path", "unverified", "too long"  # also for its knots
OUTCOMES = (KEPT, NO_PATH, UNVERIFIED, TOO_LONG)
SEARCHED, LEARNED = "hybrid_astar", "gnn"  # whose guess led to a label


@dataclass(frozen=True)
class LabelOptions:
    """How a task is solved."""

    plan: PlanOptions = PlanOptions()
    search_seconds: float = 8.0  # s, most for Hybrid A*
    solve_seconds: float = 15.0  # s, most for the optimal control problem
    longest: float = 150.0  # s, of a trajectory: longer ones are left out


@dataclass(frozen=True)
class Label:
    """How a task ended."""

    outcome: str  # one of OUTCOMES
    trajectory: Trajectory | None = None  # where it is kept, in the scenario's frame
    cost: float = float("nan")  # J
    iterations: int = 0  # of the first solve
    rounds: int = 0
    source: str = SEARCHED  # of the guess, SEARCHED or LEARNED


def label(scenario: Scenario, options: LabelOptions) -> Label:
    """Solve a task and keep the plan if it is verified.

    Args:
        scenario: the task, anywhere.
        options: see `LabelOptions`.
    """
    x0, y0, _ = scenario.start
    local = scenario.translated(-x0, -y0)
    source = HybridAStar(options.plan.knots, options.plan.search)
    guess = next(source.guesses(local, Budget.of(options.search_seconds)))
    if isinstance(guess, NoGuess):
        return Label(NO_PATH)
    is_long = options.plan.slack * guess.trajectory.duration > options.longest
    if is_long or len(guess.trajectory) != options.plan.knots:
        return Label(TOO_LONG)
    made = attempt(local, guess, FromGuess(), Budget.of(options.solve_seconds), options.plan, closely=False)
    return label_of(made, scenario)


def label_of(made: Attempt, scenario: Scenario) -> Label:
    """The label that an attempt, made in the frame of the start, is for a scenario."""
    cost = float("nan") if made.cost is None else made.cost.J
    if not made.verified or made.trajectory is None:
        return Label(UNVERIFIED, None, cost, made.first_iterations, len(made.solves))
    x0, y0, _ = scenario.start
    return Label(KEPT, made.trajectory.translated(x0, y0), cost, made.first_iterations, len(made.solves))
