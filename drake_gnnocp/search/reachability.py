r"""A proof that there is no path, where a car that may move in any direction could not get from start to goal either.

Let c be the middle of the car's footprint and K a convex body that is symmetric to c and inside the footprint at all
headings of some interval. With obstacles O and bounds B, c is then always in the free space

    F(K) = { p : p + K within B, (p + K) and O disjoint } = (B eroded by K) minus (O (+) K),

(+) being the Minkowski sum (Lozano-Perez 1983). A motion of the car is a curve of c that never leaves F(K). So there is
no path if start and goal are in different connected components. Two families of bodies are looked at:

- the disc of radius r = min(width, length) / 2, which is inside the footprint at all headings;
- for N equal intervals of headings, each of half width d, the footprint's rectangle at three headings (the middle of
  the interval and both ends), intersected and made smaller by cos(d / 2): a supporting line at a heading between two of
  these is no nearer to c than that. A component in one interval is joined to those that it meets in the next one.

Everything errs to the free side: arcs are inscribed polygons, bodies are smaller by more than a verified plan may leave
the bounds by, ends are met within more than it may miss them by. Therefore what is separated here is separated.
A goal with a tolerance is met within as much more; where its heading is free, at all headings, by whatever is as near
the rear axle as c is.

Components may also be joined without there being a path: then nothing is said.

The widest way, by bisection over smaller discs, tells how wide the passage is that is too narrow, and where.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import shapely
from shapely import affinity

from drake_gnnocp.convex import convex_parts
from drake_gnnocp.scenario import Scenario

HAIR = 0.002  # m, bodies are smaller by this: twice what a verified plan may leave the bounds by
POSITION_SLACK = 0.015  # m, more than a verified plan may end beside the goal
HEADING_SLACK = math.radians(1.1)  # rad, likewise
ARC_SEGMENTS = 12  # of a quarter of a circle
# numbers of intervals of headings that are looked at in turn, and the most vertices of convex parts near the way with
# which they are: half a second at most
INTERVALS = {32: 3000, 128: 200}
MOST_CORNERS = 2000  # of all obstacles: with more, they are made simpler by the next, and no passage is measured
SIMPLER = 0.03  # of the disc's radius: outlines move by no more, and what they are grown by is less by as much
SMALLEST_SHARE = 0.02  # of the disc's radius: a passage narrower than this is none
HALVINGS = 9  # of the radius: the width is known to 4 mm


@dataclass(frozen=True)
class NoPath:
    """Why there is no path."""

    why: str  # with "{place}", "{width}" and "{length}" where they are to be said
    proven: bool  # whether no car of this shape could do it; otherwise the search has found none
    place: tuple[float, float] | None = None  # x, y of where it is blocked [m]
    width: float | None = None  # m, of the passage there
    length: float = 0.0  # m, another one that `why` tells

    @property
    def text(self) -> str:
        """Why there is no path, for people."""
        place = "" if self.place is None else "({:.1f}, {:.1f})".format(*self.place)
        return self.why.format(place=place, width=f"{self.width or 0.0:.2f} m", length=f"{self.length:.2f} m")

    def to_dict(self) -> dict[str, Any]:
        """The content of result.json."""
        near = None if self.place is None else list(self.place)
        return {"proven": self.proven, "reason": self.text, "near": near, "passage_width_m": self.width}

    def placed(self, dx: float, dy: float, unit: float) -> NoPath:
        """The same in metres, of the task moved by (dx, dy) [m]; lengths are in a unit [m]."""
        place = self.place and (unit * self.place[0] + dx, unit * self.place[1] + dy)
        width = None if self.width is None else unit * self.width
        return replace(self, place=place, width=width, length=unit * self.length)


def no_path(scenario: Scenario) -> NoPath | None:
    """Prove that there is no path; None where that cannot be proven. The scenario should be near the origin."""
    task = _Task(scenario)
    if not len(task.ways):
        return _too_narrow(task)
    near = task.polygons_near(shapely.union_all(task.ways))
    if shapely.get_num_coordinates(near).sum() > 2 * max(INTERVALS.values()):
        return None
    rings = [ring for polygon in near for ring in convex_parts(polygon)]
    vertices = sum(map(len, rings))
    looked_at = (_no_way_in_headings(task, rings, n) for n, most in INTERVALS.items() if vertices <= most)
    return next((proof for proof in looked_at if proof is not None), None)


def no_passage(scenario: Scenario) -> NoPath | None:
    """What the disc alone proves of `no_path`, which takes a millisecond; None where there are too many corners."""
    task = _Task(scenario)
    return None if task.has_many_corners or len(task.ways) else _too_narrow(task)


def has_many_corners(scenario: Scenario) -> bool:
    """Whether proofs take long."""
    return bool(shapely.get_num_coordinates(scenario.polygons).sum() > MOST_CORNERS)


class _Task:
    """A scenario as the proof sees it."""

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        vehicle = scenario.vehicle
        ahead = 0.5 * vehicle.length - vehicle.rear_hang  # of the footprint's middle before the rear axle
        ends = np.stack([scenario.start, scenario.goal])
        self.headings = ends[:, 2]
        self.middles = ends[:, :2] + ahead * np.column_stack([np.cos(self.headings), np.sin(self.headings)])
        target, slack = scenario.targets[0], POSITION_SLACK + abs(ahead) * HEADING_SLACK
        x, y, turn = target.half_sizes.tolist()
        if target.is_free:
            self.middles[1] = ends[1, :2]
        allowed = math.hypot(x, y) + abs(ahead) * (1.0 if target.is_free else min(turn, 2.0))
        self.allowed = np.array([0.0, allowed])  # m, of both ends: what a tolerance grants
        self.slack = slack + self.allowed  # m, within which the ends are met
        self.turns = HEADING_SLACK + np.array([0.0, turn])  # rad, likewise
        self.reach = 0.5 * math.hypot(vehicle.length, vehicle.width)
        half_length, half_width = 0.5 * vehicle.length - HAIR, 0.5 * vehicle.width - HAIR
        self.radius = max(min(half_length, half_width), 0.0)  # m, of the disc in the footprint
        self._half_length, self._half_width = max(half_length, 0.0), max(half_width, 0.0)

    @cached_property
    def obstacles(self) -> shapely.Geometry:
        """All of them, touching ones made one; within `_simpler` of their outlines."""
        return shapely.simplify(shapely.union_all(self._scenario.blocked_exactly), self._simpler)

    @cached_property
    def has_many_corners(self) -> bool:
        """Whether a disc's free space takes so long that it should be made only once."""
        return has_many_corners(self._scenario)

    @property
    def _simpler(self) -> float:
        return SIMPLER * self.radius if self.has_many_corners else 0.0

    @cached_property
    def ways(self) -> np.ndarray:
        """The components of the disc's free space that hold both ends."""
        free = self.free_of_disc(self.radius)
        start, goal = (_at(free, *end) for end in zip(self.middles, self.slack, strict=True))
        return free[sorted(set(start) & set(goal))]

    def free_of_disc(self, radius: float) -> np.ndarray:
        """The connected components of the free space of a disc [m], polygons."""
        grown = shapely.buffer(self.obstacles, max(radius - self._simpler, 0.0), quad_segs=ARC_SEGMENTS)
        return _components(self._room(radius, radius), grown)

    def polygons_near(self, region: shapely.Geometry) -> np.ndarray:
        """What the car could touch with its middle in a region: polygons (B,)."""
        polygons = self._scenario.blocked_exactly
        return polygons[shapely.dwithin(polygons, region, self.reach)]

    def free_at(self, interval: int, intervals: int, rings: list[np.ndarray]) -> np.ndarray:
        """The components of the free space in one of some intervals of headings among convex rings."""
        angle = 2 * math.pi * interval / intervals
        cos, sin = math.cos(angle), math.sin(angle)
        body = _body(self._half_length, self._half_width, math.pi / intervals) @ np.array([[cos, sin], [-sin, cos]])
        room = self._room(*body.max(axis=0))
        if not rings:
            return _components(room, shapely.GeometryCollection())
        sums = (np.concatenate(rings)[:, None] + body).reshape(-1, 2)
        owners = np.repeat(np.arange(len(rings)), [len(ring) * len(body) for ring in rings])
        grown = shapely.convex_hull(shapely.multipoints(sums, indices=owners))
        return _components(room, shapely.union_all(grown))

    def _room(self, half_x: float, half_y: float) -> shapely.Geometry:
        """Where the middle of a body of this extent may be: in the bounds, or in a box with a way around everything."""
        if self._scenario.box is not None:
            xmin, xmax, ymin, ymax = self._scenario.box
            low, high = np.array([xmin + half_x, ymin + half_y]), np.array([xmax - half_x, ymax - half_y])
            if (low > high).any():  # where that is rounding, the ends are within the slack of the middle
                low = high = 0.5 * (low + high)
        else:
            points = np.concatenate([self.middles, shapely.get_coordinates(self._scenario.polygons)])
            low, high = points.min(axis=0) - 3 * self.reach, points.max(axis=0) + 3 * self.reach
        return shapely.box(*low, *high)


