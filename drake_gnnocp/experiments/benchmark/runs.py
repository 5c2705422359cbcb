"""Runs of the benchmark, the rows of a CSV file, and how a plan becomes one."""

from __future__ import annotations

import math
from dataclasses import dataclass

from drake_gnnocp.experiments.benchmark.disparity import blocked_share, disparity, mean_gap
from drake_gnnocp.planner.result import Plan


@dataclass(frozen=True)
class Run:
    """One method on one scenario; of times and iterations those of all attempts count."""

    scenario: str
    kind: str  # "library", "file", or the kind of the map it was drawn on
    method: str
    repeat: int  # from 0
    guess_s: float  # s, making guesses
    build_s: float  # s, building programs, all rounds
    solve_s: float  # s, in the solver, all rounds
    total_s: float  # s, the whole call: the three above and the verifications
    convex_steps: int  # before the very first solve
    first_iterations: int  # of the very first solve
    iterations: int  # of all solves
    rounds: int  # solves
    cost: float  # J of the paper, NaN where nothing was solved, as are the numbers below
    verified: bool
    fallback: bool  # the plan came from another guess than the method's
    clearance_m: float  # m, footprint to the nearest polygon
    duration_s: float  # s, of the plan
    disparity_position: float  # m, of the guess and the optimum, summed over the knots
    disparity_theta: float  # rad
    disparity_v: float  # m/s
    disparity_phi: float  # rad
    guess_blocked: float  # share of the knots at which the guess touches an obstacle
    guess_gap_m: float  # m, mean error of the kinematic model in the guess, from knot to knot
    status: str  # "verified", "unverified", "failed" or "crashed"
    reason: str  # why attempts were given up

    @property
    def key(self) -> tuple[str, str, str, int]:
        """What makes it this run and no other."""
        return self.scenario, self.kind, self.method, self.repeat

    @property
    def opt_s(self) -> float:
        """Build and solve [s]."""
        return self.build_s + self.solve_s


def run_of_plan(key: tuple[str, str, str, int], source: str, plan: Plan) -> Run:
    """The row of a plan that was asked for from a source of guesses."""
    solves = [attempt for attempt in plan.attempts if attempt.solver_status]
    check, nan = plan.verification, math.nan
    off = disparity(plan.guess, plan.trajectory)
    return Run(
        *key,
        guess_s=sum(attempt.guess_seconds for attempt in plan.attempts),
        build_s=sum(attempt.build_seconds for attempt in plan.attempts),
        solve_s=sum(attempt.solve_seconds for attempt in plan.attempts),
        total_s=plan.total_seconds,
        convex_steps=solves[0].convex_steps if solves else 0,
        first_iterations=solves[0].first_iterations if solves else 0,
        iterations=sum(attempt.iterations for attempt in solves),
        rounds=sum(1 + attempt.refinements for attempt in solves),
        cost=plan.cost.J if plan.cost else nan,
        verified=plan.verified,
        fallback=plan.guess_source != source,
        clearance_m=check.min_clearance_m if check else nan,
        duration_s=plan.trajectory.duration if plan.trajectory else nan,
        disparity_position=off.position,
        disparity_theta=off.theta,
        disparity_v=off.v,
        disparity_phi=off.phi,
        guess_blocked=blocked_share(plan.scenario, plan.guess),
        guess_gap_m=mean_gap(plan.scenario, plan.guess),
        status=plan.status,
        reason="; ".join(f"{attempt.guess}: {attempt.reason}" for attempt in plan.attempts if attempt.reason),
    )


def crashed_run(key: tuple[str, str, str, int], seconds: float, reason: str) -> Run:
    """The row of a run whose process ended; it is counted as if it had used `seconds` [s]."""
    nan = math.nan
    return Run(
        *key,
        guess_s=0.0,
        build_s=0.0,
        solve_s=seconds,
        total_s=seconds,
        convex_steps=0,
        first_iterations=0,
        iterations=0,
        rounds=0,
        cost=nan,
        verified=False,
        fallback=False,
        clearance_m=nan,
        duration_s=nan,
        disparity_position=nan,
        disparity_theta=nan,
        disparity_v=nan,
        disparity_phi=nan,
        guess_blocked=nan,
        guess_gap_m=nan,
        status="crashed",
        reason=reason,
    )
