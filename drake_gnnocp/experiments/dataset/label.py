"""One task solved: Hybrid A*, speed planner, optimal control, verification. Only what is verified is kept."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from drake_gnnocp.budget import Budget
from drake_gnnocp.guesses import Guess, HybridAStar
from drake_gnnocp.planner import Attempt, FromGuess, PlanOptions
from drake_gnnocp.planner.attempt import attempt
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.search.moves import Costs
from drake_gnnocp.search.path import n_sections
from drake_gnnocp.search.stages import HybridAStarOptions
from drake_gnnocp.trajectory import Trajectory

KEPT, NO_PATH, UNVERIFIED, TOO_LONG = "kept", "no path", "unverified", "too long"  # also for its knots
OUTCOMES = (KEPT, NO_PATH, UNVERIFIED, TOO_LONG)
SEARCHED, LEARNED = "hybrid_astar", "gnn"  # whose guess led to a label


PLAN = PlanOptions()  # of all labels
FEW_CHANGES = HybridAStarOptions(costs=Costs(gear_change=10.0))  # half as many changes of gear; takes longer
SEARCH_SECONDS, SOLVE_SECONDS = 4.0, 15.0  # s, most for a Hybrid A*, and for the optimal control problem
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
    """Solve a task, anywhere, and keep the plan if it is verified: the one from the path of fewest changes of gear."""
    near = scenario.as_planned
    paths = list(_paths(near))
    found = Label(NO_PATH)
    for guess in sorted(paths, key=_changes_and_duration):
        if PLAN.slack * guess.trajectory.duration > LONGEST or len(guess.trajectory) != PLAN.knots:
            found = Label(TOO_LONG)
            continue
        for closely in (False, True):
            made = attempt(near, guess, FromGuess(), Budget.of(SOLVE_SECONDS), PLAN, closely=closely)
            found = label_of(made, scenario, near.unit)
            if found.outcome == KEPT:
                return found
    return found


def label_of(made: Attempt, scenario: Scenario, unit: float) -> Label:
    """The label that an attempt at a scenario `as_planned`, where lengths are in a unit [m], is for it."""
    cost = float("nan") if made.cost is None else made.cost.J
    x0, y0, _ = scenario.start
    kept = made.placed(x0, y0, unit).trajectory if made.verified else None
    kept = kept and kept.resampled(PLAN.knots)  # where hardly any room is left, plans have more
    return Label(KEPT if kept else UNVERIFIED, kept, cost, made.first_iterations, len(made.solves))


def _paths(scenario: Scenario) -> Iterator[Guess]:
    """What Hybrid A* finds, and where that changes gear, what it finds when changes are dear."""
    for options in (PLAN.search, FEW_CHANGES):
        guess = next(HybridAStar(PLAN.knots, options).guesses(scenario, Budget.of(SEARCH_SECONDS)))
        if not isinstance(guess, Guess) or guess.path is None:
            return
        yield guess
        if n_sections(guess.path) == 1:
            return


def _changes_and_duration(guess: Guess) -> tuple[int, float]:
    assert guess.path is not None
    return n_sections(guess.path), guess.trajectory.duration
