"""One task solved: Hybrid A*, speed planner, optimal control, verification. Only what is verified is kept."""

from __future__ import annotations

import time
from dataclasses import dataclass

from drake_gnnocp.guesses.sources import GuessOptions, hybrid_astar_guess
from drake_gnnocp.ocp.refine import Optimised, RefineOptions, optimise
from drake_gnnocp.planner.planner import PlanOptions
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.timing.minimum_effort import gently_timed
from drake_gnnocp.trajectory import Trajectory

KEPT, NO_PATH, UNVERIFIED, TOO_LONG = "kept", "no path", "unverified", "too long"  # also for its knots
OUTCOMES = (KEPT, NO_PATH, UNVERIFIED, TOO_LONG)
SEARCHED, LEARNED = "hybrid_astar", "gnn"  # whose guess led to a label


@dataclass(frozen=True)
class LabelOptions:
    """How a task is solved."""

    guess: GuessOptions = GuessOptions()
    refine: RefineOptions = RefineOptions()
    slack: float = PlanOptions().slack  # duration given to the optimiser over the guess's, the planner's
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
    found = hybrid_astar_guess(local, options.guess, time.monotonic() + options.search_seconds).trajectory
    if found is None:
        return Label(NO_PATH)
    if options.slack * found.duration > options.longest or len(found) != options.guess.n_knots:
        return Label(TOO_LONG)
    guess = gently_timed(found, options.slack * found.duration, local.vehicle)
    plan = optimise(local, guess, options.refine, time.monotonic() + options.solve_seconds)
    return label_of(plan, scenario)


def label_of(plan: Optimised, scenario: Scenario) -> Label:
    """The label that an optimised plan, made in the frame of the start, is for a scenario."""
    first = plan.rounds[0].iterations if plan.rounds else 0
    if not plan.verification.verified:
        return Label(UNVERIFIED, None, plan.cost.J, first, len(plan.rounds))
    x0, y0, _ = scenario.start
    return Label(KEPT, plan.trajectory.translated(x0, y0), plan.cost.J, first, len(plan.rounds))
