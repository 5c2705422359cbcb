"""Random tasks in the manner of the paper: rectangles and irregular polygons on a square, and two free poses.

Every task has its own random generator, `numpy.random.default_rng([seed, i])`: task i is the same whatever the others
are.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import shapely

from drake_gnnocp.experiments.tasks.place import are_clear, union
from drake_gnnocp.experiments.tasks.shapes import Range, moved, rectangle
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.vehicle import Vehicle

SPREAD = 0.35  # of the angle between vertices, how far one is moved along the outline: they never change places
MOST_DRAWS = 500  # draws of an obstacle or of two poses before the map is drawn anew
SQUARE = 20.0  # m, large enough for an irregular polygon to be drawn in at once


@dataclass(frozen=True)
class MapOptions:
    """What the maps look like. Concave obstacles are irregular ones with some vertices moved towards the middle."""

    side: float = 40.0  # m, of the square [0, side]^2 that holds the obstacles and the car at both ends
    n_obstacles: int = 10
    rectangles: float = 0.5  # share of the obstacles; the rest are irregular
    concave: float = 0.15  # share of the obstacles, among the irregular ones
    rectangle_sides: Range = (2.5, 8.0)  # m, both
    radius: Range = (2.0, 4.8)  # m, longer half axis of the ellipse that holds an irregular polygon's vertices
    flatness: Range = (0.5, 1.0)  # shorter half axis over the longer one
    vertices: tuple[int, int] = (3, 8)  # of irregular polygons, fewest and most; concave ones have at least 6
    dent: Range = (0.2, 0.5)  # what the radius of a vertex moved inwards is multiplied by
    gap: float = 0.5  # m, least distance of two obstacles: some passages are too narrow for the car


@dataclass(frozen=True)
class TaskOptions:
    """Where the car starts and stops; it may leave the square in between, as in the paper."""

    distance: Range = (5.0, 40.0)  # m, rear axle at the start to rear axle at the goal
    clearance: float = 0.3  # m, least distance of the footprint to the obstacles at both ends
    unobstructed: float = 0.15  # share of tasks taken even where the straight line is free


def task_name(seed: int, i: int) -> str:
    """Name of task i of a seed."""
    return f"random_{seed}_{i:04d}"


def random_task(seed: int, i: int, maps: MapOptions | None = None, task: TaskOptions | None = None) -> Scenario:
    """Task i of a seed."""
    rng = np.random.default_rng([seed, i])
    maps, task = maps or MapOptions(), task or TaskOptions()
    while True:
        obstacles = random_obstacles(rng, maps)
        ends = random_ends(rng, obstacles, maps.side, task)
        if ends is not None:
            return Scenario(task_name(seed, i), ends[0], ends[1], obstacles)


def random_obstacles(rng: np.random.Generator, options: MapOptions) -> tuple[np.ndarray, ...]:
    """Rings (N_j, 2), counter-clockwise, inside the square and `gap` apart [m]."""
    square = shapely.box(0.0, 0.0, options.side, options.side)
    while True:
        rings: list[np.ndarray] = []
        for _ in range(MOST_DRAWS):
            ring = _obstacle(rng, options)
            polygon = shapely.Polygon(ring)
            others = [shapely.Polygon(other) for other in rings]
            if square.contains(polygon) and not any(polygon.dwithin(other, options.gap) for other in others):
                rings.append(ring)
            if len(rings) == options.n_obstacles:
                return tuple(rings)


def irregular(rng: np.random.Generator, radius: Range, concave: float = 0.3) -> np.ndarray:
    """An irregular polygon around the origin: (N, 2), N <= 8 [m].

    Args:
        rng: source of randomness.
        radius: longer half axis of the ellipse that holds the vertices [m].
        concave: share of concave ones.
    """
    ring = random_obstacles(rng, MapOptions(SQUARE, 1, rectangles=0.0, concave=concave, radius=radius))[0]
    return ring - ring.mean(axis=0)


def random_ends(
    rng: np.random.Generator, obstacles: tuple[np.ndarray, ...], side: float, options: TaskOptions
) -> tuple[np.ndarray, np.ndarray] | None:
    """Start and goal, (3,) x, y, theta each [m, m, rad]: any heading, clear of the obstacles and inside the square.

    Returns:
        None where a map gives none after many draws.
    """
    vehicle, blocked = Vehicle(), union(obstacles)
    may_be_free = rng.uniform() < options.unobstructed
    shapely.prepare(blocked)
    for _ in range(MOST_DRAWS):
        ends = rng.uniform([0.0, 0.0, -math.pi], [side, side, math.pi], (2, 3))
        line = shapely.LineString(ends[:, :2])
        if (
            options.distance[0] <= line.length <= options.distance[1]
            and are_clear(vehicle, ends, blocked, (0.0, side, 0.0, side), options.clearance).all()
            and (may_be_free or blocked.dwithin(line, vehicle.width / 2))
        ):
            return ends[0], ends[1]
    return None


def _obstacle(rng: np.random.Generator, options: MapOptions) -> np.ndarray:
    kind = rng.uniform()
    if kind < options.rectangles:
        shape = rectangle(*rng.uniform(*options.rectangle_sides, 2))
    else:
        shape = _irregular(rng, kind < options.rectangles + options.concave, options)
    turn = rng.uniform(-math.pi, math.pi)
    return moved(shape, (*rng.uniform(0.0, options.side, 2), turn))


def _irregular(rng: np.random.Generator, concave: bool, options: MapOptions) -> np.ndarray:
    """Vertices on an ellipse, which makes them convex, or some of them moved inwards: (N, 2) [m]."""
    fewest, most = options.vertices
    n = int(rng.integers(max(fewest, 6) if concave else fewest, most + 1))
    angle = 2 * math.pi / n * (np.arange(n) + rng.uniform(-SPREAD, SPREAD, n))
    radius = np.ones(n)
    if concave:
        # a vertex and perhaps the one opposite: two neighbours moved inwards would leave a convex corner
        dents = [0, n // 2][: int(rng.integers(1, 3))]
        radius[dents] = rng.uniform(*options.dent, len(dents))
    axes = rng.uniform(*options.radius) * np.array([1.0, rng.uniform(*options.flatness)])
    return axes * radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
