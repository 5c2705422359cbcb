"""Solve, verify, answer: the loop that turns a guess into a verified plan.

A few SQP steps pull the guess near the optimum, and Ipopt finishes it.

Triangle areas hold at the knots only, have no gradient inside a polygon, and miss edges that cross without a vertex
inside. So every converged plan is verified densely; every (interval, convex obstacle) that came too close gets a swept
separating line, the rows near the trajectory are chosen anew, and the program is solved again from where it stopped.
What else the check found is answered in kind: collocation's cubics end a little beside the goal when the knots are far
apart, so the next solve aims as much to the other side; v and phi can exceed their limits between knots, so the knots
get a margin. A verified plan that passes an obstacle nearer than it must is widened once, and kept if that fails.
"""

from __future__ import annotations

import logging
import time
from dataclasses import dataclass, replace

import numpy as np

from drake_gnnocp.budget import Budget
from drake_gnnocp.ocp import ipopt
from drake_gnnocp.ocp.close_pairs import Pair, close_pairs, overlapping_pairs
from drake_gnnocp.ocp.formulation import Formulation, Line
from drake_gnnocp.ocp.ipopt import FINISH, USUAL, IpoptSettings
from drake_gnnocp.ocp.nlp import build
from drake_gnnocp.ocp.sqp import SqpSteps
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.simulation import DrivenMotion, drive
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import State
from drake_gnnocp.verification import HEADING_TOLERANCE, POSITION_TOLERANCE, Verification, min_clearance, verify
from drake_gnnocp.verification.clearance import TIGHT

logger = logging.getLogger(__name__)

TOO_LATE = "out of time before the first solve"
RESERVE = 0.2  # s, kept from the budget for the check after a solve
MOST_ANSWERS = 8  # refinements after the first solve
FINISH_ROWS_WITHIN = 1.2  # m, where SQP steps have converged: little moves any more
NEEDLESSLY_NEAR = 0.75  # of the line clearance: a verified plan nearer than this, and than its guess, is widened once
LIMITS_STEP, LARGEST_LIMITS_MARGIN = 0.002, 0.5  # relative, added to what v or phi were exceeded by; most in all


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
        budget: of it, a little is kept for the last check.
        steps: where SQP steps led from the guess, if they were taken.
        settings: of Ipopt; where the steps have converged, they are those of the finish.
    """
    budget = budget.without(RESERVE)
    given, given_settings, guess = formulation, settings, formulation.reference
    if steps is not None and steps.trajectory is not guess:
        # steps leave the margins they were asked for
        formulation = replace(formulation, reference=steps.trajectory, reference_share=1.0)
    if steps is not None and steps.converged:
        formulation, settings = replace(formulation, rows_within=FINISH_ROWS_WITHIN), FINISH
    formulation = _with_lines(formulation, dict.fromkeys(overlapping_pairs(formulation), 0.0))
    solves: list[Solve] = []
    best, widening = 0, False
    while len(solves) <= MOST_ANSWERS and not budget.is_over:
        solve = solve_once(scenario, formulation, settings, budget)
        solves.append(solve)
        best = min(best, len(solves) - 1, key=lambda i: solves[i].merit)
        if widening or budget.is_over:
            break
        if solve.verification.verified:
            widening = _is_needlessly_near(scenario, guess, formulation, solve.verification)
            if not widening:
                break
        if solve.success or widening:
            formulation = answer(scenario, formulation, solve)
        elif formulation.reference is guess and settings is given_settings:
            break  # what it left behind tells nothing, and the next solve would be the same
        else:  # back to the guess as it was given
            share, within = given.reference_share, given.rows_within
            formulation = replace(formulation, reference=guess, reference_share=share, rows_within=within)
            settings = given_settings
    if not solves:
        return Refined((), None, TOO_LATE)
    return Refined(tuple(solves), best, _reason(solves[best].verification, solves, budget))


def solve_once(scenario: Scenario, formulation: Formulation, settings: IpoptSettings, budget: Budget) -> Solve:
    """Build the program of a formulation, solve it and verify what comes out."""
    begin = time.perf_counter()
    nlp = build(formulation)
    build_seconds = time.perf_counter() - begin
    solution = ipopt.solve(nlp.program, nlp.first_iterate, nlp.hessian, budget.left, settings)
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


def answer(scenario: Scenario, formulation: Formulation, solve: Solve) -> Formulation:
    """The formulation that asks for what the check missed in a converged plan, around that plan."""
    found = solve.trajectory
    motion = drive(scenario.start, found, scenario.vehicle)
    close = close_pairs(formulation, motion, formulation.line_clearances)
    excess = _beyond_limits(scenario, motion)
    limits_margin = formulation.limits_margin + excess + LIMITS_STEP
    answered = replace(
        formulation,
        reference=found,
        goal=_aimed_goal(scenario, formulation, motion, found),
        limits_margin=min(LARGEST_LIMITS_MARGIN, limits_margin) if excess > 0 else formulation.limits_margin,
    )
    return _with_lines(answered, close)


def _aimed_goal(scenario: Scenario, formulation: Formulation, motion: DrivenMotion, found: Trajectory) -> np.ndarray:
    """The goal, or as far beside it as the driven motion ends to the other side."""
    at = formulation.goal[: State.V]
    turns = 2 * np.pi * np.round((at[State.THETA] - scenario.goal[State.THETA]) / (2 * np.pi))
    error = motion.states[-1, : State.V] - (scenario.goal + [0.0, 0.0, turns])
    if np.abs(error[:2]).max() <= POSITION_TOLERANCE / 2 and abs(error[2]) <= HEADING_TOLERANCE / 2:
        return formulation.goal
    return np.append(at - error, formulation.goal[State.V :])


def _beyond_limits(scenario: Scenario, motion: DrivenMotion) -> float:
    """How far v or phi exceed their limits anywhere, relative to them; negative when they do not."""
    v, phi = np.abs(motion.states[:, [State.V, State.PHI]]).max(axis=0)
    return float(max(v / scenario.vehicle.v_max, phi / scenario.vehicle.phi_max)) - 1.0


def _is_needlessly_near(scenario: Scenario, guess: Trajectory, formulation: Formulation, check: Verification) -> bool:
    """Whether a plan passes an obstacle nearer than it should and the guess does at its knots; walls are none."""
    asked = formulation.line_clearances[: len(scenario.convex_obstacles)]
    if check.min_clearance_m >= NEEDLESSLY_NEAR * asked.max(initial=0.0):
        return False
    # what is proven of the plan may be that much less than it has
    return min_clearance(scenario, scenario.vehicle.footprints(guess.poses)) > check.min_clearance_m + TIGHT


def _with_lines(formulation: Formulation, close: dict[Pair, float]) -> Formulation:
    """The pairs that came too close get a line, or a line with more clearance where they had one."""
    clearances = {(line.interval, line.obstacle): line.clearance for line in formulation.lines}
    for pair, distance in close.items():
        if pair not in clearances:
            clearances[pair] = float(formulation.line_clearances[pair[1]])
        elif distance < (least := float(formulation.line_clearances[pair[1]])):
            clearances[pair] += min(least - distance, least)
    lines = tuple(Line(interval, j, clearance) for (interval, j), clearance in sorted(clearances.items()))
    return replace(formulation, lines=lines)


def _reason(check: Verification, solves: list[Solve], budget: Budget) -> str:
    if check.verified:
        return ""
    late = " when time ran out" if budget.is_over else ""
    return f"the optimised plan {', '.join(check.faults)} after {counted(len(solves), 'solve')}{late}"


def counted(number: int, noun: str) -> str:
    """A number of things: "1 solve", "2 solves"."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
