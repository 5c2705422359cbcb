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
from drake_gnnocp.ocp.close_pairs import Pair, close_pairs, overlapping_pairs
from drake_gnnocp.ocp.costs import cost_terms, total_cost
from drake_gnnocp.ocp.formulation import Formulation, Line, demand_of
from drake_gnnocp.ocp.ipopt import FINISH, USUAL, IpoptSettings
from drake_gnnocp.ocp.nlp import build
from drake_gnnocp.ocp.sqp import SqpSettings, SqpSteps, sqp_steps
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.simulation import DrivenMotion, drive
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import State
from drake_gnnocp.verification import HEADING_TOLERANCE, POSITION_TOLERANCE, Verification, verify
from drake_gnnocp.verification.clearance import TIGHT

logger = logging.getLogger(__name__)

MOST_ANSWERS = 8  # refinements after the first solve
# Ipopt's, of all solves, after which no other one follows: a verified plan of a hard task took 615. Where SQP steps
# have converged, what is not finished soon never is
MOST_ITERATIONS, MOST_FINISHING = 800, 200
# where SQP steps have converged, little moves any more: Ipopt with its approximate Hessian is kept near there, or it
# wanders off along flat directions of long plans, for hundreds of iterations
FINISH_ROWS_WITHIN, FINISH_TRUST_REGION = 1.2, (0.15, 0.15, 0.1)  # m; m, m, rad
DEARER = 1.02  # of a plan's cost: what more clearance may cost
MOST_WIDENING = 40  # iterations of Ipopt for it
# plans of so many knots take SQP steps towards it first: Ipopt alone takes twice as long for them
MANY_KNOTS, FIRST_STEPS = 240, SqpSettings(most_steps=4)
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
        # steps leave the margins they were asked for
        formulation = replace(formulation, reference=steps.trajectory, reference_share=1.0)
    if steps is not None and steps.converged:
        near = replace(formulation, rows_within=FINISH_ROWS_WITHIN, trust_region=FINISH_TRUST_REGION)
        formulation, settings = near, FINISH
    formulation = _with_lines(formulation, dict.fromkeys(overlapping_pairs(formulation), 0.0))
    if budget.is_over:
        return Refined((), None, budget.ended_before("the first solve"))
    most_iterations = MOST_FINISHING if settings is FINISH else MOST_ITERATIONS
    solves: list[Solve] = []
    best = 0
    while True:
        solve = solve_once(scenario, formulation, settings, budget)
        solves.append(solve)
        best = min(best, len(solves) - 1, key=lambda i: solves[i].merit)
        if solve.verification.verified:
            widened = _widened(scenario, formulation, solve, settings, budget)
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
            formulation = answer(scenario, formulation, solve)
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
    scenario: Scenario, formulation: Formulation, solve: Solve, settings: IpoptSettings, budget: Budget
) -> tuple[Solve, bool] | None:
    """A solve for a comfortable clearance, around a verified plan, and whether that is to be taken.

    It is where it is verified, has more clearance where that was short, and costs little more. None where the plan has
    the clearance, or there is no time.
    """
    if formulation.comfort <= scenario.clearance:
        return None
    comfortable = replace(formulation, demand=demand_of(scenario, formulation.comfort))
    missed = _shortfall(scenario, comfortable, solve.trajectory)
    if not missed or budget.is_over:
        return None
    few, asked = replace(settings, max_iterations=MOST_WIDENING), answer(scenario, comfortable, solve)
    if len(asked.reference) >= MANY_KNOTS:
        nearer = replace(asked, reference=sqp_steps(asked, FIRST_STEPS, budget).trajectory)
        asked = _with_lines(nearer, close_pairs(nearer, drive(scenario.start, nearer.reference, scenario.vehicle)))
    wider = solve_once(scenario, asked, few, budget)
    misses = _shortfall(scenario, comfortable, wider.trajectory)
    is_cheap = _cost(formulation, wider.trajectory) <= DEARER * _cost(formulation, solve.trajectory)
    return wider, wider.verification.verified and misses < missed and is_cheap


