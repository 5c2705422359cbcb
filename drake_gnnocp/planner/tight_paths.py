"""Searched paths with hardly any room beside the car: finer knots, and a solver that stays near.

Minimum-effort timing averages the steering angle over a fixed share of the knots, which leaves a guess beside the path:
where a few centimetres are free, inside of obstacles, and of a path whose gears change every few knots, far from it.
Here the knots are as near in time as the moves are short, and the guess is the speed planner's own, which is nearly a
motion of the car: it steers from lock to lock while it stands at a gear change. A small trust region keeps the solver
near it, so few rows are needed, and it is asked for no more clearance than the path has.

That takes fewer iterations on any path, and mostly one solve. But the timing stays near the limits, and where there is
room the plan costs up to twice as much: so it is for tight paths, and for a second attempt on others.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from drake_gnnocp.guesses import Guess
from drake_gnnocp.ocp.formulation import Formulation
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.search.path import GearedPath
from drake_gnnocp.timing.minimum_effort import with_duration
from drake_gnnocp.timing.speed_planner import plan_speed
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import Vehicle
from drake_gnnocp.verification import min_clearance

TIGHT = 0.07  # m, clearance of a path: with less, the usual knots are not even tried
STEP = 0.2  # s, largest distance of the knots in time ...
MOST_KNOTS = 600  # ... as long as there are no more than these: the time of a solve grows with them
TRUST_REGION = (0.3, 0.3, 0.2)  # m, m, rad
ROWS_WITHIN = 0.6  # m, little moves any more
LIMITS_MARGIN = 0.01  # relative: v and phi peak that much between such knots
CLEARANCE_SHARE = 0.3  # of the guess's clearance: no line or least margin asks for more
LEAST_CLEARANCE = 0.002  # m, but for this


def is_tight(scenario: Scenario, guess: Guess) -> bool:
    """Whether the path of a guess, where it has one, comes very near to an obstacle."""
    if guess.path is None:
        return False
    return min_clearance(scenario, scenario.vehicle.footprints(guess.path.poses)) < TIGHT


def timed(path: GearedPath, vehicle: Vehicle, coarse: Trajectory, slack: float) -> Trajectory:
    """Put a time to a path with knots near enough in time.

    Args:
        path: with many changes of gear.
        vehicle: its limits.
        coarse: the path with the usual knots: the fewest there will be.
        slack: duration over that of the speed planner.
    """
    wanted = 1 + math.ceil(coarse.duration * slack / STEP)
    fine = plan_speed(path, vehicle, max(len(coarse), min(wanted, MOST_KNOTS)))
    return with_duration(fine, fine.duration * slack)


def kept_near(scenario: Scenario, formulation: Formulation) -> Formulation:
    """The formulation with a small trust region, that asks for no more clearance than its reference has."""
    clearance = min_clearance(scenario, scenario.vehicle.footprints(formulation.reference.poses))
    allowed = max(CLEARANCE_SHARE * clearance, LEAST_CLEARANCE)
    return replace(
        formulation,
        trust_region=TRUST_REGION,
        rows_within=ROWS_WITHIN,
        least_margins=np.minimum(formulation.least_margins, allowed),
        limits_margin=LIMITS_MARGIN,
        comfort=0.0,
        line_clearances=np.minimum(formulation.line_clearances, allowed),
    )
