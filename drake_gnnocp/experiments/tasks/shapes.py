"""What car parks and yards are put together from: rings in a frame of their own, rigid motions, and the car.

A frame is a pose (3,) x, y, theta: the point p of a shape is at R(theta) p + (x, y) on the map.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from drake_gnnocp.experiments.tasks.open_maps import MapOptions, Range, random_obstacles
from drake_gnnocp.vehicle import Vehicle

SQUARE = 20.0  # m, large enough for an irregular polygon to be drawn in at once
SLOT_CLEARANCE = 0.1  # m, of the car in a parking slot, at least


@dataclass(frozen=True)
class VehicleOptions:
    """How much cars differ from the paper's."""

    default: float = 0.5  # share of the places that have the paper's car
    wheelbase: Range = (2.5, 3.1)  # m
    front_hang: Range = (0.8, 1.05)  # m
    rear_hang: Range = (0.7, 1.1)  # m
    width: Range = (1.75, 2.05)  # m
    v_max: Range = (2.0, 2.8)  # m/s
    a_max: Range = (0.8, 2.0)  # m/s^2
    phi_max: Range = (0.6, 0.78)  # rad
    w_max: Range = (0.4, 0.9)  # rad/s


def random_vehicle(rng: np.random.Generator, options: VehicleOptions) -> Vehicle:
    """The paper's car, or one that is a little different."""
    if rng.uniform() < options.default:
        return Vehicle()
    names = ("wheelbase", "front_hang", "rear_hang", "width", "v_max", "a_max", "phi_max", "w_max")
    return Vehicle(**{name: float(rng.uniform(*getattr(options, name))) for name in names})


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


def irregular(rng: np.random.Generator, radius: Range, concave: float = 0.3) -> np.ndarray:
    """An irregular polygon of the paper's random maps around the origin: (N, 2), N <= 8 [m].

    Args:
        rng: source of randomness.
        radius: longer half axis of the ellipse that holds the vertices [m].
        concave: share of concave ones.
    """
    ring = random_obstacles(rng, MapOptions(SQUARE, 1, rectangles=0.0, concave=concave, radius=radius))[0]
    return ring - ring.mean(axis=0)


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


def are_clear(
    vehicle: Vehicle,
    poses: np.ndarray,
    blocked: shapely.Geometry,
    area: tuple[float, float, float, float],
    clearance: float,
) -> np.ndarray:
    """Which poses (N, 3) keep the car inside an area (xmin, xmax, ymin, ymax) and clear of what is blocked: (N,) bool.

    Args:
        vehicle: the car.
        poses: x, y, theta [m, m, rad].
        blocked: the obstacles.
        area: what the footprint stays inside [m].
        clearance: least distance of the footprint to the obstacles [m].
    """
    corners = vehicle.footprints(poses)
    low, high = np.array(area[0::2]), np.array(area[1::2])
    inside = ((corners >= low) & (corners <= high)).all(axis=(1, 2))
    return inside & ~shapely.dwithin(blocked, shapely.polygons(corners), clearance)
