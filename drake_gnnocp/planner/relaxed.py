"""Ends that may vary: a plan that ends at the goal exactly is solved again with its last pose as a variable.

Guesses, SQP steps and the first solves go for the pose of the goal itself. What comes out of that is then made
cheaper within the goal's tolerance, and where its heading is free, in other headings. A plan is taken only where it is
verified and cheaper, so a tolerance makes none dearer. Where the goal itself is not reached, its surroundings may be.
"""

from __future__ import annotations

from drake_gnnocp.budget import Budget
from drake_gnnocp.ocp.costs import CostWeights, evaluate_cost
from drake_gnnocp.ocp.formulation import formulate
from drake_gnnocp.ocp.refine import Refined, refine
from drake_gnnocp.ocp.sqp import SEARCHED, sqp_steps
from drake_gnnocp.planner.options import PlanOptions
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.trajectory import Trajectory

CHEAPER = 0.99  # of the cost: a plan that saves less is where it is solved out
MOST_RELAXED = 4  # solves that follow a verified plan


def relaxed(scenario: Scenario, plan: Refined, options: PlanOptions, budget: Budget) -> Refined:
    """Solve a verified plan again with its end as a variable, as long as that makes it cheaper.

    Args:
        scenario: the task with one goal that leaves a choice, near the origin.
        plan: verified or not; one that is not is left as it is.
        options: see `PlanOptions`.
        budget: to stop at.
    """
    for _ in range(MOST_RELAXED):
        trajectory = plan.trajectory
        if trajectory is None or not plan.verified or budget.is_over:
            break
        formulation = formulate(scenario, trajectory, options.cost, options.margin, comfort=options.comfort)
        again = refine(scenario, formulation, budget, sqp_steps(formulation, SEARCHED, budget))
        before, after = (_cost(scenario, found, options.cost) for found in (trajectory, again.trajectory))
        is_taken = again.verified and after < before
        plan = plan.followed_by(again, is_taken)
        if not is_taken or after > CHEAPER * before:
            break
    return plan


def _cost(scenario: Scenario, trajectory: Trajectory | None, weights: CostWeights) -> float:
    return float("inf") if trajectory is None else evaluate_cost(trajectory, scenario, weights).J
