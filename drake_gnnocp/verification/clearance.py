"""The clearance of a moving car from exact polygons and bounds: at poses, and proven for all times in between.

Between two instants T apart no point of the car is farther than the bulge, T^2 / 8 times its largest acceleration, from
the chord of its path. With the clearances c_1 and c_2 at the instants and the longest chord d of a corner, the
clearance in between is at least (c_1 + c_2 - d) / 2 less the bulge. It is also at least the distance of the convex hull
of both footprints less the bulge, which is tighter and takes more to compute. How far the car is inside a box is at
least the smaller of what it is at the instants, less the bulge. Where that does not do, the time is cut into parts.

A car that is outside of all polygons at its start gets into none without touching an outline: outlines are all that is
looked at, which is quick for large polygons as well. Likewise it leaves no fence without touching it.

What a scenario asks for holds at all times, except that near the start and the goal no more is asked than what the car
has there, to obstacles and bounds. The zone of an end is a disc: a stretch of time is inside when both its instants
are, further than the bulge. A stretch that is not is asked for the larger demand. The car at the goal is the car at the
pose that is given, whatever the tolerance; where the heading is free, it is the car in the heading that leaves most.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import shapely

from drake_gnnocp.ends import COORDINATE_TOLERANCE, Target, poses_around
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.verification.motion import Motion

LOOK_EVERY = 16  # footprints, whose clearance tells which of the others can have less
FIRST, FINEST = 0.5, 1e-5  # s, stretches of time at first, and those that are not cut any more
CUTS = np.linspace(0.0, 1.0, 7)  # where a stretch is cut into parts
LOOKS = 64  # instants that the first fault is looked for at, twice
TIGHT = 1e-3  # m: a proven clearance is that near to the one at an instant, and one that is asked for
OVER = 1e-5  # m: a box is proven to be kept but for that
CROSSED = -2 * COORDINATE_TOLERANCE  # m, how far a car that touches a fence is said to be inside of it


@dataclass
class Least:
    """The least of a distance over all times [m]: seen at an instant, and proven for all; infinite where nothing is."""

    place: tuple[float, float, float]  # t, x, y, when and where it was seen, or first seen to be too little [s, m, m]
    seen: float = math.inf
    proven: float = math.inf

    def prove(self, bounds: np.ndarray) -> None:
        """Take lower bounds (S,) of stretches of time into account."""
        self.proven = min(self.proven, float(bounds.min(initial=math.inf)))


@dataclass
class Clearances:
    """What a car keeps to the things around it at all times."""

    obstacles: Least
    bounds: Least  # negative outside
    beyond_demand: Least  # the smaller of both, beyond what is asked for; infinite where nothing is
    asked: float  # m, the clearance that is asked for where that is the least
    over: float  # m, that the bounds may be left by: a box but for rounding, a fence not at all


class Look(NamedTuple):
    """A car at N instants."""

    times: np.ndarray  # (N,) s
    poses: np.ndarray  # (N, 3)
    footprints: np.ndarray  # (N, 4, 2)
    margins: np.ndarray  # (3, N) the distances of `Clearances` [m]


class Surroundings:
    """The exact outlines and the bounds of a scenario, and the clearance to them that is asked for."""

    def __init__(self, scenario: Scenario, goal: Target | None = None) -> None:
        goal = goal or scenario.targets[0]
        self.vehicle = scenario.vehicle
        self.outlines, self.fence = scenario.shapes.outlines, scenario.shapes.fence_line
        self.low, self.high = np.reshape(scenario.box or (-math.inf, math.inf) * 2, (2, 2)).T
        self.ends, self.asked = np.stack([scenario.start, goal.pose])[:, :2], scenario.clearance
        if self.asked > 0:
            at_goal = poses_around(goal.pose[:2]) if goal.is_free else goal.pose
            room = (np.minimum(*self.distances(self.vehicle.footprints(poses))) for poses in (scenario.start, at_goal))
            self.asked_at_ends = np.minimum([float(found.max()) for found in room], self.asked)

    def to_obstacles(self, shapes: np.ndarray) -> np.ndarray:
        """Distances of shapes (N,) to the nearest outline: (N,) [m]."""
        if self.outlines.is_empty:
            return np.full(len(shapes), math.inf)
        return np.asarray(shapely.distance(self.outlines, shapes))

    def distances(self, footprints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """How far footprints (N, 4, 2) are from the obstacles and inside the bounds: (N,) each [m]."""
        cars = shapely.polygons(footprints)
        if self.fence is not None:
            away = shapely.distance(self.fence, cars)
            return self.to_obstacles(cars), np.where(away > 0, away, CROSSED)
        low, high = footprints.min(axis=1) - self.low, self.high - footprints.max(axis=1)
        return self.to_obstacles(cars), np.minimum(low, high).min(axis=1)

    def demand(self, axles: np.ndarray, spread: np.ndarray | float = 0.0) -> np.ndarray:
        """The most that is asked for while the rear axle's middle is within a spread of a chord.

        Args:
            axles: (N, P, 2) ends of the chord [m].
            spread: (N,) [m].

        Returns:
            (N,) [m], minus infinity where nothing is asked for.
        """
        if self.asked == 0:
            return np.full(len(axles), -math.inf)
        away = np.linalg.norm(axles[:, :, None] - self.ends, axis=3).max(axis=1)  # (N, 2); a disc is convex
        is_near = away + np.reshape(spread, (-1, 1)) <= self.vehicle.length
        return np.where(is_near, self.asked_at_ends, self.asked).min(axis=1)

    def look(self, motion: Motion, times: np.ndarray) -> Look:
        """The car at times (N,) of a motion."""
        poses = motion.poses_at(times)
        footprints = self.vehicle.footprints(poses)
        free, inside = self.distances(footprints)
        beyond = np.minimum(free, inside) - self.demand(poses[:, None, :2])
        return Look(times, poses, footprints, np.stack([free, inside, beyond]))

    def nearest_point(self, pose: np.ndarray, which: int) -> np.ndarray:
        """The point (2,) of the car at a pose (3,) that has the least of one of the three distances of `Clearances`."""
        footprint = self.vehicle.footprints(pose)[0]
        free, inside = self.distances(footprint[None])
        nearest = self.outlines
        if which == 1 or (which == 2 and inside < free):
            if self.fence is None:
                return footprint[np.minimum(footprint - self.low, self.high - footprint).min(axis=1).argmin()]
            nearest = self.fence
        return np.asarray(shapely.shortest_line(shapely.Polygon(footprint), nearest).coords)[0]


def proven_clearances(scenario: Scenario, motion: Motion, goal: Target | None = None) -> Clearances:
    """The least clearances at all times.

    Args:
        scenario: supplies the exact polygons, the bounds, the vehicle and the clearance that is asked for.
        motion: of the car.
        goal: that the motion ends at; None: the first.

    Returns:
        What is proven may be negative where nothing is.
    """
    around = Surroundings(scenario, goal)
    begin, end = motion.t[[0, -1]]
    times = np.linspace(begin, end, 1 + max(1, math.ceil((end - begin) / FIRST)))[None]  # (S, C): stretches, cut
    least, proven, at = np.full(3, math.inf), np.full(3, math.inf), np.full(3, begin)
    while times.size:
        seen = around.look(motion, times.ravel())
        lowest = seen.margins.argmin(axis=1)
        found = seen.margins[range(3), lowest]
        at, least = np.where(found < least, seen.times[lowest], at), np.minimum(found, least)
        # what the bounds of a part have to be for it to be left alone
        of_bounds = -OVER if around.fence is None else least[1] - min(TIGHT, least[1] / 2)
        wanted = np.where(_refused(least), -math.inf, [least[0] - min(TIGHT, least[0] / 2), of_bounds, -TIGHT])
        first = np.arange(times.size).reshape(times.shape)[:, :-1].ravel()
        bounds = _bounds(around, motion, seen, first, wanted)
        begins, spans = seen.times[first], seen.times[first + 1] - seen.times[first]
        is_open = (bounds < wanted[:, None]).any(axis=0) & (spans > FINEST)
        proven = np.minimum(proven, bounds[:, ~is_open].min(axis=1, initial=math.inf))
        times = begins[is_open, None] + spans[is_open, None] * CUTS
    return _with_places(around, motion, least, at, proven)


def _bounds(around: Surroundings, motion: Motion, seen: Look, first: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Lower bounds of the three distances from instants to the next ones: (3, P) [m].

    Args:
        around: what is around the car.
        motion: of the car.
        seen: the car at the instants.
        first: (P,) the instants that the parts begin with.
        wanted: (3,) bounds that are good enough.
    """
    last = first + 1
    lost = _lost(motion, seen.times[first], seen.times[last])
    swept = np.concatenate([seen.footprints[first], seen.footprints[last]], axis=1)  # (P, 8, 2)
    chord = np.sqrt(((swept[:, 4:] - swept[:, :4]) ** 2).sum(axis=2).max(axis=1))
    free = (seen.margins[0, first] + seen.margins[0, last] - chord) / 2 - lost
    if around.fence is None:
        inside = np.minimum(seen.margins[1, first], seen.margins[1, last]) - lost
    else:
        inside = (seen.margins[1, first] + seen.margins[1, last] - chord) / 2 - lost
    demand = around.demand(seen.poses[np.stack([first, last], axis=1), :2], lost)
    near = np.flatnonzero((free < wanted[0]) | (np.minimum(free, inside) - demand < wanted[2]) | (inside < wanted[1]))
    if around.fence is None:
        near = near[(free < wanted[0])[near] | (free - demand < wanted[2])[near]]
    hulls = shapely.convex_hull(shapely.linestrings(swept[near]))
    free[near] = np.maximum(free[near], around.to_obstacles(hulls) - lost[near])
    if around.fence is not None:
        inside[near] = np.maximum(inside[near], shapely.distance(around.fence, hulls) - lost[near])
    return np.stack([free, inside, np.minimum(free, inside) - demand])


