"""Solve, verify, refine: the loop that turns a guess into a verified plan.

A few convex steps pull the guess near the optimum, and Ipopt finishes it.

Triangle areas hold at the knots only, have no gradient inside a polygon, and miss edges that cross without a vertex
inside. So every converged plan is verified densely; every (interval, convex obstacle) that came too close gets a swept
separating line, the rows near the trajectory are chosen anew, and the program is solved again from where it stopped.
What else the check found is answered in kind: collocation's cubics end a little beside the goal when the knots are far
apart, so the next solve aims as much to the other side; v and phi can exceed their limits between knots, so the knots
get a margin. A verified plan that passes an obstacle nearer than it must is widened once, and kept if that fails.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field, replace

import numpy as np

from drake_gnnocp.ocp.convex_step import ConvexOptions, ConvexSteps, convex_steps
from drake_gnnocp.ocp.cost import Cost, evaluate_cost
from drake_gnnocp.ocp.ipopt import IpoptOptions, solve
from drake_gnnocp.ocp.pairs import Pair, close_pairs, overlapping_pairs
from drake_gnnocp.ocp.problem import ProblemOptions, build, unpack
from drake_gnnocp.ocp.separating_line import Separation
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.simulation import DrivenMotion, drive
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import State
from drake_gnnocp.verification import HEADING_TOLERANCE, POSITION_TOLERANCE, Verification, min_clearance, verify

TOO_LATE = "out of time before the first solve"


@dataclass(frozen=True)
class RefineOptions:
    """When to refine and how."""

    problem: ProblemOptions = field(default_factory=ProblemOptions)
    ipopt: IpoptOptions = field(default_factory=IpoptOptions)
    convex: ConvexOptions = field(default_factory=ConvexOptions)
    finish: IpoptOptions = IpoptOptions(
        objective_change=5e-3, settled_iterations=1, complementarity=0.1, mu_init=3e-5, bound_multiplier=3.0
    )  # where the convex steps have settled: they have done the optimising, and a barrier of 1e-4 leads away from there
    finish_near: float = 1.2  # m, the problem's `near` then
    threshold: float = 0.02  # m, pairs that come nearer get a line
    gap: float = 0.02  # m, first gap of a line
    deep: float = 0.1  # m, overlap from which on the solver has jumped an obstacle, and starts again where it started
    guarded: float = 0.5  # m, pairs nearer than this at the start get a line after a solve that failed
    max_rounds: int = 8  # refinements after the first solve
    near_share: float = 0.75  # of the threshold: a verified plan nearer than this, and than its guess, is widened once
    end_share: float = 0.4  # of the clearance of start and goal: no line or least margin asks for more
    bounds_step: float = 0.005  # m, margin added to what the bounds were exceeded by
    limits_step: float = 0.002  # relative, added to what v or phi were exceeded by
    reserve: float = 0.2  # s, kept from the budget for the check after a solve


@dataclass(frozen=True)
class Round:
    """One solve of the loop."""

    build_seconds: float  # s
    solve_seconds: float  # s, Ipopt and the convex steps before it
    iterations: int  # Ipopt's
    success: bool  # Ipopt's word
    status: str  # Ipopt's
    violated: tuple[str, ...]  # descriptions of the constraints that did not hold
    rows: int
    lines: int
    verification: Verification
    convex_steps: int = 0  # quadratic programs before it
    convex_seconds: float = 0.0  # s, of them; part of solve_seconds


@dataclass(frozen=True)
class Optimised:
    """The outcome of the loop: the best trajectory and how it came about."""

    trajectory: Trajectory
    verification: Verification
    cost: Cost
    rounds: tuple[Round, ...]
    reason: str  # empty when verified, else why not


def optimise(
    scenario: Scenario,
    guess: Trajectory,
    options: RefineOptions,
    deadline: float = math.inf,
    stepped: ConvexSteps | None = None,
) -> Optimised:
    """Optimise a guess until the plan is verified, the rounds are used up, or the deadline passes.

    Args:
        scenario: the task, near the origin.
        guess: equally spaced knots, any quality.
        options: see `RefineOptions`.
        deadline: instant of `time.monotonic()` [s].
        stepped: what `take_convex_steps` made of the guess, where that is known.
    """
    stepped = stepped or take_convex_steps(scenario, guess, options, deadline - options.reserve)
    options = _fitted_to_ends(scenario, options)
    start = stepped.trajectory
    gaps = {pair: options.gap for pair in overlapping_pairs(scenario, start)}
    rounds: list[Round] = []
    best: tuple[Trajectory, Verification | None] = (guess, None)
    widened = False  # whether the solve to come only widens the gaps of a verified plan, which is kept if it fails
    while len(rounds) <= options.max_rounds and time.monotonic() < deadline - options.reserve:
        fitted = _fitted_to_start(options, stepped, guess)
        found, report = _solve_once(scenario, start, gaps, fitted, deadline - options.reserve)
        if not rounds:
            seconds = report.solve_seconds + stepped.seconds
            report = replace(report, solve_seconds=seconds, convex_steps=stepped.steps, convex_seconds=stepped.seconds)
        rounds.append(report)
        if best[1] is None or badness(report.verification) < badness(best[1]):
            best = (found, report.verification)
        if widened or time.monotonic() >= deadline - options.reserve:
            break
        if report.verification.verified:
            widened = _is_needlessly_near(scenario, guess, report.verification, options)
            if not widened:
                break
        if report.success or widened:
            close = close_pairs(scenario, found, options.threshold)
            start = found if min(close.values(), default=0.0) > -options.deep else start
            options = _answered(scenario, found, options)
        else:  # what it left behind tells nothing: guard everything that is near the start, the guess as it was given
            start, stepped = guess, replace(stepped, trajectory=guess, settled=False)
            close = close_pairs(scenario, start, options.guarded)
        _add_lines(gaps, close, options)
    trajectory, check = best
    check = check or verify(scenario, trajectory)
    cost = evaluate_cost(trajectory, scenario.centroids, options.problem.weights)
    return Optimised(trajectory, check, cost, tuple(rounds), _reason(check, rounds, deadline - options.reserve))


def badness(check: Verification) -> tuple[int, float, float]:
    """Order of plans: fewer faults first, then clearance, then the error at the goal."""
    return len(check.faults), -check.min_clearance_m, check.terminal_position_error_m


def _solve_once(
    scenario: Scenario, start: Trajectory, gaps: dict[Pair, float], options: RefineOptions, deadline: float
) -> tuple[Trajectory, Round]:
    begin = time.perf_counter()
    separations = [Separation(k, scenario.convex_obstacles[j], gap) for (k, j), gap in sorted(gaps.items())]
    problem = build(scenario, start, separations, options.problem)
    build_seconds = time.perf_counter() - begin
    left = min(deadline - time.monotonic(), 1e6)
    solution = solve(problem.program, problem.guess, problem.hessian, left, options.ipopt)
    trajectory = unpack(problem, solution.program_values)
    return trajectory, Round(
        build_seconds,
        solution.seconds,
        solution.iterations,
        solution.success,
        solution.status,
        solution.violated,
        problem.n_rows,
        len(gaps),
        verify(scenario, trajectory),
    )


def take_convex_steps(
    scenario: Scenario, guess: Trajectory, options: RefineOptions, deadline: float = math.inf
) -> ConvexSteps:
    """The convex steps that `optimise` begins with; none with a free horizon."""
    if options.problem.free_horizon or not options.convex.most_steps:
        return ConvexSteps(guess, 0, False, math.inf, 0.0)
    return convex_steps(scenario, guess, _fitted_to_ends(scenario, options).problem, options.convex, deadline)


def _fitted_to_start(options: RefineOptions, stepped: ConvexSteps, guess: Trajectory) -> RefineOptions:
    """Convex steps leave the margins they were asked for, and when they have settled little else to do."""
    problem = options.problem if stepped.trajectory is guess else replace(options.problem, guess_share=1.0)
    if not stepped.settled:
        return replace(options, problem=problem)
    return replace(options, problem=replace(problem, near=options.finish_near), ipopt=options.finish)


def _fitted_to_ends(scenario: Scenario, options: RefineOptions) -> RefineOptions:
    """Gaps and margins no larger than what start and goal allow."""
    ends = scenario.vehicle.footprints(np.stack([scenario.start, scenario.goal]))
    allowed = options.end_share * float(scenario.end_clearances.min(initial=math.inf))
    inside = options.end_share * max(0.0, -_beyond_bounds(scenario, ends))
    problem = replace(
        options.problem,
        least_margin=min(options.problem.least_margin, allowed),
        bounds_margin=min(options.problem.bounds_margin, inside),
    )
    return replace(options, problem=problem, gap=min(options.gap, allowed), threshold=min(options.threshold, allowed))


def _answered(scenario: Scenario, found: Trajectory, options: RefineOptions) -> RefineOptions:
    """Ask for what the check missed in a converged plan."""
    motion = drive(scenario.start, found, scenario.vehicle)
    problem = options.problem
    beyond = _beyond_bounds(scenario, scenario.vehicle.footprints(motion.states[:, :3]))
    if beyond > 0:
        problem = replace(problem, bounds_margin=problem.bounds_margin + beyond + options.bounds_step)
    excess = _beyond_limits(scenario, motion)
    if excess > 0:
        problem = replace(problem, limits_margin=min(0.5, problem.limits_margin + excess + options.limits_step))
    error = motion.states[-1, :3] - found.poses[-1] + problem.goal_offset
    if np.abs(error[:2]).max() > POSITION_TOLERANCE / 2 or abs(error[2]) > HEADING_TOLERANCE / 2:
        x, y, theta = np.array(problem.goal_offset) - error
        problem = replace(problem, goal_offset=(float(x), float(y), float(theta)))
    return replace(options, problem=problem)


def _beyond_bounds(scenario: Scenario, footprints: np.ndarray) -> float:
    """How far footprints (N, 4, 2) reach beyond the bounds; negative inside, -inf without bounds [m]."""
    if scenario.bounds is None:
        return -math.inf
    xmin, xmax, ymin, ymax = scenario.bounds
    (left, low), (right, high) = footprints.min(axis=(0, 1)), footprints.max(axis=(0, 1))
    return float(max(xmin - left, right - xmax, ymin - low, high - ymax))


def _beyond_limits(scenario: Scenario, motion: DrivenMotion) -> float:
    """How far v or phi exceed their limits anywhere, relative to them; negative when they do not."""
    v, phi = np.abs(motion.states[:, [State.V, State.PHI]]).max(axis=0)
    return float(max(v / scenario.vehicle.v_max, phi / scenario.vehicle.phi_max)) - 1.0


def _is_needlessly_near(scenario: Scenario, guess: Trajectory, check: Verification, options: RefineOptions) -> bool:
    """Whether a plan passes an obstacle nearer than it should and the guess does at its knots."""
    if check.min_clearance_m >= options.near_share * options.threshold:
        return False
    return min_clearance(scenario, scenario.vehicle.footprints(guess.poses)) > check.min_clearance_m


def _add_lines(gaps: dict[Pair, float], close: dict[Pair, float], options: RefineOptions) -> None:
    """Give the pairs that came too close a line, or a wider gap where they had one."""
    for pair, distance in close.items():
        if pair not in gaps:
            gaps[pair] = options.gap
        elif distance < options.threshold:
            gaps[pair] += min(options.threshold - distance, options.threshold)


def _reason(check: Verification, rounds: list[Round], deadline: float) -> str:
    if check.verified:
        return ""
    if not rounds:
        return TOO_LATE
    last = rounds[-1]
    late = ", out of time" if time.monotonic() >= deadline else ""
    violated = f", violated: {', '.join(last.violated[:3])}" if last.violated else ""
    return f"{'; '.join(check.faults)} after {len(rounds)} solves (Ipopt: {last.status}{late}{violated})"
