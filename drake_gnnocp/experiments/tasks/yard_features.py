"""What a yard is put together from: dead ends, corridors, gates, docks, corners and containers.

A feature stands in a frame of its own and needs a hull of ground: its walls, and the room in front of its mouth that
the car needs to turn in.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from drake_gnnocp.experiments.tasks.open_maps import irregular
from drake_gnnocp.experiments.tasks.place import Area
from drake_gnnocp.experiments.tasks.shapes import Range, both_ways, box, l_wall, mirrored, moved, rectangle, u_wall
from drake_gnnocp.vehicle import Vehicle

ALONG_Y = math.pi / 2
LEAST_ROOM = 0.3  # m, on both sides of the car in a dead end or a dock, together twice that


@dataclass(frozen=True)
class FeatureOptions:
    """Sizes of the features."""

    thickness: Range = (0.2, 0.5)  # m, of walls
    corridor: Range = (3.0, 6.0)  # m, width
    corridor_length: Range = (7.0, 15.0)  # m
    gate: Range = (2.6, 4.0)  # m, width
    gate_wall: Range = (2.5, 8.0)  # m, on each side of a gate
    dead_end: Range = (2.6, 5.0)  # m, width
    dead_end_depth: Range = (5.5, 11.0)  # m
    dock: Range = (2.6, 3.6)  # m, width
    mouth: Range = (2.0, 6.0)  # m, free ground in front of a dead end, a dock, and on both sides of a gate
    arm: Range = (3.5, 11.0)  # m, of an L
    container_width: float = 2.5  # m
    container_length: Range = (6.0, 12.0)  # m
    irregular_radius: Range = (1.0, 3.5)  # m


@dataclass(frozen=True, eq=False)
class Feature:
    """Obstacles that belong together, in their own frame."""

    rings: tuple[np.ndarray, ...]  # (N_j, 2) [m]
    ground: Area  # m, no other feature stands here
    slots: tuple[np.ndarray, ...] = ()  # poses (3,), not tested for collisions [m, m, rad]


def dead_end(rng: np.random.Generator, vehicle: Vehicle, options: FeatureOptions) -> Feature:
    """A U with its mouth downwards; one arm may be shorter."""
    width = max(rng.uniform(*options.dead_end), vehicle.width + 2 * LEAST_ROOM)
    depth, t = rng.uniform(*options.dead_end_depth), rng.uniform(*options.thickness)
    arms = depth * (np.array([1.0, rng.uniform(0.4, 1.0)]) if rng.uniform() < 0.4 else np.ones(2))
    stands = np.array([width / 2, -vehicle.length / 2 - rng.uniform(0.3, max(depth - vehicle.length, 0.4))])
    ground = (-t, width + t, -depth - rng.uniform(*options.mouth), t)
    return Feature((u_wall(width, (arms[0], arms[1]), t),), ground, tuple(both_ways(vehicle, stands, ALONG_Y)))


def corridor(rng: np.random.Generator, vehicle: Vehicle, options: FeatureOptions) -> Feature:
    """Two walls along x; an L with a short arm instead of one of them now and then."""
    width, length = rng.uniform(*options.corridor), rng.uniform(*options.corridor_length)
    t, shift = rng.uniform(*options.thickness), rng.uniform(-0.3, 0.3) * length
    upper = box(shift, length + shift, width, width + t)
    if rng.uniform() < 0.4:
        arm = min(rng.uniform(0.2, 0.6) * width, width - options.gate[0])
        upper = moved(l_wall(length, arm, t), (shift, width, 0.0))
    ground = (min(shift, 0.0) - t, length + max(shift, 0.0), -t, width + t)
    stands = np.array([rng.uniform(0.3, 0.7) * length, vehicle.width / 2 + rng.uniform(0.2, 0.6)])
    return Feature((box(0.0, length, -t, 0.0), upper), ground, tuple(both_ways(vehicle, stands, 0.0)))


def gate(rng: np.random.Generator, vehicle: Vehicle, options: FeatureOptions) -> Feature:
    """A wall along x with a gap; its right half may be an L."""
    width, t = max(rng.uniform(*options.gate), vehicle.width + 2 * LEAST_ROOM), rng.uniform(*options.thickness)
    left, right = rng.uniform(*options.gate_wall, 2)
    below, above = rng.uniform(*options.mouth, 2)
    walls = [box(-left, 0.0, 0.0, t), box(width, width + right, 0.0, t)]
    if rng.uniform() < 0.4:
        walls[1] = moved(mirrored(l_wall(right, below, t)), (width + right, 0.0, 0.0))
    return Feature(tuple(walls), (-left, width + right + t, -below, above))


def dock(rng: np.random.Generator, vehicle: Vehicle, options: FeatureOptions) -> Feature:
    """Containers side by side with one berth or two between them, open downwards, perhaps with a wall behind."""
    width, n_berths = options.container_width, int(rng.integers(1, 3))
    rings, slots, x = [], [], 0.0
    depth = rng.uniform(*options.container_length)
    for k in range(n_berths + 1):
        length = depth - rng.uniform(0.0, 1.0)
        rings.append(box(x, x + width, -length, 0.0))
        x += width
        if k < n_berths:
            berth = max(rng.uniform(*options.dock), vehicle.width + 2 * LEAST_ROOM)
            slots += both_ways(vehicle, np.array([x + berth / 2, -vehicle.length / 2 - rng.uniform(0.3, 1.5)]), ALONG_Y)
            x += berth
    behind = 0.0
    if rng.uniform() < 0.7:
        behind = 0.1 + rng.uniform(*options.thickness)
        rings.append(box(0.0, x, 0.1, behind))
    return Feature(tuple(rings), (0.0, x, -depth - rng.uniform(*options.mouth), behind), tuple(slots))


def corner(rng: np.random.Generator, vehicle: Vehicle, options: FeatureOptions) -> Feature:
    """An L, and the pose along its longer wall."""
    width, arm = rng.uniform(*options.arm, 2)
    t = rng.uniform(*options.thickness)
    stands = np.array([vehicle.length / 2 + rng.uniform(0.4, 1.5), -vehicle.width / 2 - rng.uniform(0.2, 0.6)])
    slots = both_ways(vehicle, stands, 0.0) if width > vehicle.length else []
    return Feature((l_wall(width, arm, t),), (-t, width, -arm, t), tuple(slots))


def containers(rng: np.random.Generator, vehicle: Vehicle, options: FeatureOptions) -> Feature:
    """One container, or two nearly touching ones one behind the other or side by side."""
    length, width = rng.uniform(*options.container_length), options.container_width
    rings = [box(0.0, length, 0.0, width)]
    if rng.uniform() < 0.3:
        across = rng.uniform() < 0.5
        shift = (rng.uniform(-2.0, 2.0), width + 0.2) if across else (length + 0.3, rng.uniform(-0.4, 0.4))
        rings.append(box(0.0, rng.uniform(*options.container_length), 0.0, width) + shift)
    return _without_mouth(rings)


def irregular_polygon(rng: np.random.Generator, vehicle: Vehicle, options: FeatureOptions) -> Feature:
    """A heap, convex or not."""
    return _without_mouth([irregular(rng, options.irregular_radius)])


def clutter(rng: np.random.Generator, vehicle: Vehicle, options: FeatureOptions) -> Feature:
    """A pallet, a pole or a piece of wall."""
    sides = rng.uniform(0.3, 1.5, 2)
    if rng.uniform() < 0.3:
        sides = np.array([rng.uniform(2.0, 5.0), rng.uniform(*options.thickness)])
    return _without_mouth([rectangle(sides[0], sides[1])])


FeatureMaker = Callable[[np.random.Generator, Vehicle, FeatureOptions], Feature]
LARGE: tuple[FeatureMaker, ...] = (dead_end, corridor, gate, dock, corner, containers)
SMALL: tuple[FeatureMaker, ...] = (irregular_polygon, clutter)


def _without_mouth(rings: list[np.ndarray]) -> Feature:
    points = np.concatenate(rings)
    low, high = points.min(axis=0), points.max(axis=0)
    return Feature(tuple(rings), (float(low[0]), float(high[0]), float(low[1]), float(high[1])))