def _refused(margins: np.ndarray) -> np.ndarray:
    """Whether the distances (3, ...) at an instant are faults."""
    return np.stack([margins[0] <= 0, margins[1] < -COORDINATE_TOLERANCE, margins[2] < -TIGHT])


def _with_places(
    around: Surroundings, motion: Motion, seen: np.ndarray, at: np.ndarray, proven: np.ndarray
) -> Clearances:
    worst = motion.poses_at(at)
    asked = max(0.0, float(around.demand(worst[2:, None, :2])[0]))
    found = []
    for i, (pose, is_refused) in enumerate(zip(worst, _refused(seen), strict=True)):
        if is_refused:
            at[i] = _first_refused(around, motion, i, at[i])
            pose = motion.poses_at(at[i : i + 1])[0]
        point = around.nearest_point(pose, i) if math.isfinite(seen[i]) else pose[:2]
        found.append(Least((float(at[i]), *point.tolist()), float(seen[i]), float(proven[i])))
    obstacles, bounds, beyond_demand = found
    return Clearances(obstacles, bounds, beyond_demand, asked, OVER if around.fence is None else 0.0)


def _first_refused(around: Surroundings, motion: Motion, which: int, t: float) -> float:
    """When a distance that is refused at a time first is, as finely as is looked at."""
    times = np.linspace(motion.t[0], t, LOOKS)
    for _ in range(2):
        first = int(_refused(around.look(motion, times).margins)[which].argmax())
        times = np.linspace(times[max(first - 1, 0)], times[first], LOOKS)
    return float(times[-1])


def _lost(motion: Motion, begins: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """How far any point of the car may be from the chord of its path between times (P,) and (P,) [s]: (P,) [m]."""
    inner = motion.times[1:-1]
    intervals = np.empty((len(begins), 2), dtype=int)  # between knots: the first, and the one after the last
    intervals[:, 0] = inner.searchsorted(begins, side="right")
    intervals[:, 1] = inner.searchsorted(ends, side="left") + 1
    bends = np.append(motion.bends, 0.0)  # reduceat wants every index to be one
    bend = np.maximum.reduceat(bends, intervals.ravel())[::2]
    return (ends - begins) ** 2 / 8 * bend + motion.errors[intervals[:, 1]]


def min_clearance(scenario: Scenario, footprints: np.ndarray) -> float:
    """Smallest distance of the footprints (N, 4, 2) to the exact polygons [m]; inf without obstacles.

    A footprint is no nearer to an obstacle than another one less the way of the corner that moves most in between: so
    of a motion few need to be looked at.
    """
    if not len(scenario.shapes.all):
        return math.inf
    tree = shapely.STRtree(scenario.shapes.all)

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
