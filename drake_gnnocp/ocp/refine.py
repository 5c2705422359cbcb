"""Solve, verify, answer: the loop that turns a guess into a verified plan.

A few SQP steps pull the guess near the optimum, and Ipopt finishes it.

Triangle areas hold at the knots only, have no gradient inside a polygon, and miss edges that cross without a vertex
inside. So every converged plan is verified densely; every (interval, convex obstacle) that came too close gets a swept
separating line, the rows near the trajectory are chosen anew, and the program is solved again from where it stopped.
What else the check found is answered in kind: collocation's cubics end a little beside the goal when the knots are far
apart, so the next solve aims as much to the other side; v and phi can exceed their limits between knots, so the knots
get a margin. A verified plan with less than a comfortable clearance is solved once more for it; what comes out is taken
where it is verified, has more clearance where it was short of it, and costs little more.
"""

from __future__ import annotations

import logging
import time
from dataclasses import dataclass, replace

import numpy as np

from drake_gnnocp.budget import Budget
from drake_gnnocp.ocp import ipopt
from drake_gnnocp.ocp.answers import LEFT_BY_STEPS, answer, to_finish, with_lines
from drake_gnnocp.ocp.close_pairs import overlapping_pairs
from drake_gnnocp.ocp.comfort import close_around, shortfall, with_more_clearance
from drake_gnnocp.ocp.costs import cost_terms, total_cost
from drake_gnnocp.ocp.formulation import Formulation, demand_of
from drake_gnnocp.ocp.ipopt import FINISH, USUAL, IpoptSettings
from drake_gnnocp.ocp.nlp import build
from drake_gnnocp.ocp.sqp import SqpSteps
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.verification import Verification, verify

logger = logging.getLogger(__name__)

MOST_ANSWERS = 8  # refinements after the first solve
# Ipopt's, of all solves, after which no other one follows: a verified plan of a hard task took 615. Where SQP steps
# have converged, what is not finished soon never is
MOST_ITERATIONS, MOST_FINISHING = 800, 200
DEARER, MOST_WIDENING = 1.02, 20  # of a plan's cost: what more clearance may cost; iterations of Ipopt for it


@dataclass(frozen=True, eq=False)
class Solve:
    """One solve of the loop."""

    build_seconds: float  # s
    solve_seconds: float  # s, Ipopt's
    iterations: int  # Ipopt's
    success: bool  # Ipopt's word
    status: str  # Ipopt's
    violated: tuple[str, ...]  # descriptions of the constraints that did not hold
    rows: int
    lines: int
    trajectory: Trajectory
    verification: Verification

    @property
    def merit(self) -> tuple[int, float, float]:
        """Order of plans, the best first: fewer faults, then more clearance, then the smaller error at the goal."""
        check = self.verification
        return len(check.faults), -check.min_clearance_m, check.terminal_position_error_m

    def placed(self, dx: float, dy: float, unit: float) -> Solve:
        """The solve in metres, of the task moved by (dx, dy) [m]; the trajectory's lengths are in a unit [m]."""
        trajectory = self.trajectory.scaled(unit).translated(dx, dy)
        check = self.verification.translated(dx, dy)  # which is in metres
        return replace(self, trajectory=trajectory, verification=check)


@dataclass(frozen=True, eq=False)
class Refined:
    """The outcome of the loop: all solves, and which of them is the best."""

    solves: tuple[Solve, ...]
    best: int | None  # index of the solve; None without one
    reason: str  # empty when verified, else why not

    @property
    def trajectory(self) -> Trajectory | None:
        """That of the best solve."""
        return None if self.best is None else self.solves[self.best].trajectory

    @property
    def verified(self) -> bool:
        """Whether the best solve led to a plan."""
        return self.best is not None and self.solves[self.best].verification.verified

    def followed_by(self, again: Refined, is_taken: bool) -> Refined:
        """All solves of both, and the best of the second where that is taken, else that of the first."""
        solves = self.solves + again.solves
        if is_taken and again.best is not None:
            return Refined(solves, len(self.solves) + again.best, again.reason)
        return replace(self, solves=solves)


