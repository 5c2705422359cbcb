"""Rings in a frame of their own, rigid motions, and the car: what maps are put together from.

A frame is a pose (3,) x, y, theta: the point p of a shape is at R(theta) p + (x, y) on the map.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np
import shapely

from drake_gnnocp.vehicle import Vehicle

Range = tuple[float, float]  # from, to


def box(xmin: float, xmax: float, ymin: float, ymax: float) -> np.ndarray:
    """Ring of an upright rectangle: (4, 2) [m]."""
    return np.array([[xmin, ymin], [xmax, ymin], [xmax, ymax], [xmin, ymax]])


def rectangle(length: float, width: float) -> np.ndarray:
    """Ring of a rectangle around the origin, its length along x: (4, 2) [m]."""
    return box(-length / 2, length / 2, -width / 2, width / 2)


def l_wall(width: float, arm: float, thickness: float) -> np.ndarray:
    """A wall above y = 0 from x = 0 to the width, and an arm left of x = 0 down to y = -arm: (6, 2) [m]."""
    t = thickness
    return np.array([[-t, t], [-t, -arm], [0.0, -arm], [0.0, 0.0], [width, 0.0], [width, t]])


def u_wall(width: float, arms: tuple[float, float], thickness: float) -> np.ndarray:
    """A wall above y = 0, and arms left of x = 0 and right of the width down to -arms: (8, 2) [m]."""
    t, (left, right) = thickness, arms
    left_arm = [[-t, t], [-t, -left], [0.0, -left], [0.0, 0.0]]
    return np.array([*left_arm, [width, 0.0], [width, -right], [width + t, -right], [width + t, t]])


def mirrored(ring: np.ndarray) -> np.ndarray:
    """A ring (N, 2) with x turned into -x, in the same orientation [m]."""
    return ring[::-1] * np.array([-1.0, 1.0])


def moved(points: np.ndarray, frame: Sequence[float] | np.ndarray) -> np.ndarray:
    """Points (N, 2) of a shape, on the map [m]."""
    x, y, theta = frame
    cos, sin = math.cos(theta), math.sin(theta)
    return points @ np.array([[cos, sin], [-sin, cos]]) + np.array([x, y])


def moved_poses(poses: np.ndarray, frame: Sequence[float] | np.ndarray) -> np.ndarray:
    """Poses (N, 3) x, y, theta in a frame, on the map [m, m, rad]; headings within pi."""
    theta = np.remainder(poses[:, 2] + frame[2] + math.pi, 2 * math.pi) - math.pi
    return np.column_stack([moved(poses[:, :2], frame), theta])


def standing(vehicle: Vehicle, centre: np.ndarray, heading: float) -> np.ndarray:
    """Pose (3,) of a car whose rectangle has this centre (2,) [m, m, rad]."""
    middle = (vehicle.wheelbase + vehicle.front_hang - vehicle.rear_hang) / 2  # ahead of the rear axle
    return np.array([*(centre - middle * np.array([math.cos(heading), math.sin(heading)])), heading])


def both_ways(vehicle: Vehicle, centre: np.ndarray, heading: float) -> list[np.ndarray]:
    """The two poses of a car whose rectangle has this centre (2,), nose and tail first [m, m, rad]."""
    return [standing(vehicle, centre, heading), standing(vehicle, centre, heading + math.pi)]


def apart(rings: Iterable[np.ndarray], gap: float) -> list[np.ndarray]:
    """The rings (N_j, 2) without those that are less than a gap away from an earlier one [m]."""
    kept: list[np.ndarray] = []
    polygons: list[shapely.Polygon] = []
    for ring in rings:
        polygon = shapely.Polygon(ring)
        if not shapely.dwithin(polygon, np.array(polygons, dtype=object), gap).any():
            kept.append(ring)
            polygons.append(polygon)
    return kept
