"""The last steps to the quickest plan of its kind, where the horizon is free.

The solves that lead to a verified plan stop when the cost has settled to a thousandth over two iterations, and keep
0.1 m from obstacles where the guess does. Both are right for plans that are to be had soon, and both hold back one that
is to be quick: limited-memory BFGS creeps along limits, and gains a few per cent more over the next fifty iterations;
and what bounds a manoeuvre in time is mostly an obstacle in its way. So once there are verified plans, the solver goes
on from the quickest of them, with a stricter test and with no more clearance than every plan keeps: first with a
heavier weight on time, which leaves the slower of two ways to manoeuvre, then with the usual one, which smooths. What
that makes of a plan is taken only where it is verified and as quick.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

from drake_gnnocp.ocp.refine import Optimised, RefineOptions, optimise
from drake_gnnocp.scenario import Scenario

QUICKER = 0.995  # of the duration: a plan that saves less is where the free horizon is solved out
AS_QUICK = 1.001  # of the duration: a later plan may take that much longer, for it is the smoother one


@dataclass(frozen=True)
class PolishOptions:
    """How verified plans are made quicker."""

    candidates: int = 3  # plans, the quickest first
    reach: float = 1.2  # of the quickest plan's duration: slower ones have not overtaken it
    share: float = 0.5  # of the time that is left, for each of them at most
    hurry: tuple[float, ...] = (10.0, 1.0)  # of the usual weight on time, in each solve
    margin: float = 0.02  # m, clearance asked of the triangle areas
    objective_change: float = 1e-5  # relative, see `IpoptOptions`
    settled_iterations: int = 5
    max_iterations: int = 400


def polished(
    scenario: Scenario, plan: Optimised, free: RefineOptions, deadline: float, options: PolishOptions
) -> Optimised:
    """The plan, or a quicker one that is verified; the rounds that were tried are added to its own.

    Args:
        scenario: the task, near the origin.
        plan: verified.
        free: refinement with a free horizon.
        deadline: instant of `time.monotonic()` [s].
        options: see `PolishOptions`.
    """
    for hurry in options.hurry:
        if time.monotonic() >= deadline - free.reserve:
            break
        again = optimise(scenario, plan.trajectory, _patient(free, hurry, options), deadline)
        is_as_quick = again.trajectory.duration <= AS_QUICK * plan.trajectory.duration
        kept = again if again.verification.verified and is_as_quick else plan
        plan = replace(kept, rounds=plan.rounds + again.rounds)
    return plan


def worth_polishing(durations: Sequence[float], options: PolishOptions) -> list[int]:
    """Which plans to go on with, the quickest first; of plans that take equally long, which are mostly one, the first.

    Args:
        durations: of the plans [s].
        options: see `PolishOptions`.

    Returns:
        Indices into durations.
    """
    chosen: list[int] = []
    for i in sorted(range(len(durations)), key=lambda i: durations[i]):
        if not chosen or QUICKER * durations[i] > durations[chosen[-1]]:
            chosen.append(i)
    return [i for i in chosen if durations[i] <= options.reach * durations[chosen[0]]][: options.candidates]


def _patient(free: RefineOptions, hurry: float, options: PolishOptions) -> RefineOptions:
    weights = replace(free.problem.weights, time=hurry * free.problem.weights.time)
    problem = replace(free.problem, weights=weights, margin=min(options.margin, free.problem.margin))
    ipopt = replace(
        free.ipopt,
        objective_change=options.objective_change,
        settled_iterations=options.settled_iterations,
        max_iterations=options.max_iterations,
    )
    return replace(free, problem=problem, ipopt=ipopt)