def _cost(formulation: Formulation, found: Trajectory) -> float:
    knots, terms = np.hstack([found.states, found.inputs]), cost_terms(formulation.weights, formulation.proximity)
    return total_cost(terms, knots, found.duration / (len(found) - 1))


def _shortfall(scenario: Scenario, formulation: Formulation, found: Trajectory) -> float:
    """How much a trajectory lacks of the clearance that is asked for at worst, 0 where it has that everywhere [m]."""
    around = replace(formulation, reference=found)
    close = close_pairs(around, drive(scenario.start, found, scenario.vehicle))
    pairs = np.array(list(close), dtype=int).reshape(-1, 2)
    lacking = around.between(*pairs.T) - np.fromiter(close.values(), float)
    return float(lacking.max(initial=0.0, where=lacking > TIGHT))


def answer(scenario: Scenario, formulation: Formulation, solve: Solve) -> Formulation:
    """The formulation that asks for what the check missed in a converged plan, around that plan."""
    found = solve.trajectory
    motion = drive(scenario.start, found, scenario.vehicle)
    excess = _beyond_limits(scenario, motion)
    limits_margin = formulation.limits_margin + excess + LIMITS_STEP
    answered = replace(
        formulation,
        reference=found,
        goal=_aimed_goal(scenario, formulation, motion, found),
        limits_margin=min(LARGEST_LIMITS_MARGIN, limits_margin) if excess > 0 else formulation.limits_margin,
    )
    return _with_lines(answered, close_pairs(answered, motion))


def _aimed_goal(scenario: Scenario, formulation: Formulation, motion: DrivenMotion, found: Trajectory) -> np.ndarray:
    """The goal, or as far beside it as the driven motion ends to the other side."""
    at, end = formulation.goal[: State.V], motion.states[-1, : State.V]
    turns = 2 * np.pi * np.round((at[State.THETA] - scenario.goal[State.THETA]) / (2 * np.pi))
    error = end - (scenario.goal + [0.0, 0.0, turns])
    if formulation.target is not None:
        beyond = formulation.target.excess(end)
        error = np.append(beyond[:2] @ formulation.target.axes, beyond[2])
    if np.abs(error[:2]).max() <= POSITION_TOLERANCE / 2 and abs(error[2]) <= HEADING_TOLERANCE / 2:
        return formulation.goal
    return np.append(at - error, formulation.goal[State.V :])


def _beyond_limits(scenario: Scenario, motion: DrivenMotion) -> float:
    """How far v or phi exceed their limits anywhere, relative to them; negative when they do not."""
    v, phi = np.abs(motion.states[:, [State.V, State.PHI]]).max(axis=0)
    return float(max(v / scenario.vehicle.v_max, phi / scenario.vehicle.phi_max)) - 1.0


def _with_lines(formulation: Formulation, close: dict[Pair, float]) -> Formulation:
    """The pairs that came too close get a line, or a line with more clearance where they had one."""
    clearances = {(line.interval, line.obstacle): line.clearance for line in formulation.lines}
    asked = formulation.between(*np.array(list(close), dtype=int).reshape(-1, 2).T).tolist()
    for (pair, distance), least in zip(close.items(), asked, strict=True):
        if pair not in clearances:
            clearances[pair] = least
        elif distance < least:
            clearances[pair] = max(least, clearances[pair] + min(least - distance, least))
    lines = tuple(Line(interval, j, clearance) for (interval, j), clearance in sorted(clearances.items()))
    return replace(formulation, lines=lines)


def _reason(check: Verification, solves: list[Solve], budget: Budget) -> str:
    if check.verified:
        return ""
    late = " when time ran out" if budget.ended else ""
    return f"the optimised plan {', '.join(check.faults)} after {counted(len(solves), 'solve')}{late}"


def counted(number: int, noun: str) -> str:
    """A number of things: "1 solve", "2 solves"."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
