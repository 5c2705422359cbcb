"""Which obstacles come near the car, and in which interval: the pairs that need separating lines."""

from __future__ import annotations

import math

import numpy as np
import shapely

from drake_gnnocp.ocp.formulation import Formulation
from drake_gnnocp.ocp.separating_lines import best_normal
from drake_gnnocp.simulation import DrivenMotion
from drake_gnnocp.vehicle import State

Pair = tuple[int, int]  # interval, obstacle
LOOK_EVERY = 2  # samples of the driven motion: every 10 ms


def overlapping_pairs(formulation: Formulation) -> list[Pair]:
    """The pairs whose obstacle the reference touches between or at the knots of the interval."""
    footprints = formulation.vehicle.footprints(formulation.reference.poses)
    hulls = shapely.convex_hull(shapely.multipoints(np.concatenate([footprints[:-1], footprints[1:]], axis=1)))
    pairs = formulation.obstacles.tree.query(hulls, predicate="intersects")
    return sorted(set(zip(*pairs.tolist(), strict=True)))


def close_pairs(formulation: Formulation, motion: DrivenMotion) -> dict[Pair, float]:
    """Distance of the pairs whose obstacle the driven car passes nearer than it is to between knots.

    Args:
        formulation: around the knots of the motion; supplies the obstacles and the clearances.
        motion: of the car.

    Returns:
        The smallest distance in the interval [m]; where the car overlaps the obstacle, minus the penetration at the
        first sample that does.
    """
    corners = formulation.vehicle.footprints(motion.states[::LOOK_EVERY, : State.V])
    footprints, obstacles = shapely.polygons(corners), formulation.obstacles
    most = max(formulation.line_clearances.max(initial=0.0), formulation.demand.clearance)
    samples, which = obstacles.tree.query(footprints, predicate="dwithin", distance=most)
    found = shapely.distance(footprints[samples], obstacles.polygons[which])
    last = (len(motion.states) - 1) // motion.steps_per_interval - 1
    intervals = np.minimum(samples * LOOK_EVERY // motion.steps_per_interval, last)
    nearest: dict[Pair, tuple[float, int]] = {}
    for i in np.flatnonzero(found <= formulation.between(intervals, which)):
        pair = int(intervals[i]), int(which[i])
        nearest[pair] = min(nearest.get(pair, (math.inf, 0)), (float(found[i]), int(samples[i])))
    return {
        pair: distance if distance > 0 else best_normal(corners[sample], obstacles.ring(pair[1]))[2]
        for pair, (distance, sample) in nearest.items()
    }
