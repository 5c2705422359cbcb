"""A place: obstacles, where start and goal may be, and the car that drives there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from drake_gnnocp.experiments.tasks.shapes import Range
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.vehicle import Vehicle

WIDE_KINDS = ("open", "car_park", "yard")
TIGHT = "tight"
KINDS = (*WIDE_KINDS, TIGHT)
SLOT_CLEARANCE = 0.1  # m, of the car in a parking slot, at least
FEWEST, MOST = 5, 60  # obstacles of a car park or a yard

Area = tuple[float, float, float, float]  # xmin, xmax, ymin, ymax [m]


@dataclass(frozen=True)
class Place:
    """A map without a task."""

    kind: str  # one of KINDS
    area: Area  # m, start and goal lie inside
    obstacles: tuple[np.ndarray, ...]  # rings (N_j, 2) [m]
    slots: tuple[np.ndarray, ...]  # goal poses (3,) of free parking slots, collision-free for `vehicle` [m, m, rad]
    vehicle: Vehicle
    lines: tuple[np.ndarray, ...] = ()  # walls without thickness: polylines (N_j, 2) [m]
    is_bounded: bool = False  # whether the car stays inside the area all the way

    def task(self, name: str, start: np.ndarray, goal: np.ndarray) -> Scenario:
        """From one pose (3,) to another here."""
        bounds = self.area if self.is_bounded else None
        return Scenario(name, start, goal, self.obstacles, bounds, self.vehicle, lines=self.lines)


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
    return Vehicle(**{name: float(rng.uniform(*getattr(options, name))) for name in Vehicle().to_dict()})


def usable_place(draw: Callable[[], Place]) -> Place:
    """The first place drawn that has a slot, and neither too few nor too many obstacles."""
    while True:
        place = draw()
        if place.slots and FEWEST <= len(place.obstacles) <= MOST:
            return place


def place_with_slots(kind: str, area: Area, rings: Sequence[np.ndarray], slots: np.ndarray, vehicle: Vehicle) -> Place:
    """A place with those of the slots (N, 3) where the car is clear of the rings (N_j, 2) and inside the area."""
    clear = are_clear(vehicle, slots, union(rings), area, SLOT_CLEARANCE)
    return Place(kind, area, tuple(rings), tuple(slots[clear]), vehicle)


def union(rings: Sequence[np.ndarray], lines: Sequence[np.ndarray] = ()) -> shapely.Geometry:
    """All that rings (N_j, 2) enclose, and lines (N_j, 2) [m]."""
    return shapely.union_all([*map(shapely.Polygon, rings), *map(shapely.LineString, lines)])


def are_clear(
    vehicle: Vehicle,
    poses: np.ndarray,
    blocked: shapely.Geometry,
    area: Area,
    clearance: float,
) -> np.ndarray:
    """Which poses (N, 3) keep the car inside an area and clear of what is blocked: (N,) bool.

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
