"""More clearance for a verified plan, as far as the place leaves it.

What is wanted is asked of SQP steps, in which it is soft: where they end, every knot has what can be had there. Ipopt
is asked for that, and for lines where an obstacle comes nearer between two knots than at them.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import shapely

from drake_gnnocp.budget import Budget
from drake_gnnocp.ocp.answers import to_finish, with_lines
from drake_gnnocp.ocp.close_pairs import Pair, close_pairs
from drake_gnnocp.ocp.formulation import Formulation
from drake_gnnocp.ocp.sqp import SqpSettings, sqp_steps
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.simulation import drive
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.verification.clearance import TIGHT

STEPS = SqpSettings(proximal=1.0, most_steps=12)  # towards it
RESERVE = 1e-3  # m, of the clearance that the steps led to: what Ipopt need not keep
SAG = 0.01  # m, that an obstacle is nearer between knots than at them where it gets a line for that

Close = dict[Pair, float]  # distances of close pairs [m]


def close_around(scenario: Scenario, formulation: Formulation, found: Trajectory) -> tuple[Formulation, Close]:
    """The formulation around a trajectory, and the pairs with less clearance there than it asks for."""
    around = replace(formulation, reference=found)
    return around, close_pairs(around, drive(scenario.start, found, scenario.vehicle))


def shortfall(around: Formulation, close: Close) -> float:
    """How much close pairs lack of the clearance that a formulation asks for at worst, 0 where there are none [m]."""
    pairs = np.array(list(close), dtype=int).reshape(-1, 2)
    lacking = around.between(*pairs.T) - np.fromiter(close.values(), float)
    return float(lacking.max(initial=0.0, where=lacking > TIGHT))


def with_more_clearance(
    scenario: Scenario, before: Formulation, asked: Formulation, there: Close, budget: Budget
) -> Formulation | None:
    """A formulation that asks for more clearance than a plan has, but for no more than SQP steps found possible.

    Args:
        scenario: the task.
        before: what the plan is of.
        asked: the answer to the plan, with the clearance that is wanted.
        there: the pairs that lack it in the plan.
        budget: when it is over, no step begins.

    Returns:
        None where the steps led to nothing.
    """
    found = sqp_steps(asked, STEPS, budget).trajectory
    if found is asked.reference:
        return None
    near = to_finish(asked, found)
    cars, obstacles = np.asarray(shapely.polygons(scenario.vehicle.footprints(found.poses))), near.obstacles
    knots, which = obstacles.tree.query(cars, predicate="dwithin", distance=near.demand.clearance)
    has = np.full(len(found), np.inf)
    np.minimum.at(has, knots, shapely.distance(cars[knots], obstacles.polygons[which]) - RESERVE)
    most = np.maximum(has, before.demand.at(found.poses))
    _, close = close_around(scenario, near, found)
    missed = _missed_at_knots(asked, there) | _missed_at_knots(near, close)
    lines = tuple(line for line in before.lines if (line.interval, line.obstacle) not in missed)
    near = replace(near, demand=replace(near.demand, most=most), lines=lines)
    return with_lines(near, dict.fromkeys(missed, math.inf))


def _missed_at_knots(formulation: Formulation, close: Close) -> set[Pair]:
    """The close pairs whose obstacle is nearer somewhere in the interval than at both its knots, and their neighbours.

    Rows at the knots miss them, and knots slide along the path.
    """
    if not close:
        return set()
    pairs, distances = np.array(list(close)), np.fromiter(close.values(), float)
    cars = np.asarray(shapely.polygons(formulation.vehicle.footprints(formulation.reference.poses)))
    obstacles = formulation.obstacles.polygons[pairs[:, 1]]
    at_knots = np.minimum(*(shapely.distance(cars[pairs[:, 0] + i], obstacles) for i in (0, 1)))
    last = len(formulation.reference) - 2
    return {
        (i, j)
        for interval, j in pairs[distances < at_knots - SAG].tolist()
        for i in range(max(interval - 1, 0), min(interval + 1, last) + 1)
    }