def _body(half_length: float, half_width: float, half_interval: float) -> np.ndarray:
    """What is inside the car at all headings around 0 up to half the interval [rad]: vertices (K, 2) [m]."""
    smaller = math.cos(0.5 * half_interval)
    x, y = smaller * half_length, smaller * half_width
    car = shapely.box(-x, -y, x, y)
    turned = [affinity.rotate(car, sign * half_interval, origin=(0, 0), use_radians=True) for sign in (1, -1)]
    return np.asarray(car.intersection(turned[0]).intersection(turned[1]).exterior.coords)[:-1]


def _components(room: shapely.Geometry, blocked: shapely.Geometry) -> np.ndarray:
    return np.atleast_1d(shapely.get_parts(shapely.difference(room, blocked)))


def _at(components: np.ndarray, point: np.ndarray, slack: float) -> list[int]:
    """Indices of the components within a distance of a point (2,) [m]."""
    found: list[int] = np.flatnonzero(shapely.dwithin(components, shapely.Point(point), slack)).tolist()
    return found


def _too_narrow(task: _Task) -> NoPath:
    """The widest passage, where start and goal are separated for the disc."""
    if task.has_many_corners:
        return NoPath("obstacles separate the goal from the start for anything as wide as the car", proven=True)

    def joined(r: float) -> shapely.Geometry | None:
        free = task.free_of_disc(r)
        start, goal = (_at(free, *end) for end in zip(task.middles, task.allowed, strict=True))
        return next((free[i] for i in start if i in goal), None)

    passes, blocked = SMALLEST_SHARE * task.radius, task.radius
    way = joined(passes)
    if way is None:
        return NoPath(_enclosed(task, passes), proven=True)
    for _ in range(HALVINGS):
        middle = 0.5 * (passes + blocked)
        wider = joined(middle)
        if wider is None:
            blocked = middle
        else:
            passes, way = middle, wider
    place = _neck(way, task, passes, blocked)
    width = 2.0 * passes
    car = 2.0 * (task.radius + HAIR)
    where = "near {place}" if place is not None else "between start and goal"
    return NoPath(f"the passage {where} is {{width}} wide, the car {{length}}", True, place, width, car)


