"""One row of parking slots along an aisle.

In the row's frame x runs along the aisle, the aisle is below y = 0 and the row reaches from there to y = depth.
The slots of a row make an angle alpha with the aisle: 90 degrees where it is perpendicular. With slots of width b,
they follow each other at b / sin(alpha), and slots of length l reach l sin(alpha) + b cos(alpha) deep. In a parallel
row the gaps between the cars are made for the car that is to park.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from drake_gnnocp.experiments.tasks.shapes import Range, both_ways, moved, rectangle, standing
from drake_gnnocp.vehicle import Vehicle

ROW_KINDS = ("perpendicular", "parallel", "angled")


@dataclass(frozen=True)
class RowOptions:
    """Slots, the cars in them, and how carelessly they were parked."""

    kinds: tuple[float, float, float] = (0.45, 0.27, 0.28)  # shares, in the order of ROW_KINDS
    angle: Range = (0.52, 1.05)  # rad, of angled slots to the aisle, to the left or to the right
    slot_width: Range = (2.3, 2.9)  # m, perpendicular and angled
    slot_length: Range = (5.0, 5.5)  # m, the same
    parallel_depth: Range = (2.1, 2.6)  # m
    parallel_extra: Range = (0.9, 3.0)  # m, length of a free gap over that of the car that parks
    bumper_gap: Range = (0.4, 1.2)  # m, between the cars of a parallel row
    free: Range = (0.2, 0.5)  # share of the slots
    car_length: Range = (4.2, 5.0)  # m
    car_width: Range = (1.7, 2.0)  # m
    along: float = 0.25  # m, most a parked car is off its slot's middle, along it
    across: float = 0.12  # m, the same to the side
    skew: float = 0.05  # rad, most a parked car is turned against its slot
    pillars: float = 0.35  # share of perpendicular and angled rows that have them
    pillar_side: Range = (0.3, 0.6)  # m


@dataclass(frozen=True, eq=False)
class Row:
    """A row in its own frame."""

    depth: float  # m
    length: float  # m
    cars: tuple[np.ndarray, ...]  # rings (4, 2) [m]
    pillars: tuple[np.ndarray, ...]  # rings (4, 2) [m], some of them in the way of a car
    slots: np.ndarray  # (N, 3) poses in free slots, not tested for collisions [m, m, rad]


def random_row(rng: np.random.Generator, length: float, vehicle: Vehicle, options: RowOptions) -> Row:
    """A row of a kind drawn at random.

    Args:
        rng: source of randomness.
        length: the row is about as long as this [m].
        vehicle: the car for which slots are free.
        options: see `RowOptions`.
    """
    kind = rng.choice(ROW_KINDS, p=options.kinds)
    if kind == "parallel":
        return _parallel(rng, length, vehicle, options)
    alpha = math.pi / 2
    if kind == "angled":
        alpha = rng.uniform(*options.angle)
        alpha = alpha if rng.uniform() < 0.5 else math.pi - alpha
    return _slanted(rng, alpha, length, vehicle, options)


def _slanted(rng: np.random.Generator, alpha: float, length: float, vehicle: Vehicle, options: RowOptions) -> Row:
    b = rng.uniform(*options.slot_width)
    depth = rng.uniform(*options.slot_length) * math.sin(alpha) + b * abs(math.cos(alpha))
    pitch = b / math.sin(alpha)
    n = max(int(length / pitch), 1)
    is_free = rng.uniform(size=n) < rng.uniform(*options.free)
    cars, slots = [], []
    for k in range(n):
        centre = np.array([(k + 0.5) * pitch, depth / 2])
        if is_free[k]:
            slots += both_ways(vehicle, centre, alpha)
        else:
            cars.append(_parked(rng, centre, alpha, options))
    pillars = _pillars(rng, n, pitch, depth, alpha, options) if rng.uniform() < options.pillars else []
    return Row(depth, n * pitch, tuple(cars), tuple(pillars), np.array(slots).reshape(-1, 3))


def _pillars(
    rng: np.random.Generator, n: int, pitch: float, depth: float, alpha: float, options: RowOptions
) -> list[np.ndarray]:
    """Pillars on the lines between slots, one line in two to four."""
    side, every = rng.uniform(*options.pillar_side), int(rng.integers(2, 5))
    y = rng.uniform(0.1, 0.5) * depth
    shift = (y - depth / 2) / math.tan(alpha)
    return [moved(rectangle(side, side), (k * pitch + shift, y, 0.0)) for k in range(0, n + 1, every)]


def _parallel(rng: np.random.Generator, length: float, vehicle: Vehicle, options: RowOptions) -> Row:
    depth, free = rng.uniform(*options.parallel_depth), rng.uniform(*options.free)
    direction = math.pi * rng.integers(2)  # which way the cars of this side of the aisle go
    cars: list[np.ndarray] = []
    slots: list[np.ndarray] = []
    x = 0.0
    while x < length:
        if rng.uniform() < free:
            gap = vehicle.length + rng.uniform(*options.parallel_extra)
            slots.append(standing(vehicle, np.array([x + gap / 2, depth / 2]), direction))
            x += gap
            continue
        if cars and cars[-1][:, 0].max() > x - options.bumper_gap[0]:
            x += rng.uniform(*options.bumper_gap)
        car = _parked(rng, np.array([0.0, depth / 2]), 0.0, options)
        cars.append(car + np.array([x - car[:, 0].min(), 0.0]))
        x = float(cars[-1][:, 0].max())
    return Row(depth, x, tuple(cars), (), np.array(slots).reshape(-1, 3))


def _parked(rng: np.random.Generator, centre: np.ndarray, heading: float, options: RowOptions) -> np.ndarray:
    """Ring (4, 2) of a car that stands about there [m]."""
    shape = rectangle(rng.uniform(*options.car_length), rng.uniform(*options.car_width))
    most = np.array([options.along, options.across, options.skew])
    return moved(moved(shape, rng.uniform(-most, most)), (*centre, heading))
