"""The clearance of a moving car from exact polygons: at poses, and proven for all times in between.

Between two instants T apart no point of the car is farther than the bulge, T^2 / 8 times its largest acceleration, from
the chord of its path. With the clearances c_1 and c_2 at the instants and the longest chord d of a corner, the
clearance in between is at least (c_1 + c_2 - d) / 2 less the bulge. It is also at least the distance of the convex hull
of both footprints less the bulge, which is tighter and takes more to compute. Where neither is near enough to the
clearance at the instants, the time is cut into parts.
"""

from __future__ import annotations

import math

import numpy as np
import shapely

from drake_gnnocp.scenario import Scenario
from drake_gnnocp.vehicle import State
from drake_gnnocp.verification.motion import Motion

LOOK_EVERY = 16  # footprints, whose clearance tells which of the others can have less
FIRST, FINEST = 0.3, 1e-5  # s, stretches of time at first, and those that are not cut any more
PARTS = 4  # that a stretch is cut into
TIGHT = 1e-3  # m: a proven clearance is that near to the one at an instant


def proven_clearance(scenario: Scenario, motion: Motion) -> tuple[float, float]:
    """A lower bound of the clearance at all times, and the least clearance at the instants that were looked at [m].

    Args:
        scenario: supplies the exact polygons and the vehicle.
        motion: of the car.

    Returns:
        Both infinite without obstacles, 0 in a collision; the first may be negative where nothing is proven.
    """
    if not scenario.polygons:
        return math.inf, math.inf
    tree, end = shapely.STRtree(scenario.polygons), float(motion.t[-1])
    times = np.linspace(0.0, end, 1 + max(1, math.ceil(end / FIRST)))[None]  # (S, C): stretches of time, cut
    least, proven = math.inf, math.inf
    while times.size and least > 0:
        footprints = scenario.vehicle.footprints(motion.poses_at(times.ravel()))
        found = _distances(tree, shapely.polygons(footprints)).reshape(times.shape)
        least = min(least, float(found.min()))
        pairs = footprints.reshape(*times.shape, 4, 2)
        pairs = np.stack([pairs[:, :-1], pairs[:, 1:]], axis=2).reshape(-1, 2, 4, 2)
        ends = np.stack([times[:, :-1].ravel(), times[:, 1:].ravel()], axis=1)
        lost = _lost(motion, ends)
        chord = np.sqrt(((pairs[:, 1] - pairs[:, 0]) ** 2).sum(axis=2).max(axis=1))
        bound = ((found[:, :-1] + found[:, 1:]).ravel() - chord) / 2 - lost
        wanted = least - min(TIGHT, least / 2)
        near = np.flatnonzero(bound < wanted)
        hulls = shapely.convex_hull(shapely.multipoints(pairs[near].reshape(-1, 8, 2)))
        bound[near] = np.maximum(bound[near], _distances(tree, hulls) - lost[near])
        is_open = (bound < wanted) & (ends[:, 1] - ends[:, 0] > FINEST)
        proven = min(proven, float(bound[~is_open].min(initial=math.inf)))
        times = ends[is_open, :1] + (ends[is_open, 1:] - ends[is_open, :1]) * np.linspace(0.0, 1.0, PARTS + 1)
    return (proven, least) if least > 0 else (0.0, 0.0)


def proven_inside(scenario: Scenario, motion: Motion) -> tuple[float, float]:
    """How far inside the bounds the car is proven to be at all times, and is at the samples; infinite without [m]."""
    if scenario.bounds is None:
        return math.inf, math.inf
    xmin, xmax, ymin, ymax = scenario.bounds
    footprints = scenario.vehicle.footprints(motion.states[:, : State.V])
    (left, low), (right, high) = footprints.min(axis=1).T, footprints.max(axis=1).T
    inside = np.minimum(np.minimum(left - xmin, xmax - right), np.minimum(low - ymin, ymax - high))
    lost = _lost(motion, np.stack([motion.t[:-1], motion.t[1:]], axis=1))
    return float((np.minimum(inside[:-1], inside[1:]) - lost).min()), float(inside.min())


def _lost(motion: Motion, ends: np.ndarray) -> np.ndarray:
    """How far any point of the car may be from the chord of its path in stretches of time (S, 2) [s]: (S,) [m]."""
    first, last = motion.step_at(ends[:, 0]), motion.step_at(ends[:, 1]) + 1
    bends = np.append(motion.bends, 0.0)  # reduceat wants every index to be one
    bend = np.maximum.reduceat(bends, np.stack([first, last], axis=1).ravel())[::2]
    return np.diff(ends, axis=1)[:, 0] ** 2 / 8 * bend + motion.errors[last]


def _distances(tree: shapely.STRtree, shapes: np.ndarray) -> np.ndarray:
    return np.asarray(tree.query_nearest(shapes, return_distance=True, all_matches=False)[1])


def min_clearance(scenario: Scenario, footprints: np.ndarray) -> float:
    """Smallest distance of the footprints (N, 4, 2) to the exact polygons [m]; inf without obstacles.

    A footprint is no nearer to an obstacle than another one less the way of the corner that moves most in between: so
    of a motion few need to be looked at.
    """
    if not scenario.polygons:
        return math.inf
    tree = shapely.STRtree(scenario.polygons)

    def distances(which: np.ndarray) -> np.ndarray:
        return tree.query_nearest(shapely.polygons(footprints[which]), return_distance=True, all_matches=False)[1]

    looked_at = np.unique(np.append(np.arange(0, len(footprints), LOOK_EVERY), len(footprints) - 1))
    found = distances(looked_at)
    way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(footprints, axis=0), axis=2).max(axis=1, initial=0.0)))
    after = np.searchsorted(looked_at, np.arange(len(footprints)))
    before = np.maximum(after - 1, 0)
    least = np.maximum(
        found[before] - np.abs(way - way[looked_at[before]]), found[after] - np.abs(way[looked_at[after]] - way)
    )
    rest = np.flatnonzero(least < found.min())
    return float(min(found.min(), distances(rest).min(initial=math.inf)))
