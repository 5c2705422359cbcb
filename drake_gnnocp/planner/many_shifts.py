"""Paths of many short moves, as into a slot little longer than the car: finer knots, and a solver that stays near.

The gentle timing of `retiming` averages the steering angle over a fixed share of the knots. Where the gears change
every few knots, that leaves a guess far from the path; v and phi peak between knots far apart, and the car's swept
hull bulges. Here the knots are as near in time as the moves are short, and the guess is the speed planner's own, which
is nearly a motion of the car: it steers from lock to lock while it stands at a gear change. The solver is kept near
it, so few rows are needed, and it is asked for no more clearance than the path has.

That takes fewer iterations on any path, and mostly one solve. But the timing stays near the limits, and the plan costs
up to half as much again: so it is for paths that need it, and for a second attempt.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from drake_gnnocp.ocp.refine import RefineOptions
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.search.path import GearedPath
from drake_gnnocp.timing.minimum_effort import with_duration
from drake_gnnocp.timing.speed_planner import SpeedOptions, plan_speed
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import Vehicle
from drake_gnnocp.verification import min_clearance


@dataclass(frozen=True)
class FineOptions:
    """When and how to plan finely."""

    sections: int = 8  # moves in one gear, from which on the usual knots are not even tried
    step: float = 0.3  # s, largest distance of the knots in time ...
    most_knots: int = 600  # ... as long as there are no more than these: the time of a solve grows with them
    tube: float = 0.15  # m, poses stay this near the guess's
    tube_heading: float = 0.1  # rad
    near: float = 0.6  # m, rows farther from their obstacle at the guess are left out
    limits_margin: float = 0.01  # relative: v and phi peak that much between such knots
    clearance_share: float = 0.5  # of the guess's clearance: no line or least margin asks for more
    least_gap: float = 0.005  # m, but for this


def fine_guess(
    path: GearedPath, vehicle: Vehicle, coarse: Trajectory, slack: float, speed: SpeedOptions, options: FineOptions
) -> Trajectory:
    """Time a path with knots near enough in time.

    Args:
        path: with many changes of gear.
        vehicle: its limits.
        coarse: the path with the usual knots: the fewest there will be.
        slack: duration over that of the speed planner.
        speed: of the speed planner.
        options: see `FineOptions`.
    """
    wanted = 1 + math.ceil(coarse.duration * slack / options.step)
    timed = plan_speed(path, vehicle, max(len(coarse), min(wanted, options.most_knots)), speed)
    return with_duration(timed, timed.duration * slack)


def fine_refine(scenario: Scenario, guess: Trajectory, refine: RefineOptions, options: FineOptions) -> RefineOptions:
    """Refinement that stays near a guess and asks for no more clearance than it has."""
    clearance = min_clearance(scenario, scenario.vehicle.footprints(guess.poses))
    gap = max(options.clearance_share * clearance, options.least_gap)
    problem = replace(
        refine.problem,
        tube=options.tube,
        tube_heading=options.tube_heading,
        near=options.near,
        least_margin=min(refine.problem.least_margin, gap),
        limits_margin=max(refine.problem.limits_margin, options.limits_margin),
    )
    convex = replace(refine.convex, most_steps=0)  # the guess is nearly a motion already, and steps would leave it
    threshold = min(refine.threshold, gap)
    return replace(refine, problem=problem, convex=convex, gap=min(refine.gap, gap), threshold=threshold)
