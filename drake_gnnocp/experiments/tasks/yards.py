"""Random yards: dead ends, corridors, gates, docks, corners and containers on a piece of ground, and things between.

The large features come first, one after the other to where there is room; most keep the width of a gate away from
what stands already, so there is a way between them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import shapely

from drake_gnnocp.experiments.tasks.place import (
    Area,
    Place,
    VehicleOptions,
    place_with_slots,
    random_vehicle,
    usable_place,
)
from drake_gnnocp.experiments.tasks.shapes import Range, box, mirrored, moved, moved_poses
from drake_gnnocp.experiments.tasks.yard_features import LARGE, SMALL, Feature, FeatureOptions
from drake_gnnocp.vehicle import Vehicle

DRAWS = 20  # places tried for a feature before it is left out


@dataclass(frozen=True)
class YardOptions:
    """What the yards look like."""

    side: Range = (26.0, 44.0)  # m, of the rectangle that holds everything
    large: tuple[int, int] = (8, 18)  # features with a name, drawn; not all find room
    shares: tuple[float, ...] = (0.24, 0.15, 0.15, 0.14, 0.16, 0.16)  # of them, in the order of yard_features.LARGE
    small: tuple[int, int] = (5, 18)  # irregular polygons, pallets, poles
    small_shares: tuple[float, ...] = (0.4, 0.6)  # of them, in the order of yard_features.SMALL
    gap: Range = (2.4, 4.0)  # m, between features
    narrow: float = 0.2  # share of the features that come nearer
    narrow_gap: Range = (0.1, 2.4)  # m
    skew: float = 0.25  # share of the features that are not parallel to the others
    walled: float = 0.35  # share of the yard's four sides that have a wall, with a gap
    features: FeatureOptions = field(default_factory=FeatureOptions)
    vehicle: VehicleOptions = field(default_factory=VehicleOptions)


DEFAULT_OPTIONS = YardOptions()


def random_yard(rng: np.random.Generator, options: YardOptions = DEFAULT_OPTIONS) -> Place:
    """A yard with at least one slot for its vehicle."""
    return usable_place(lambda: _yard(rng, random_vehicle(rng, options.vehicle), options))


class _Ground:
    """The features that stand already, and the ground they need."""

    def __init__(self, area: Area) -> None:
        self.area = area
        self.rings: list[np.ndarray] = []
        self.slots: list[np.ndarray] = []
        self._taken: list[shapely.Polygon] = []

    def place(self, feature: Feature, frame: np.ndarray, gap: float) -> bool:
        """Put a feature there if it fits, a gap away from the others [m]."""
        corners = moved(box(*feature.ground), frame)
        if (corners < self.area[0::2]).any() or (corners > self.area[1::2]).any():
            return False
        polygon = shapely.Polygon(corners)
        if shapely.dwithin(polygon, np.array(self._taken, dtype=object), gap).any():
            return False
        self._taken.append(polygon)
        self.rings += [moved(ring, frame) for ring in feature.rings]
        if feature.slots:
            self.slots += list(moved_poses(np.array(feature.slots), frame))
        return True


def _yard(rng: np.random.Generator, vehicle: Vehicle, options: YardOptions) -> Place:
    width, height = rng.uniform(*options.side, 2)
    area = (0.0, float(width), 0.0, float(height))
    ground = _Ground(area)
    main = float(rng.uniform(-math.pi, math.pi)) if rng.uniform() < 0.5 else 0.0
    for makers, shares, (fewest, most) in (
        (LARGE, options.shares, options.large),
        (SMALL, options.small_shares, options.small),
    ):
        for _ in range(int(rng.integers(fewest, most + 1))):
            feature = makers[rng.choice(len(makers), p=shares)](rng, vehicle, options.features)
            _find_room(rng, ground, _mirrored(feature) if rng.uniform() < 0.5 else feature, main, options)
    rings = [*ground.rings, *_fence(rng, area, vehicle, options)]
    return place_with_slots("yard", area, rings, np.array(ground.slots).reshape(-1, 3), vehicle)


def _find_room(rng: np.random.Generator, ground: _Ground, feature: Feature, main: float, options: YardOptions) -> None:
    """Place a feature if there is room; `main` is the heading most of them have [rad]."""
    gap = rng.uniform(*(options.narrow_gap if rng.uniform() < options.narrow else options.gap))
    for _ in range(DRAWS):
        is_skew, quarter = rng.uniform() < options.skew, int(rng.integers(4))
        turn = rng.uniform(-math.pi, math.pi) if is_skew else main + quarter * math.pi / 2
        x, y = rng.uniform(ground.area[0::2], ground.area[1::2])
        if ground.place(feature, np.array([x, y, turn]), gap):
            return


def _mirrored(feature: Feature) -> Feature:
    xmin, xmax, ymin, ymax = feature.ground
    slots = tuple(np.array([-x, y, math.pi - theta]) for x, y, theta in feature.slots)
    return Feature(tuple(mirrored(ring) for ring in feature.rings), (-xmax, -xmin, ymin, ymax), slots)


def _fence(rng: np.random.Generator, area: Area, vehicle: Vehicle, options: YardOptions) -> list[np.ndarray]:
    """Walls around the yard, outside its area: some sides have none, the others a gate somewhere."""
    _, width, _, height = area
    rings = []
    sides = ((0.0, 0.0, 0.0, width), (width, 0.0, 1.0, height), (width, height, 2.0, width), (0.0, height, 3.0, height))
    for x, y, quarter, length in sides:
        if rng.uniform() >= options.walled:
            continue
        t = rng.uniform(*options.features.thickness)
        opening = max(rng.uniform(*options.features.gate), vehicle.width + 0.6)
        at = rng.uniform(0.1, 0.9) * (length - opening)
        frame = (x, y, quarter * math.pi / 2)
        rings += [moved(box(0.0, at, -t, 0.0), frame), moved(box(at + opening, length, -t, 0.0), frame)]
    return rings