def _enclosed(task: _Task, radius: float) -> str:
    free = task.free_of_disc(radius)
    rim = shapely.union_all([shapely.boundary(task._room(radius, radius))])
    for name, i in (("goal", 1), ("start", 0)):
        around = _at(free, task.middles[i], task.allowed[i])
        if not any(shapely.dwithin(free[k], rim, HAIR) for k in around):
            return f"the {name} is enclosed on all sides"
    return "obstacles separate the goal from the start"


def _neck(way: shapely.Geometry, task: _Task, passes: float, blocked: float) -> tuple[float, float] | None:
    """A point in the passage that is open for one disc and blocked for one a little larger."""
    free = task.free_of_disc(blocked)
    sides = [shapely.union_all(free[_at(free, *end)]) for end in zip(task.middles, task.allowed, strict=True)]
    near = [shapely.buffer(side, 4.0 * (blocked - passes)) for side in sides]
    necks = shapely.get_parts(shapely.difference(way, shapely.union_all(near)))
    ends = [shapely.dwithin(necks, side, 1e-6) for side in near]
    between = necks[ends[0] & ends[1]]
    if not len(between):
        return None
    point = shapely.centroid(between[np.argmax(shapely.area(between))])
    return float(point.x), float(point.y)


def _no_way_in_headings(task: _Task, rings: list[np.ndarray], intervals: int) -> NoPath | None:
    """The proof by intervals of headings, with the convex rings near the components that hold both ends."""
    layers: dict[int, np.ndarray] = {}

    def layer(interval: int) -> np.ndarray:
        half = interval % (intervals // 2)  # the bodies are symmetric: half a turn changes nothing
        if half not in layers:
            layers[half] = task.free_at(half, intervals, rings)
        return layers[half]

    def nodes_of(which: int) -> set[tuple[int, int]]:
        position = task.headings[which] / (2 * math.pi) * intervals
        beyond = min(task.turns[which], math.pi) / (2 * math.pi) * intervals
        at = {k % intervals for k in range(round(position - beyond), round(position + beyond) + 1)}
        return {(k, i) for k in at for i in _at(layer(k), task.middles[which], float(task.slack[which]))}

    def reached(roots: set[tuple[int, int]], targets: set[tuple[int, int]]) -> set[tuple[int, int]]:
        seen, queue = set(roots), sorted(roots)
        while queue and not seen & targets:
            k, i = queue.pop()
            for other in ((k + 1) % intervals, (k - 1) % intervals):
                met = np.flatnonzero(shapely.intersects(layer(other), layer(k)[i]))
                new = {(other, int(j)) for j in met} - seen
                seen |= new
                queue += sorted(new)
        return seen

    start, goal = nodes_of(0), nodes_of(1)
    around_start = reached(start, goal)
    if around_start & goal:
        return None
    place = _between(
        *(shapely.union_all([layer(k)[i] for k, i in nodes]) for nodes in (around_start, reached(goal, set())))
    )
    return NoPath("near {place} there is no room for the car to get through, whatever it does", True, place)


def _between(start: shapely.Geometry, goal: shapely.Geometry) -> tuple[float, float]:
    """Where what can be reached from the start meets what the goal can be reached from, or comes nearest."""
    both = shapely.intersection(start, goal)
    point = shapely.shortest_line(start, goal).centroid if both.is_empty else both.centroid
    return float(point.x), float(point.y)