def refine(
    scenario: Scenario,
    formulation: Formulation,
    budget: Budget,
    steps: SqpSteps | None = None,
    settings: IpoptSettings = USUAL,
) -> Refined:
    """Solve, verify and answer until the plan is verified, there were enough solves, or the budget is over.

    Args:
        scenario: the task, near the origin.
        formulation: around the guess.
        budget: to stop at.
        steps: where SQP steps led from the guess, if they were taken.
        settings: of Ipopt; where the steps have converged, they are those of the finish.
    """
    given, given_settings, guess = formulation, settings, formulation.reference
    if steps is not None and steps.trajectory is not guess:
        formulation = replace(formulation, reference=steps.trajectory, reference_share=LEFT_BY_STEPS)
    if steps is not None and steps.converged:
        formulation, settings = to_finish(formulation, steps.trajectory), FINISH
    formulation = with_lines(formulation, dict.fromkeys(overlapping_pairs(formulation), 0.0))
    if budget.is_over:
        return Refined((), None, budget.ended_before("the first solve"))
    most_iterations = MOST_FINISHING if settings is FINISH else MOST_ITERATIONS
    solves: list[Solve] = []
    best = 0
    while True:
        begin = budget.spent
        solve = solve_once(scenario, formulation, settings, budget)
        seconds = budget.spent - begin
        solves.append(solve)
        best = min(best, len(solves) - 1, key=lambda i: solves[i].merit)
        if solve.verification.verified:
            widened = _widened(scenario, formulation, solve, budget, seconds)
            if widened is not None:
                wider, is_taken = widened
                solves.append(wider)
                best += is_taken
            break
        if not solve.success and formulation.reference is guess and settings is given_settings:
            break  # what it left behind tells nothing, and the next solve would be the same
        if len(solves) > MOST_ANSWERS or sum(done.iterations for done in solves) >= most_iterations or budget.is_over:
            break
        if solve.success:
            formulation = answer(scenario, formulation, solve.trajectory)
        else:  # back to the guess as it was given, with what the check has asked for
            answered, settings = formulation, given_settings
            formulation = replace(given, lines=answered.lines, limits_margin=answered.limits_margin, goal=answered.goal)
    return Refined(tuple(solves), best, _reason(solves[best].verification, solves, budget))


def solve_once(scenario: Scenario, formulation: Formulation, settings: IpoptSettings, budget: Budget) -> Solve:
    """Build the program of a formulation, solve it and verify what comes out."""
    begin = time.perf_counter()
    nlp = build(formulation)
    build_seconds = time.perf_counter() - begin
    solution = ipopt.solve(nlp.program, nlp.first_iterate, nlp.hessian, budget.left, settings)
    budget.ended = budget.ended or solution.status == ipopt.OUT_OF_TIME
    trajectory = nlp.trajectory(solution.program_values)
    violated = ", ".join(solution.violated[:3]) or "nothing"
    logger.debug("Ipopt: %s after %d iterations, violated: %s", solution.status, solution.iterations, violated)
    return Solve(
        build_seconds=build_seconds,
        solve_seconds=solution.seconds,
        iterations=solution.iterations,
        success=solution.success,
        status=solution.status,
        violated=solution.violated,
        rows=nlp.n_rows,
        lines=len(formulation.lines),
        trajectory=trajectory,
        verification=verify(scenario, trajectory),
    )


def _widened(
    scenario: Scenario, formulation: Formulation, solve: Solve, budget: Budget, seconds: float
) -> tuple[Solve, bool] | None:
    """A solve for a comfortable clearance, around a verified plan, and whether that is to be taken.

    It is where it is verified, has more clearance where that was short, and costs little more. None where the plan has
    the clearance, SQP steps lead to none that has more, or there is no time for a solve like that before, in seconds.
    """
    clearance = solve.verification.min_clearance_m / scenario.unit
    if formulation.comfort <= scenario.clearance or clearance >= formulation.comfort:
        return None
    if not budget.lasts(seconds):
        return None
    comfortable = replace(formulation, demand=demand_of(scenario, formulation.comfort))
    around, close = close_around(scenario, comfortable, solve.trajectory)
    missed = shortfall(around, close)
    if not missed:
        return None
    wanted = answer(scenario, comfortable, solve.trajectory)
    asked = with_more_clearance(scenario, formulation, wanted, close, budget)
    if asked is None:
        return None
    wider = solve_once(scenario, asked, replace(FINISH, max_iterations=MOST_WIDENING), budget)
    misses = shortfall(*close_around(scenario, comfortable, wider.trajectory))
    is_cheap = _cost(formulation, wider.trajectory) <= DEARER * _cost(formulation, solve.trajectory)
    return wider, wider.verification.verified and misses < missed and is_cheap


def _cost(formulation: Formulation, found: Trajectory) -> float:
    knots, terms = np.hstack([found.states, found.inputs]), cost_terms(formulation.weights, formulation.proximity)
    return total_cost(terms, knots, found.duration / (len(found) - 1))


def _reason(check: Verification, solves: list[Solve], budget: Budget) -> str:
    if check.verified:
        return ""
    late = " when time ran out" if budget.ended else ""
    return f"the optimised plan {', '.join(check.faults)} after {counted(len(solves), 'solve')}{late}"


def counted(number: int, noun: str) -> str:
    """A number of things: "1 solve", "2 solves"."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
