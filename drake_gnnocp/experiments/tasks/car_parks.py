"""Random car parks: rows of slots along aisles, with walls behind them and a few things that stand on the aisles.

A car park is laid out in bands across the aisles: "A" is an aisle, "D" a row that opens down to the aisle below it
and "U" one that opens up, so "UAD" is an aisle between two rows and "DU" are two rows back to back.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from drake_gnnocp.experiments.tasks.open_maps import irregular
from drake_gnnocp.experiments.tasks.place import (
    Area,
    Place,
    VehicleOptions,
    place_with_slots,
    random_vehicle,
    usable_place,
)
from drake_gnnocp.experiments.tasks.rows import Row, RowOptions, random_row
from drake_gnnocp.experiments.tasks.shapes import Range, apart, box, l_wall, mirrored, moved, moved_poses, u_wall
from drake_gnnocp.vehicle import Vehicle

LAYOUTS = ("AD", "UAD", "ADUA", "UADUA", "UADUAD")
ABUTTING = 0.05  # m, least distance of obstacles: things that would overlap are left out


@dataclass(frozen=True)
class CarParkOptions:
    """What the car parks look like."""

    layouts: tuple[float, ...] = (0.06, 0.26, 0.14, 0.28, 0.26)  # shares, in the order of LAYOUTS
    row_length: Range = (18.0, 38.0)  # m
    raggedness: float = 3.0  # m, most the rows begin or end later than each other
    aisle: Range = (5.0, 7.5)  # m, width
    back_to_back: Range = (0.4, 1.5)  # m, between two rows
    walled: float = 0.6  # share of the rows' backs that have a kerb or a wall
    wall_gap: Range = (0.3, 0.7)  # m, between row and wall
    kerb: Range = (0.15, 0.35)  # m, thickness
    wall: Range = (0.5, 1.6)  # m, thickness
    bent: float = 0.3  # share of the walls that come forward at one end or both: L and U shapes
    closing: float = 0.3  # share of these ends that reach across the aisle
    clutter: int = 5  # most things that stand on an aisle
    clutter_radius: Range = (0.3, 0.9)  # m
    rim: Range = (0.0, 3.5)  # m, what the area is larger than the car park, on each side
    turn: Range = (-math.pi, math.pi)  # rad, the aisles against the map; half of the car parks are upright
    row: RowOptions = field(default_factory=RowOptions)
    vehicle: VehicleOptions = field(default_factory=VehicleOptions)


DEFAULT_OPTIONS = CarParkOptions()


def random_car_park(rng: np.random.Generator, options: CarParkOptions = DEFAULT_OPTIONS) -> Place:
    """A car park with at least one free slot for its vehicle."""
    return usable_place(lambda: _car_park(rng, random_vehicle(rng, options.vehicle), options))


@dataclass(eq=False)
class _Bands:
    """A car park while it is laid out upright: y grows from band to band."""

    walls: list[np.ndarray] = field(default_factory=list)
    cars: list[np.ndarray] = field(default_factory=list)
    things: list[np.ndarray] = field(default_factory=list)  # left out where they are in the way of the others
    slots: list[np.ndarray] = field(default_factory=list)  # (N, 3) each
    ground: list[np.ndarray] = field(default_factory=list)  # rings of aisles and rows


def _car_park(rng: np.random.Generator, vehicle: Vehicle, options: CarParkOptions) -> Place:
    bands = _laid_out(rng, vehicle, options)
    frame = np.array([0.0, 0.0, _turn(rng, options)])
    ground = moved(np.concatenate([*bands.ground, *bands.walls]), frame)
    low, high = ground.min(axis=0), ground.max(axis=0)
    below, above = rng.uniform(*options.rim, (2, 2))
    frame[:2] = below - low
    side = high - low + below + above
    area = (0.0, float(side[0]), 0.0, float(side[1]))
    rings = apart([moved(ring, frame) for ring in (*bands.walls, *bands.cars, *bands.things)], ABUTTING)
    slots = moved_poses(np.concatenate(bands.slots), frame)
    return place_with_slots("car_park", area, rings, slots, vehicle)


def _turn(rng: np.random.Generator, options: CarParkOptions) -> float:
    turn = rng.uniform(*options.turn)
    return round(turn / (math.pi / 2)) * math.pi / 2 if rng.uniform() < 0.5 else turn


def _laid_out(rng: np.random.Generator, vehicle: Vehicle, options: CarParkOptions) -> _Bands:
    layout = str(rng.choice(LAYOUTS, p=options.layouts))
    length = rng.uniform(*options.row_length)
    bands, y = _Bands(), 0.0
    for i, band in enumerate(layout):
        if band == "A":
            width = rng.uniform(*options.aisle)
            _add_aisle(rng, bands, (0.0, length, y, y + width), options)
            y += width
            continue
        if layout[i - 1 : i + 1] == "DU":
            y = _add_gap(rng, bands, length, y, options)
        begin, end = rng.uniform(0.0, options.raggedness, 2)
        row = random_row(rng, length - begin - end, vehicle, options.row)
        # a row that opens up is turned around: its frame's y runs down from the aisle
        frame = (begin, y, 0.0) if band == "D" else (begin + row.length, y + row.depth, math.pi)
        _add_row(rng, bands, row, frame, options)
        if "DU" not in (layout[i - 1 : i + 1], layout[i : i + 2]) and rng.uniform() < options.walled:
            bands.walls.append(moved(_wall(rng, row, options), frame))
        y += row.depth
    return bands


def _add_aisle(rng: np.random.Generator, bands: _Bands, aisle: Area, options: CarParkOptions) -> None:
    bands.ground.append(box(*aisle))
    for _ in range(int(rng.integers(options.clutter + 1))):
        x, y = rng.uniform(aisle[0::2], aisle[1::2])
        bands.things.append(moved(irregular(rng, options.clutter_radius), (x, y, rng.uniform(-math.pi, math.pi))))


def _add_gap(rng: np.random.Generator, bands: _Bands, length: float, y: float, options: CarParkOptions) -> float:
    """Leave room between two rows back to back, perhaps with a kerb in it; returns where the next row begins [m]."""
    gap = rng.uniform(*options.back_to_back)
    kerb = rng.uniform(*options.kerb)
    if rng.uniform() < options.walled and gap > kerb + 2 * options.wall_gap[0]:
        middle = y + gap / 2
        bands.walls.append(box(0.0, length, middle - kerb / 2, middle + kerb / 2))
    return y + gap


def _add_row(
    rng: np.random.Generator, bands: _Bands, row: Row, frame: tuple[float, float, float], options: CarParkOptions
) -> None:
    bands.ground.append(moved(box(0.0, row.length, 0.0, row.depth), frame))
    bands.cars += [moved(ring, frame) for ring in row.cars]
    bands.things += [moved(ring, frame) for ring in row.pillars]
    bands.slots.append(moved_poses(row.slots, frame))


def _wall(rng: np.random.Generator, row: Row, options: CarParkOptions) -> np.ndarray:
    """Ring of what stands behind a row, in the row's frame: a kerb or a wall, straight, L or U [m]."""
    thickness = rng.uniform(*(options.kerb if rng.uniform() < 0.5 else options.wall))
    overhang = rng.uniform(0.2, 1.0, 2)  # over the row's ends
    back, width = row.depth + rng.uniform(*options.wall_gap), row.length + overhang.sum()
    if rng.uniform() >= options.bent:
        return box(-overhang[0], width - overhang[0], back, back + thickness)
    left, right = (_arm(rng, back, options) for _ in range(2))
    shape = u_wall(width, (left, right), thickness) if rng.uniform() < 0.4 else l_wall(width, left, thickness)
    ring = moved(shape, (-overhang[0], back, 0.0))
    return ring if rng.uniform() < 0.5 else mirrored(ring) + np.array([row.length, 0.0])


def _arm(rng: np.random.Generator, back: float, options: CarParkOptions) -> float:
    """How far a wall comes forward from behind a row: along its end, or across the aisle [m]."""
    if rng.uniform() < options.closing:
        return back + rng.uniform(0.4, 0.95) * options.aisle[0]
    return rng.uniform(0.3, 1.0) * back
