"""The quickest plan of its kind, where the duration is minimised.

A verified plan is solved again with the time step as a variable, as long as that makes it quicker: the rows follow the
knots, which slide along the path.

The solves that lead to a verified plan stop when the cost has settled to a thousandth over two iterations, and keep
0.1 m from obstacles where the guess does. Both are right for plans that are to be had soon, and both hold back one that
is to be quick: limited-memory BFGS creeps along limits, and gains a few per cent more over the next fifty iterations;
and what bounds a manoeuvre in time is mostly an obstacle in its way. So once there are verified plans, the solver goes
on from the quickest of them, with a stricter test and with no more clearance than every plan keeps: first with a
heavier weight on time, which leaves the slower of two ways to manoeuvre, then with the usual one, which smooths. What
that makes of a plan is taken only where it is verified and as quick.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from drake_gnnocp.budget import Budget
from drake_gnnocp.ocp.costs import CostWeights
from drake_gnnocp.ocp.formulation import formulate
from drake_gnnocp.ocp.ipopt import IpoptSettings
from drake_gnnocp.ocp.refine import Refined, refine
from drake_gnnocp.scenario import Scenario

QUICKER = 0.995  # of the duration: a plan that saves less is where it is solved out
AS_QUICK = 1.001  # of the duration: a later plan may take that much longer, for it is the smoother one
MOST_QUICKER = 4  # solves that follow a verified plan
CANDIDATES = 3  # plans that are polished, the quickest first
OVERTAKING = 1.2  # of the quickest plan's duration: slower ones have not overtaken it
HURRY = (10.0, 1.0)  # of the usual weight on time, in each solve of the polishing
MARGIN = 0.02  # m, clearance asked of the triangle areas then
PATIENT = IpoptSettings(objective_change=1e-5, settled_iterations=5)  # what settles at all took 143 iterations


def quicker(scenario: Scenario, plan: Refined, weights: CostWeights, margin: float, budget: Budget) -> Refined:
    """Solve a verified plan with the time step as a variable, again while that makes it quicker.

    Args:
        scenario: the task, near the origin.
        plan: verified or not; one that is not is left as it is.
        weights: of the cost.
        margin: clearance asked of obstacles at the knots [m].
        budget: to stop at.
    """
    for _ in range(MOST_QUICKER):
        trajectory = plan.trajectory
        if trajectory is None or not plan.verified or budget.is_over:
            break
        again = refine(scenario, formulate(scenario, trajectory, weights, margin, minimum_time=True), budget)
        is_quicker = again.trajectory is not None and again.trajectory.duration < QUICKER * trajectory.duration
        is_taken = is_quicker and again.verified
        plan = plan.followed_by(again, is_taken)
        if not is_taken:
            break
    return plan


def polished(scenario: Scenario, plan: Refined, weights: CostWeights, margin: float, budget: Budget) -> Refined:
    """A verified plan, or a quicker one that is verified; the solves that were tried are added to its own.

    Args:
        scenario: the task, near the origin.
        plan: verified.
        weights: of the cost.
        margin: clearance asked of obstacles at the knots [m].
        budget: to stop at.
    """
    for hurry in HURRY:
        trajectory = plan.trajectory
        if trajectory is None or budget.is_over:
            break
        hurried = replace(weights, time=hurry * weights.time)
        formulation = formulate(scenario, trajectory, hurried, min(MARGIN, margin), minimum_time=True)
        again = refine(scenario, formulation, budget, settings=PATIENT)
        is_as_quick = again.trajectory is not None and again.trajectory.duration <= AS_QUICK * trajectory.duration
        plan = plan.followed_by(again, is_as_quick and again.verified)
    return plan


def worth_polishing(durations: Sequence[float]) -> list[int]:
    """Which plans to go on with, the quickest first; of plans that take equally long, which are mostly one, the first.

    Args:
        durations: of the plans [s].

    Returns:
        Indices into durations.
    """
    chosen: list[int] = []
    for i in sorted(range(len(durations)), key=lambda i: durations[i]):
        if not chosen or QUICKER * durations[i] > durations[chosen[-1]]:
            chosen.append(i)
    return [i for i in chosen if durations[i] <= OVERTAKING * durations[chosen[0]]][:CANDIDATES]
