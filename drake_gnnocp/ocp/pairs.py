"""Which obstacles come near the car, and in which interval: the pairs that need separating lines."""

from __future__ import annotations

import math

import numpy as np
import shapely

from drake_gnnocp.ocp.separating_line import best_normal
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.simulation import CHECK_STEP, drive
from drake_gnnocp.trajectory import Trajectory

Pair = tuple[int, int]  # interval, convex obstacle


def overlapping_pairs(scenario: Scenario, guess: Trajectory) -> list[Pair]:
    """(interval, convex obstacle) pairs whose obstacle the guess touches between or at the knots."""
    footprints = scenario.vehicle.footprints(guess.poses)
    hulls = shapely.convex_hull(shapely.multipoints(np.concatenate([footprints[:-1], footprints[1:]], axis=1)))
    return sorted(set(zip(*_pairs_within(scenario, hulls, 0.0), strict=True)))


def _pairs_within(scenario: Scenario, shapes: np.ndarray, distance: float) -> tuple[list[int], list[int]]:
    """Indices (shapes, convex obstacles) of the pairs within a distance [m]."""
    if not scenario.convex_obstacles:
        return [], []
    tree = shapely.STRtree(scenario.convex_polygons)
    which, obstacle = tree.query(shapes, predicate="dwithin", distance=distance)
    return which.tolist(), obstacle.tolist()


def close_pairs(scenario: Scenario, trajectory: Trajectory, threshold: float) -> dict[Pair, float]:
    """Distance of every (interval, convex obstacle) that the driven car passes nearer than the threshold [m].

    Overlaps count as negative distances.
    """
    motion = drive(scenario.start, trajectory, scenario.vehicle)
    corners = scenario.vehicle.footprints(motion.states[::CHECK_STEP, :3])
    footprints = shapely.polygons(corners)
    samples, obstacles = _pairs_within(scenario, footprints, threshold)
    intervals = np.minimum(np.array(samples) * CHECK_STEP // motion.steps_per_interval, len(trajectory) - 2)
    nearest: dict[Pair, tuple[float, int]] = {}
    for sample, k, j in zip(samples, intervals.tolist(), obstacles, strict=True):
        distance = float(shapely.distance(footprints[sample], scenario.convex_polygons[j]))
        nearest[k, j] = min(nearest.get((k, j), (math.inf, 0)), (distance, sample))
    return {
        (k, j): distance if distance > 0 else best_normal(corners[sample], scenario.convex_obstacles[j])[2]
        for (k, j), (distance, sample) in nearest.items()
    }
