r"""Does the car, grown by a safety margin, touch an obstacle or leave the region? Exact, for many poses at once.

Two look-ups of the distance field decide most poses. With circle centres spread along the car's axis,
- all circles of radius r, which together cover the car, are free: the car is free;
- an obstacle is nearer to a centre than the car's own side is: the car collides.

The rest is decided by the separating axis theorem between the car's rectangle and the convex parts of the obstacles:
two convex polygons are disjoint exactly when an edge normal of one of them separates them. Crossing edges, a car
inside an obstacle and an obstacle inside the car need no special care, and concave obstacles are exact because
their convex parts cover them exactly.

The margin m grows the rectangle on all sides, which contains every point within m of the car. Near the start and the
goal it is lowered to half the clearance there, since an end nearer to an obstacle than the margin would never be left.

Between two tested poses no point of the car is further than m from where it was at the nearer of them, if the poses are
at most 2 m / `sweep` apart along the path: a point moves at most `sweep` times as far as the rear axle. With this
spacing, free samples prove the motion between them free. A margin of a few centimetres would ask for very many poses,
so they are never less than FINEST_SPACING apart: then nothing is proven, and a corner may clip an obstacle by
centimetres between two poses. The verification of the plan looks at the whole motion later.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from drake_gnnocp.polygons import padded_rings
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.search.distance_field import DistanceField
from drake_gnnocp.vehicle import Vehicle

Box = tuple[float, float, float, float]  # xmin, xmax, ymin, ymax [m]

BOUNDS_TOLERANCE = 1e-9  # m: a car that starts exactly on the bounds is inside, whatever the rounding
FEW_PARTS = 40  # all of which are compared with every pose; more are looked up in an index
MOST_NUMBERS = 2_000_000  # in an array: more poses are tested in parts
COARSEST_SPACING = 0.2  # m, between tested poses
FINEST_SPACING = 0.05  # m, however small the margin: a corner can clip by 4 cm between poses, never a wall be jumped


@dataclass(frozen=True)
class Margins:
    """Safety margin to obstacles: `usual`, but no more than `start` and `goal` around these poses."""

    usual: float  # m
    start: float  # m
    goal: float  # m
    end_radius: float  # m, around the rear axle's middle at an end, within which that end's margin holds

    @classmethod
    def of(cls, scenario: Scenario, usual: float) -> Margins:
        """The usual margin [m] where the ends allow it, half the clearance of an end around it otherwise."""
        start, goal = np.minimum(usual, 0.5 * scenario.nearest_at_ends).tolist()
        return cls(usual, start, goal, end_radius=1.5 * scenario.vehicle.length)


class FootprintTest:
    """Tests poses of one vehicle among the obstacles of one scenario.

    Args:
        scenario: the obstacles, the vehicle and the ends.
        field: distances to the obstacles; must cover the region.
        region: xmin, xmax, ymin, ymax: the whole footprint (without the margin) must stay inside [m].
        margins: how much the car is grown.
    """

    def __init__(self, scenario: Scenario, field: DistanceField, region: Box, margins: Margins) -> None:
        self._vehicle = vehicle = scenario.vehicle
        self._field, self._region, self._margins = field, region, margins
        self._ends = (scenario.start, scenario.goal)
        self._half = np.array([0.5 * vehicle.length, 0.5 * vehicle.width])
        self._middle = 0.5 * vehicle.length - vehicle.rear_hang  # the rectangle's centre, ahead of the rear axle
        self._place_circles(vehicle)
        self._index_parts(scenario.convex_obstacles)
        per_pose = max(len(self._offsets), 0 if self._tree else len(self._parts))
        self._most_poses = max(1, MOST_NUMBERS // per_pose)
        smallest = min(margins.usual, margins.start, margins.goal)
        self.spacing = min(max(2.0 * smallest / sweep(vehicle), FINEST_SPACING), COARSEST_SPACING)  # m, see above

    def collides(self, poses: np.ndarray) -> np.ndarray:
        """Which poses (N, 3) [m, m, rad] touch an obstacle or leave the region: (N,) bool."""
        if len(poses) > self._most_poses:
            parts = range(0, len(poses), self._most_poses)
            return np.concatenate([self.collides(poses[first : first + self._most_poses]) for first in parts])
        x, y = poses[:, 0], poses[:, 1]
        cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        hit = self._leaves_region(x, y, cos, sin)
        if not len(self._parts):
            return hit
        margin = self._margin_at(x, y)
        distance = self._field.at(x[:, None] + cos[:, None] * self._offsets, y[:, None] + sin[:, None] * self._offsets)
        distance -= margin[:, None]
        hit |= (distance < self._surely_hit).any(axis=1)
        unsure = np.flatnonzero((distance.min(axis=1) <= self._surely_free) & ~hit)
        if len(unsure):
            hit[unsure] = self._touches_part(x[unsure], y[unsure], cos[unsure], sin[unsure], margin[unsure])
        return hit

    def have_hits(self, paths: Sequence[np.ndarray]) -> np.ndarray:
        """Which paths (N_i, 3) have a colliding pose: bool."""
        if not paths:
            return np.zeros(0, dtype=bool)
        starts = np.cumsum([0, *(len(poses) for poses in paths[:-1])])
        return np.logical_or.reduceat(self.collides(np.concatenate(paths)), starts)

    def _place_circles(self, vehicle: Vehicle) -> None:
        count = math.ceil(2.0 * vehicle.length / vehicle.width)
        piece = vehicle.length / count
        from_rear = (np.arange(count) + 0.5) * piece
        self._offsets = from_rear - vehicle.rear_hang  # along the axis, from the rear axle
        # a centre's distance to the outside of the car: to its side, or to the nearer bumper
        own = np.minimum(0.5 * vehicle.width, np.minimum(from_rear, vehicle.length - from_rear))
        self._surely_hit = own - self._field.half_diagonal
        # the margin grows the corners by sqrt(2) margin, as much again is granted to it in collides()
        extra = (math.sqrt(2.0) - 1.0) * self._margins.usual
        self._surely_free = math.hypot(0.5 * piece, 0.5 * vehicle.width) + extra + self._field.half_diagonal

    def _index_parts(self, parts: tuple[np.ndarray, ...]) -> None:
        self._parts, _ = padded_rings(parts)  # (M, V, 2)
        self._tree = None
        if not len(parts):
            return
        self._low, self._high = self._parts.min(axis=1), self._parts.max(axis=1)  # (M, 2)
        if len(parts) > FEW_PARTS:
            self._tree = shapely.STRtree(shapely.box(*self._low.T, *self._high.T))
        edges = np.roll(self._parts, -1, axis=1) - self._parts
        self._normals = np.stack([edges[..., 1], -edges[..., 0]], axis=-1)  # outward; 0 where padded
        self._levels = np.sum(self._normals * self._parts, axis=-1)  # (M, V)

    def _leaves_region(self, x: np.ndarray, y: np.ndarray, cos: np.ndarray, sin: np.ndarray) -> np.ndarray:
        xmin, xmax, ymin, ymax = self._region
        half_length, half_width = self._half
        abs_cos, abs_sin = np.abs(cos), np.abs(sin)
        half_x = abs_cos * half_length + abs_sin * half_width
        half_y = abs_sin * half_length + abs_cos * half_width
        off_x = np.abs(x + cos * self._middle - 0.5 * (xmin + xmax)) + half_x
        off_y = np.abs(y + sin * self._middle - 0.5 * (ymin + ymax)) + half_y
        return (off_x > 0.5 * (xmax - xmin) + BOUNDS_TOLERANCE) | (off_y > 0.5 * (ymax - ymin) + BOUNDS_TOLERANCE)

    def _margin_at(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        margin = np.full(len(x), self._margins.usual)
        for pose, least in zip(self._ends, (self._margins.start, self._margins.goal), strict=True):
            if least < self._margins.usual:
                around = (x - pose[0]) ** 2 + (y - pose[1]) ** 2 < self._margins.end_radius**2
                margin[around] = np.minimum(margin[around], least)
        return margin

    def _touches_part(
        self, x: np.ndarray, y: np.ndarray, cos: np.ndarray, sin: np.ndarray, margin: np.ndarray
    ) -> np.ndarray:
        """The separating axis test of every pose against the parts whose box meets the car's box."""
        half_length, half_width = self._half[0] + margin, self._half[1] + margin
        cx, cy = x + cos * self._middle, y + sin * self._middle
        half_x = np.abs(cos) * half_length + np.abs(sin) * half_width
        half_y = np.abs(sin) * half_length + np.abs(cos) * half_width
        pose, part = self._boxes_that_meet(cx - half_x, cx + half_x, cy - half_y, cy + half_y)
        cx, cy, cos, sin = cx[pose, None], cy[pose, None], cos[pose, None], sin[pose, None]
        half_length, half_width = half_length[pose], half_width[pose]
        vertices, normals = self._parts[part], self._normals[part]  # (P, V, 2)
        dx, dy = vertices[..., 0] - cx, vertices[..., 1] - cy
        along, across = cos * dx + sin * dy, cos * dy - sin * dx  # in the car's frame
        apart = (along.min(axis=1) > half_length) | (along.max(axis=1) < -half_length)
        apart |= (across.min(axis=1) > half_width) | (across.max(axis=1) < -half_width)
        n_along = np.abs(cos * normals[..., 0] + sin * normals[..., 1]) * half_length[:, None]
        n_across = np.abs(cos * normals[..., 1] - sin * normals[..., 0]) * half_width[:, None]
        height = normals[..., 0] * cx + normals[..., 1] * cy - self._levels[part]
        apart |= (height > n_along + n_across).any(axis=1)
        touches = np.zeros(len(x), dtype=bool)
        touches[pose[~apart]] = True
        return touches

    def _boxes_that_meet(
        self, xmin: np.ndarray, xmax: np.ndarray, ymin: np.ndarray, ymax: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Pairs of one of some boxes (N,) and a part whose own box it meets: (P,) and (P,)."""
        if self._tree is not None:
            boxes, parts = self._tree.query(shapely.box(xmin, ymin, xmax, ymax))
            return boxes, parts
        meet = (xmax[:, None] >= self._low[:, 0]) & (xmin[:, None] <= self._high[:, 0])
        meet &= (ymax[:, None] >= self._low[:, 1]) & (ymin[:, None] <= self._high[:, 1])
        boxes, parts = np.nonzero(meet)
        return boxes, parts


def sweep(vehicle: Vehicle) -> float:
    """Largest distance any point of the car moves per metre of the rear axle's middle, at full lock."""
    radius, ahead = vehicle.turning_radius, max(vehicle.wheelbase + vehicle.front_hang, vehicle.rear_hang)
    return math.hypot(radius + 0.5 * vehicle.width, ahead) / radius
