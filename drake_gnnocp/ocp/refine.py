"""Solve, verify, refine: the loop that turns a guess into a verified plan.

Triangle areas hold at the knots only, have no gradient inside a polygon, and miss edges that cross without a vertex
inside. So every converged plan is verified densely; every (interval, convex obstacle) that came too close gets a swept
separating line, the rows near the trajectory are chosen anew, and the program is solved again from where it stopped.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field, replace

import numpy as np
import shapely

from drake_gnnocp.ocp.cost import Cost, evaluate_cost
from drake_gnnocp.ocp.ipopt import IpoptOptions, Solution, solve
from drake_gnnocp.ocp.problem import ProblemOptions, build, unpack
from drake_gnnocp.ocp.separating_line import Separation, best_normal
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.verification import (
    CHECK_STEP,
    HEADING_TOLERANCE,
    POSITION_TOLERANCE,
    Verification,
    drive,
    min_clearance,
    verify,
)


@dataclass(frozen=True)
class RefineOptions:
    """When to refine and how."""

    problem: ProblemOptions = field(default_factory=ProblemOptions)
    ipopt: IpoptOptions = field(default_factory=IpoptOptions)
    threshold: float = 0.02  # m, pairs that come nearer get a line
    gap: float = 0.02  # m, first gap of a line
    deep: float = 0.1  # m, overlap from which on the solver has jumped an obstacle, and starts again where it started
    guarded: float = 0.5  # m, pairs nearer than this at the start get a line after a solve that failed
    max_rounds: int = 8  # refinements after the first solve
    end_share: float = 0.4  # of the clearance of start and goal: no margin asks for more


@dataclass
class Round:
    """One solve of the loop."""

    build_seconds: float
    solve_seconds: float
    iterations: int
    status: str
    rows: int
    lines: int
    verification: Verification


@dataclass(frozen=True)
class Optimised:
    """The outcome of the loop: the best trajectory and how it came about."""

    trajectory: Trajectory
    verification: Verification
    cost: Cost
    rounds: tuple[Round, ...]
    reason: str  # empty when verified, else why not


def optimise(
    scenario: Scenario, guess: Trajectory, options: RefineOptions, deadline: float = math.inf
) -> Optimised:
    """Optimise a guess until the plan is verified, the rounds are used up, or the deadline passes.

    Args:
        scenario: the task, near the origin.
        guess: equally spaced knots, any quality.
        options: see `RefineOptions`.
        deadline: instant of `time.monotonic()` [s].
    """
    options = _fitted_to_ends(scenario, options)
    gaps = {pair: options.gap for pair in _overlapping(scenario, guess)}
    rounds: list[Round] = []
    start, best = guess, None
    while len(rounds) <= options.max_rounds and time.monotonic() < deadline:
        found, success, report = _solve_once(scenario, start, gaps, options, deadline)
        rounds.append(report)
        if best is None or _badness(report.verification) < _badness(best[1]):
            best = (found, report.verification)
        if report.verification.verified:
            break
        if success:
            close = _close_pairs(scenario, found, options.threshold)
            start = found if min(close.values(), default=0.0) > -options.deep else start
        else:  # what it left behind tells nothing: guard everything that is near the start
            close = _close_pairs(scenario, start, options.guarded)
        _add_lines(gaps, close, options)
        options = _tightened(report.verification, options)
    if best is None:
        best = (guess, verify(scenario, guess))
    centroids = np.array([[p.centroid.x, p.centroid.y] for p in scenario.polygons]).reshape(-1, 2)
    cost = evaluate_cost(best[0], centroids, options.problem.weights)
    return Optimised(best[0], best[1], cost, tuple(rounds), _reason(best[1], rounds, deadline))


def _solve_once(
    scenario: Scenario,
    start: Trajectory,
    gaps: dict[tuple[int, int], float],
    options: RefineOptions,
    deadline: float,
) -> tuple[Trajectory, bool, Round]:
    begin = time.perf_counter()
    separations = [Separation(k, scenario.convex_obstacles[j], gap) for (k, j), gap in sorted(gaps.items())]
    problem = build(scenario, start, separations, options.problem)
    build_seconds = time.perf_counter() - begin
    hessian = 2 * options.problem.weights.lambda1 * problem.variables.fixed_step
    left = min(deadline - time.monotonic(), 1e6)
    solution: Solution = solve(problem.program, problem.guess, hessian, left, options.ipopt)
    trajectory = unpack(problem, solution.program_values)
    check = verify(scenario, trajectory)
    report = Round(
        build_seconds, solution.seconds, solution.iterations, solution.status, problem.n_rows, len(gaps), check
    )
    return trajectory, solution.success, report


def _fitted_to_ends(scenario: Scenario, options: RefineOptions) -> RefineOptions:
    """Margins no larger than what start and goal allow."""
    ends = scenario.vehicle.footprints(np.stack([scenario.start, scenario.goal]))
    allowed = options.end_share * min_clearance(scenario, ends)
    bounds_margin = options.problem.bounds_margin
    if scenario.bounds is not None:
        xmin, xmax, ymin, ymax = scenario.bounds
        (left, low), (right, high) = ends.min(axis=(0, 1)), ends.max(axis=(0, 1))
        to_bounds = max(0.0, min(left - xmin, xmax - right, low - ymin, ymax - high))
        bounds_margin = min(bounds_margin, options.end_share * to_bounds)
    problem = replace(options.problem, margin=min(options.problem.margin, allowed), bounds_margin=bounds_margin)
    return replace(
        options, problem=problem, gap=min(options.gap, allowed), threshold=min(options.threshold, allowed)
    )


def _overlapping(scenario: Scenario, guess: Trajectory) -> list[tuple[int, int]]:
    """(interval, convex obstacle) pairs whose obstacle the guess touches between or at the knots."""
    footprints = scenario.vehicle.footprints(guess.poses)
    hulls = shapely.convex_hull(shapely.multipoints(np.concatenate([footprints[:-1], footprints[1:]], axis=1)))
    return sorted(set(zip(*_pairs_within(scenario, hulls, 0.0), strict=True)))


def _pairs_within(scenario: Scenario, shapes: np.ndarray, distance: float) -> tuple[list[int], list[int]]:
    """Indices (shapes, convex obstacles) of the pairs within a distance [m]."""
    if not scenario.convex_obstacles:
        return [], []
    tree = shapely.STRtree([shapely.Polygon(ring) for ring in scenario.convex_obstacles])
    which, obstacle = tree.query(shapes, predicate="dwithin", distance=distance)
    return which.tolist(), obstacle.tolist()


def _add_lines(gaps: dict[tuple[int, int], float], close: dict[tuple[int, int], float], options: RefineOptions) -> None:
    """Give the pairs that came too close a line, or a wider gap where they had one."""
    for pair, distance in close.items():
        if pair not in gaps:
            gaps[pair] = options.gap
        elif distance < options.threshold:
            gaps[pair] += min(options.threshold - distance, options.threshold)


def _tightened(check: Verification, options: RefineOptions) -> RefineOptions:
    """Ask for a little more of what failed."""
    problem, ipopt = options.problem, options.ipopt
    if not check.bounds_ok:
        problem = replace(problem, bounds_margin=problem.bounds_margin + 0.02)
    if not check.limits_ok:
        problem = replace(problem, limits_margin=problem.limits_margin + 0.005)
    if check.terminal_position_error_m > POSITION_TOLERANCE or check.terminal_heading_error_rad > HEADING_TOLERANCE:
        ipopt = replace(ipopt, feasibility=ipopt.feasibility / 10)
    return replace(options, problem=problem, ipopt=ipopt)


def _close_pairs(scenario: Scenario, trajectory: Trajectory, threshold: float) -> dict[tuple[int, int], float]:
    """Distance of every (interval, convex obstacle) that the driven car passes nearer than the threshold [m].

    Overlaps count as negative distances.
    """
    motion = drive(scenario.start, trajectory, scenario.vehicle)
    corners = scenario.vehicle.footprints(motion.states[::CHECK_STEP, :3])
    footprints = shapely.polygons(corners)
    rings = [shapely.Polygon(ring) for ring in scenario.convex_obstacles]
    samples, obstacles = _pairs_within(scenario, footprints, threshold)
    intervals = np.minimum(np.array(samples) * CHECK_STEP // motion.steps_per_interval, len(trajectory) - 2)
    nearest: dict[tuple[int, int], tuple[float, int]] = {}
    for sample, k, j in zip(samples, intervals.tolist(), obstacles, strict=True):
        distance = float(shapely.distance(footprints[sample], rings[j]))
        nearest[k, j] = min(nearest.get((k, j), (math.inf, 0)), (distance, sample))
    return {
        (k, j): distance if distance > 0 else best_normal(corners[sample], scenario.convex_obstacles[j])[2]
        for (k, j), (distance, sample) in nearest.items()
    }


def _badness(check: Verification) -> tuple[int, float, float]:
    """Order of plans: fewer faults first, then clearance, then the error at the goal."""
    return len(check.faults), -check.min_clearance_m, check.terminal_position_error_m


def _reason(check: Verification, rounds: list[Round], deadline: float) -> str:
    if check.verified:
        return ""
    if not rounds:
        return "out of time before the first solve"
    late = ", out of time" if time.monotonic() >= deadline else ""
    return f"{'; '.join(check.faults)} after {len(rounds)} solves (Ipopt: {rounds[-1].status}{late})"
