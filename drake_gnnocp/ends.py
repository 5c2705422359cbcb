r"""Where a motion may start and end: poses at which a car may stand, goals with a tolerance, headings that are free.

A goal is a pose; its heading may be free (NaN here, null in JSON). With a tolerance (t_x, t_y, t_theta) the car has
reached a goal (x_g, y_g, theta_g) at any pose (x, y, theta) with

    |dx| <= t_x,    |dy| <= t_y,    |theta - theta_g| <= t_theta (but for full turns),

dx and dy being the components of (x - x_g, y - y_g) along the goal's heading and to its left. Where the heading is
free, dx and dy are those along the scenario's x and y, and any theta does.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from reprlib import repr as shown
from typing import Any

import numpy as np
import shapely

from drake_gnnocp.shapes import Shapes
from drake_gnnocp.vehicle import Vehicle

COORDINATE_TOLERANCE = 1e-9  # m: a car this near an obstacle touches it, one this far over the bounds is inside them
MOST_TOLERANCE = 100.0  # m, that can be given
HEADINGS = 360  # that are looked at where a heading is free
APART = 15  # of these: headings that are no farther apart lead to the same plans, since the optimiser turns them ...
FEWEST = 3  # ... mostly: where there is less room, there are still so many

Box = tuple[float, float, float, float]  # xmin, xmax, ymin, ymax [m]


@dataclass(frozen=True)
class GoalTolerance:
    """How far from a goal a motion may end, in the goal's frame.

    Raises:
        ValueError: a value is not a number of its range; the message names it.
    """

    x: float = 0.0  # m, along the heading of the car at the goal; where that is free, along the scenario's x
    y: float = 0.0  # m, to its left and right; where the heading is free, along the scenario's y
    heading: float = 0.0  # rad

    def __post_init__(self) -> None:
        for name, value in self.to_dict().items():
            most, unit = (math.pi, "rad") if name == "heading" else (MOST_TOLERANCE, "m")
            is_number = isinstance(value, int | float) and not isinstance(value, bool)
            if not is_number or not 0 <= value <= most:  # NaN as well
                raise ValueError(f"goal_tolerance.{name}: must be 0 to {most:.3g} {unit}, not {shown(value)}")

    @classmethod
    def from_dict(cls, data: Any) -> GoalTolerance:
        """The tolerance in the keys of the JSON format; what is left out is 0.

        Raises:
            ValueError: an unknown key or an illegal value; the message names it.
        """
        allowed = [field.name for field in fields(cls)]
        if not isinstance(data, Mapping):
            raise ValueError(f"goal_tolerance: must be an object with {', '.join(allowed)}, not {shown(data)}")
        for key in data:
            if key not in allowed:
                raise ValueError(f"goal_tolerance.{key}: unknown key; allowed are {', '.join(allowed)}")
        return cls(**data)

    def to_dict(self) -> dict[str, float]:
        """The tolerance in the keys of the JSON format."""
        return asdict(self)

    def scaled(self, factor: float) -> GoalTolerance:
        """The tolerance with lengths that are so many times as large."""
        return GoalTolerance(min(self.x * factor, MOST_TOLERANCE), min(self.y * factor, MOST_TOLERANCE), self.heading)


@dataclass(frozen=True, eq=False)
class Target:
    """Where a motion may end: a goal with its tolerance."""

    pose: np.ndarray  # (3,) x, y, theta; NaN where the heading is free [m, m, rad]
    tolerance: GoalTolerance | None = None

    @property
    def is_free(self) -> bool:
        """Whether any heading does."""
        return math.isnan(self.pose[2])

    @property
    def is_exact(self) -> bool:
        """Whether there is one pose alone."""
        return not self.is_free and self.half_sizes.max() == 0

    @property
    def half_sizes(self) -> np.ndarray:
        """How much dx, dy and the heading may differ: (3,), infinite where the heading is free [m, m, rad]."""
        allowed = self.tolerance or GoalTolerance()
        return np.array([allowed.x, allowed.y, math.inf if self.is_free else allowed.heading])

    @property
    def axes(self) -> np.ndarray:
        """The unit vectors along which dx and dy are measured: (2, 2), a row each."""
        theta = 0.0 if self.is_free or self.tolerance is None else float(self.pose[2])
        return np.array([[math.cos(theta), math.sin(theta)], [-math.sin(theta), math.cos(theta)]])

    def offset(self, pose: np.ndarray) -> np.ndarray:
        """The differences dx, dy and of the heading of a pose (3,): (3,) [m, m, rad]."""
        turn = 0.0 if self.is_free else math.remainder(pose[2] - self.pose[2], 2 * math.pi)
        return np.append(self.axes @ (pose[:2] - self.pose[:2]), turn)

    def excess(self, pose: np.ndarray) -> np.ndarray:
        """By how much a pose (3,) is beyond what is allowed: (3,) with signs, 0 within [m, m, rad]."""
        offset = self.offset(pose)
        half = self.half_sizes
        return offset - np.clip(offset, -half, half)


def nearest_target(targets: tuple[Target, ...], pose: np.ndarray) -> int:
    """Index of the target that a pose (3,) is the least beyond, the first of equals; a radian counts as a metre."""
    beyond = [float(np.abs(target.excess(pose)).max()) for target in targets]
    return beyond.index(min(beyond))


@dataclass(frozen=True, eq=False)
class Ground:
    """Where a car may stand."""

    vehicle: Vehicle
    shapes: Shapes
    box: Box | None  # around the bounds

    def fault(self, pose: np.ndarray) -> str:
        """What keeps the car from standing at a pose (3,); empty where nothing does."""
        footprint = self.vehicle.footprints(pose - np.append(pose[:2], 0.0))[0]  # in a frame that moves with the car
        if self.box is not None:
            low, high = np.reshape(self.box, (2, 2)).T - pose[:2]
            if (footprint < low - COORDINATE_TOLERANCE).any() or (footprint > high + COORDINATE_TOLERANCE).any():
                return f"the car leaves the bounds {list(self.box)}"
        car = shapely.Polygon(footprint + pose[:2])
        if self.shapes.fence is not None and not self.shapes.fence.contains_properly(car):
            return "the car leaves the bounds, or touches them"
        seen = self.shapes.near(car, COORDINATE_TOLERANCE).mapped(lambda points: points - pose[:2])
        touched = seen.touched_by(shapely.Polygon(footprint), COORDINATE_TOLERANCE)
        return "" if touched is None else f"the car collides with {touched}"

    def room(self, poses: np.ndarray) -> np.ndarray:
        """Distances of the car at poses (N, 3) to obstacles and bounds: (N,), 0 where it cannot stand [m]."""
        footprints = self.vehicle.footprints(poses)
        cars = np.atleast_1d(shapely.polygons(footprints))
        room = self.shapes.distances(cars)
        if self.shapes.fence is not None:
            room = np.where(shapely.contains_properly(self.shapes.fence, cars), room, 0.0)
        elif self.box is not None:
            low, high = np.reshape(self.box, (2, 2)).T
            inside = np.minimum(footprints.min(axis=1) - low, high - footprints.max(axis=1)).min(axis=1)
            # bounds may be touched, but then nothing is left of a clearance
            inside = np.where(inside >= -COORDINATE_TOLERANCE, np.maximum(inside, 2 * COORDINATE_TOLERANCE), 0.0)
            room = np.minimum(room, inside)
        return np.where(room > COORDINATE_TOLERANCE, room, 0.0)

    def headings_at(self, target: Target, clearance: float) -> tuple[np.ndarray, str]:
        """Headings (H,) in which the car may stand at a target [rad], and what keeps it from that where there is none.

        One that is free has the clearance [m] that is asked for, or the most that the place has.
        """
        if not target.is_free:
            return target.pose[2:], self.fault(target.pose)
        found = self._free_headings(target.pose[:2], clearance)
        return found, "" if len(found) else "the car collides or leaves the bounds in all headings"

    def _free_headings(self, place: np.ndarray, clearance: float) -> np.ndarray:
        """Some of the headings that do at a place (2,), so that any other one is not far from them: (H,) [rad]."""
        room = self.room(poses_around(place))
        is_free = (room > 0) & (room >= min(clearance, float(room.max())))
        if is_free.all():
            return headings()[::APART]
        first = int(is_free.argmin())  # begin where a run ends
        order = np.roll(np.arange(HEADINGS), -first)
        runs = np.split(order, np.flatnonzero(np.diff(is_free[order])) + 1)
        chosen = [
            int(part[len(part) // 2])
            for run in runs
            if is_free[run[0]]
            for part in np.array_split(run, max(min(FEWEST, len(run)), round(len(run) / APART)))
        ]
        return headings()[sorted(chosen)]


def headings() -> np.ndarray:
    """The headings that are looked at where a heading is free: (HEADINGS,) above -pi and up to pi [rad]."""
    degrees = np.arange(HEADINGS) - HEADINGS // 2 + 1
    return np.radians(np.roll(degrees, HEADINGS // 2 + 1) * (360 / HEADINGS))


def poses_around(place: np.ndarray) -> np.ndarray:
    """A place (2,) with all `headings`: (HEADINGS, 3) [m, m, rad]."""
    return np.column_stack([np.tile(place, (HEADINGS, 1)), headings()])
