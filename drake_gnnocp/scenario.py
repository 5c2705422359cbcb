"""A planning task: start, goal, what stands in the way, optional bounds and vehicle."""

from __future__ import annotations

import json
import logging
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from pathlib import Path
from reprlib import repr as shown  # short, and shallow where the value is nested
from typing import Any, ClassVar

import numpy as np
import shapely

from drake_gnnocp.blocked import Blocked
from drake_gnnocp.files import write_atomically
from drake_gnnocp.maps.grid_outlines import fields_of_grid, with_places
from drake_gnnocp.maps.occupancy_grid import MEANINGS, grid_of_cells
from drake_gnnocp.polygons import polygons_from
from drake_gnnocp.scenario_files import (
    BOUNDS,
    KEYS,
    MAP_SUFFIXES,
    POSE,
    REQUIRED_KEYS,
    ScenarioError,
    as_json,
    bundled_scenarios,
    checked_fields,
    path_of,
    read_fields,
    with_ends,
)
from drake_gnnocp.shapes import Area, Shapes, shapes_of
from drake_gnnocp.vehicle import Vehicle

__all__ = ["Area", "Scenario", "ScenarioError", "bundled_scenarios"]

MOST_CLEARANCE = 100.0  # m, that can be asked for
COORDINATE_TOLERANCE = 1e-9  # m: a car this near an obstacle touches it, one this far over the bounds is inside them

DECIMALS = 10  # of lengths in a unit that is not the metre: a task at another scale is the same to the last bit then
COVER_TOLERANCE = 0.013  # of the car's length: what planners take obstacles of many vertices to be larger by
# of all obstacles together: the outline of more is made simpler, by this share of the gaps that are filled
MOST_CORNERS, SIMPLER = 3000, 0.3
SAME_UNIT = 1e-9  # relative: units this near are the same
LARGEST_HEADING = 20 * math.pi  # rad, larger ones may have been meant in degrees

logger = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Scenario:
    """One planning task. Coordinates in m, headings in rad; poses are those of the middle of the rear axle.

    Start, goal, rings and bounds may be given as lists; they are kept as arrays of doubles (a box as a tuple). Rings
    (N, 2) are not closed, of either orientation, convex or not; one without area is taken as a line. Bounds are a box
    or a ring: the whole footprint stays inside.

    The clearance is asked of the whole motion, except near an end that leaves less itself: as long as the middle of the
    rear axle is within one length of the car from the start (goal), no more is asked than what the car has there.

    Raises:
        ScenarioError: a value is not of numbers, a polygon is not simple, or the car at start or goal collides or
            leaves the bounds.
    """

    name: str
    start: np.ndarray  # (3,) x, y, theta
    goal: np.ndarray  # (3,) x, y, theta
    obstacles: tuple[np.ndarray | Area, ...] = ()  # rings (N_j, 2), or rings with holes [m]
    bounds: tuple[float, float, float, float] | np.ndarray | None = None  # xmin, xmax, ymin, ymax, or a ring (N, 2) [m]
    vehicle: Vehicle = field(default_factory=Vehicle)
    clearance: float = 0.0  # m, kept to obstacles and bounds at all times, with the exemption of both ends
    lines: tuple[np.ndarray, ...] = ()  # polylines (N_j, 2) without thickness [m]
    points: np.ndarray = field(default_factory=lambda: np.empty((0, 3)))  # (K, 3) x, y, radius (may be 0) [m]

    unit: ClassVar[float] = 1.0  # m, what a length of 1 stands for, see `in_car_lengths`

    def __post_init__(self) -> None:
        self._convert()
        _ = self.shapes  # raises where an obstacle is none
        if isinstance(self.bounds, tuple) and not (self.bounds[0] < self.bounds[1] and self.bounds[2] < self.bounds[3]):
            raise ScenarioError(f"bounds: must be [{BOUNDS}] with min < max, not {list(self.bounds)}")
        if not 0 <= self.clearance <= MOST_CLEARANCE:
            raise ScenarioError(f"clearance: must be 0 to {MOST_CLEARANCE:g} m, not {shown(self.clearance)}")
        self._check_ends()

    def _check_ends(self) -> None:
        for which in ("start", "goal"):
            pose = _doubles(which, getattr(self, which), f"3 finite numbers [{POSE}]", (3,))
            object.__setattr__(self, which, pose)
            self._check_pose(which, pose)
        for which, pose in (("start", self.start), ("goal", self.goal)):
            if abs(pose[2]) > LARGEST_HEADING:
                logger.warning("%s: headings are in radians, and %g is many turns: are these degrees?", which, pose[2])

    def _convert(self) -> None:
        object.__setattr__(self, "clearance", float(_doubles("clearance", self.clearance, "a number in m", ())))
        vertices = "a list of vertices [x, y]"
        areas = tuple(_area(f"obstacles[{j}]", obstacle, vertices) for j, obstacle in enumerate(self.obstacles))
        object.__setattr__(self, "obstacles", areas)
        lines = tuple(_doubles(f"lines[{j}]", line, vertices, (-1, 2)) for j, line in enumerate(self.lines))
        object.__setattr__(self, "lines", lines)
        object.__setattr__(self, "points", _points(self.points))
        if self.bounds is not None:
            object.__setattr__(self, "bounds", _bounds(self.bounds))

    def _check_pose(self, which: str, pose: np.ndarray) -> None:
        if not np.isfinite(pose).all():
            raise ScenarioError(f"{which}: must be 3 finite numbers [{POSE}], not {pose}")
        footprint = self.vehicle.footprints(pose - np.append(pose[:2], 0.0))[0]  # in a frame that moves with the car
        if self.box is not None:
            low, high = np.reshape(self.box, (2, 2)).T - pose[:2]
            if (footprint < low - COORDINATE_TOLERANCE).any() or (footprint > high + COORDINATE_TOLERANCE).any():
                raise ScenarioError(f"{which}: the car leaves the bounds {list(self.box)}")
        car = shapely.Polygon(footprint + pose[:2])
        if self.shapes.fence is not None and not self.shapes.fence.contains_properly(car):
            raise ScenarioError(f"{which}: the car leaves the bounds, or touches them")
        seen = self.shapes.near(car, COORDINATE_TOLERANCE).mapped(lambda points: points - pose[:2])
        if (touched := seen.touched_by(shapely.Polygon(footprint), COORDINATE_TOLERANCE)) is not None:
            raise ScenarioError(f"{which}: the car collides with {touched}")

    @cached_property
    def shapes(self) -> Shapes:
        """What stands in the way, exactly."""
        try:
            fence = self.bounds if isinstance(self.bounds, np.ndarray) else None
            return shapes_of(self.obstacles, self.lines, self.points, fence)
        except ValueError as error:
            raise ScenarioError(str(error)) from None

    @property
    def box(self) -> tuple[float, float, float, float] | None:
        """The bounds, or the box around them where they are a ring: xmin, xmax, ymin, ymax [m]."""
        if not isinstance(self.bounds, np.ndarray):
            return self.bounds
        (xmin, ymin), (xmax, ymax) = self.bounds.min(axis=0).tolist(), self.bounds.max(axis=0).tolist()
        return xmin, xmax, ymin, ymax

    @property
    def polygons(self) -> np.ndarray:
        """What stands in the way as simple polygons: (P,); lines are as thick as a hair, a fence is a frame."""
        return self.shapes.areas

    @cached_property
    def centroids(self) -> np.ndarray:
        """Geometric centres of the obstacles: (J, 2) [m]."""
        return shapely.get_coordinates(shapely.centroid(self.polygons))

    @cached_property
    def _blocked_anywhere(self) -> Blocked:
        return Blocked.of(self.polygons, COVER_TOLERANCE * self.vehicle.length)

    @cached_property
    def _blocked(self) -> Blocked:
        return self._blocked_anywhere.exact_near(self._cars, COVER_TOLERANCE * self.vehicle.length)

    @property
    def blocked(self) -> np.ndarray:
        """The region that the obstacles cover, however they are cut: polygons (B,) that do not touch, holes possible.

        Outlines of many vertices are a little outside, but not near start and goal.
        """
        return self._blocked.covers

    @property
    def blocked_exactly(self) -> np.ndarray:
        """The same region exactly: polygons (B,)."""
        return self._blocked.polygons

    @cached_property
    def without_covers(self) -> Scenario | None:
        """The same task, planned in the region exactly; None where it is anyway."""
        if not self._blocked.is_larger.any():
            return None
        exact = self._mapped(lambda points: points)
        exact.__dict__.update(_blocked=self._blocked.exactly, unit=self.unit, in_metres=self.in_metres)
        return exact

    @cached_property
    def _cars(self) -> np.ndarray:
        """The car at start and goal: (2,) polygons."""
        return np.asarray(shapely.polygons(self.vehicle.footprints(np.stack([self.start, self.goal]))))

    @cached_property
    def outline(self) -> shapely.MultiLineString:
        """The outline of `blocked`, with gaps that are narrower than half the car filled."""
        gap = self.vehicle.width / 4
        blocked, union = self.blocked, shapely.union_all
        if shapely.get_num_coordinates(blocked).sum() > MOST_CORNERS:
            blocked, union = shapely.simplify(blocked, gap * SIMPLER), shapely.disjoint_subset_union_all
        grown = union(shapely.buffer(blocked, gap, join_style="mitre"))
        with np.errstate(divide="ignore", invalid="ignore"):  # GEOS divides by zero at some corners, and copes
            filled = shapely.buffer(shapely.get_parts(grown), -gap, join_style="mitre")
        rings = shapely.get_rings(shapely.get_parts(shapely.normalize(filled)))
        return shapely.MultiLineString([shapely.LineString(ring) for ring in rings])

    @cached_property
    def convex_obstacles(self) -> tuple[np.ndarray, ...]:
        """Convex rings (M, 2), counter-clockwise, that cover the obstacles [m]."""
        return tuple(part for parts in self._blocked.parts for part in parts)

    @cached_property
    def convex_polygons(self) -> np.ndarray:
        """The rings of `convex_obstacles`, in their order, as polygons: (J,)."""
        return polygons_from(self.convex_obstacles)

    @cached_property
    def end_clearances(self) -> np.ndarray:
        """Distances of the `convex_obstacles` from the car at start and goal, the smaller of the two: (J,) [m]."""
        return shapely.distance(self.convex_polygons[:, None], self._cars).min(axis=1)

    @cached_property
    def nearest_at_ends(self) -> np.ndarray:
        """Distances of the car at start and goal from the nearest obstacle: (2,), infinite without one [m]."""
        return self.shapes.distances(self._cars)

    def translated(self, dx: float, dy: float) -> Scenario:
        """The same task moved by (dx, dy) [m].

        Planners work near the origin: maps in world coordinates of 1e9 m would cost them all their digits. What was
        checked is not checked again: rounding could close a gap of a few nanometres, or push a car over the bounds.
        """
        offset = np.array([dx, dy])
        return self._mapped(lambda points: points + offset)

    @cached_property
    def in_car_lengths(self) -> Scenario:
        """The same task, near the origin, in a unit of length in which the car is as long as the default one.

        Planning in it makes plans of a task at another scale the same plans at that scale. Times stay as they are. It
        is checked in metres.
        """
        unit = self.vehicle.length / Vehicle().length
        if abs(unit - 1.0) < SAME_UNIT:
            return self
        scaled = self._mapped(lambda points: np.round(points / unit, DECIMALS))
        scaled.__dict__.update(
            vehicle=self.vehicle.scaled(1 / unit),
            clearance=self.clearance / unit,
            points=self.points / (unit, unit, unit),
            unit=unit,
            in_metres=self,
        )
        return scaled

    @cached_property
    def in_metres(self) -> Scenario:
        """The task that `in_car_lengths` was made of."""
        return self

    def _mapped(self, change: Callable[[np.ndarray], np.ndarray]) -> Scenario:
        """The task with other coordinates, which `change` gives for coordinates (N, 2)."""
        mapped, bounds = object.__new__(type(self)), self.bounds
        if isinstance(bounds, np.ndarray):
            bounds = change(bounds)
        elif bounds is not None:
            bounds = tuple(change(np.reshape(bounds, (2, 2)).T).T.ravel().tolist())
        mapped.__dict__.update(
            {known.name: getattr(self, known.name) for known in fields(self)},
            start=np.append(change(self.start[None, :2])[0], self.start[2]),
            goal=np.append(change(self.goal[None, :2])[0], self.goal[2]),
            obstacles=tuple(
                change(obstacle)
                if isinstance(obstacle, np.ndarray)
                else Area(change(obstacle.ring), tuple(change(hole) for hole in obstacle.holes))
                for obstacle in self.obstacles
            ),
            lines=tuple(change(line) for line in self.lines),
            points=np.column_stack([change(self.points[:, :2]), self.points[:, 2]]),
            bounds=bounds,
            shapes=self.shapes.mapped(change),
            _blocked=self._blocked.mapped(change),
        )
        return mapped

    def between(self, start: Any, goal: Any) -> Scenario:
        """The same scene with another start and goal (3,): what was made of its obstacles is not made again.

        Raises:
            ScenarioError: the car at start or goal collides or leaves the bounds.
        """
        other = object.__new__(type(self))
        known = (*(known.name for known in fields(self)), "shapes", "_blocked_anywhere")
        other.__dict__.update({name: getattr(self, name) for name in known}, start=start, goal=goal)
        other._check_ends()
        return other

    @classmethod
    def load(
        cls, source: str | Path, *, unknown: str = MEANINGS[0], layers: Sequence[str] = (), **changes: Any
    ) -> Scenario:
        """Read a scenario: a bundled one, a file that describes one, a drawing, or an occupancy map.

        Args:
            source: the name of a bundled one, or a path; its suffix is one of `scenario_files.SUFFIXES`.
            unknown: what unknown cells of an occupancy map are taken for: "occupied" or "free".
            layers: of a DXF drawing: only what is on these is an obstacle.
            changes: fields (start, goal, vehicle, ...) that take the places of the file's where they are not None. A
                map has no start and goal, and a drawing may have none.

        Raises:
            ScenarioError: the file is missing or unreadable, or what it says cannot be planned.
        """
        given = {key: value for key, value in changes.items() if value is not None}
        made: dict[str, Any] = {}
        try:
            made = with_ends(read_fields(path_of(source), unknown, layers) | given)
            return cls(**made)
        except ValueError as error:
            is_map = Path(source).suffix.lower() in MAP_SUFFIXES
            said = with_places(str(error), made, unknown) if is_map else str(error)
            raise ScenarioError(f"{str(source) or repr('')}: {said}") from None

    @classmethod
    def from_occupancy(
        cls, cells: Any, resolution: float, origin: Any, start: Any, goal: Any, *, name: str = "map", **others: Any
    ) -> Scenario:
        """Build a scenario from the cells of an occupancy grid, whose rectangle is the bounds.

        Args:
            cells: (ny, nx), row 0 is the lowest: bools, or -1 (unknown) and 0 to 100 per cent as in an OccupancyGrid.
            resolution: length of a cell's side [m].
            origin: x, y, yaw of the lower left corner of the lower left cell [m, m, rad]; the yaw may be left out.
            start: x, y, theta [m, m, rad].
            goal: x, y, theta [m, m, rad].
            name: of the scenario.
            others: fields (vehicle, clearance, ...), and those of `grid_of_cells`: unknown ("occupied", or "free"),
                occupied_thresh (0.65: cells of 65 per cent are occupied, as for map_saver).

        Raises:
            ScenarioError: a value is illegal, or the car at start or goal collides or leaves the grid.
        """
        options = {key: others.pop(key) for key in ("unknown", "occupied_thresh") if key in others}
        made: dict[str, Any] = {}
        try:
            found = fields_of_grid(grid_of_cells(cells, resolution, origin, **options))
            made = {"name": name, "start": start, "goal": goal, **found, **others}
            return cls(**made)
        except ValueError as error:
            raise ScenarioError(with_places(str(error), made, options.get("unknown", MEANINGS[0]))) from None

    @classmethod
    def from_dict(cls, data: Any) -> Scenario:
        """Build a scenario from the keys of the JSON format.

        Raises:
            ScenarioError: a key is missing, unknown or has an illegal value; the message names it.
        """
        return cls(**checked_fields(data))

    def to_dict(self) -> dict[str, Any]:
        """The scenario in the keys of the JSON format; `from_dict` gives it back exactly."""
        data = as_json({key: getattr(self, key) for key in KEYS})
        return {key: value for key, value in data.items() if key in REQUIRED_KEYS or value != []}

    def save(self, path: Path | str) -> None:
        """Write the scenario as JSON."""
        write_atomically(Path(path), json.dumps(self.to_dict(), indent=1) + "\n")


def _doubles(what: str, value: Any, meaning: str, shape: tuple[int, ...]) -> np.ndarray:
    """Doubles of a shape, in which -1 stands for any number."""
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):  # texts, or rows of different lengths
        array = np.empty(())
    if array.ndim != len(shape) or any(n not in (-1, size) for n, size in zip(shape, array.shape, strict=True)):
        raise ScenarioError(f"{what}: must be {meaning}, not {shown(value)}")
    return array


def _area(what: str, value: Any, meaning: str) -> np.ndarray | Area:
    if not isinstance(value, Area):
        return _doubles(what, value, meaning, (-1, 2))
    holes = (_doubles(f"{what}.holes[{k}]", hole, meaning, (-1, 2)) for k, hole in enumerate(value.holes))
    return Area(_doubles(what, value.ring, meaning, (-1, 2)), tuple(holes))


def _points(value: Any) -> np.ndarray:
    if not len(value):
        return np.empty((0, 3))
    points = _doubles("points", value, "a list of [x, y, r]", (-1, 3))
    if not (np.isfinite(points).all() and (points[:, 2] >= 0).all()):
        raise ScenarioError("points: must be finite, with a radius of 0 or more")
    return points


def _bounds(value: Any) -> tuple[float, float, float, float] | np.ndarray:
    """A box as a tuple, also where it is given as a ring; another ring as an array."""
    if np.ndim(value) == 1:
        xmin, xmax, ymin, ymax = _doubles("bounds", value, f"4 numbers [{BOUNDS}], or a ring", (4,)).tolist()
        return xmin, xmax, ymin, ymax
    ring = _doubles("bounds", value, f"4 numbers [{BOUNDS}], or a list of at least 3 vertices [x, y]", (-1, 2))
    if not len(ring) or not np.isfinite(ring).all():
        raise ScenarioError("bounds: must be finite vertices [x, y]")
    (xmin, ymin), (xmax, ymax) = ring.min(axis=0).tolist(), ring.max(axis=0).tolist()
    box = shapely.box(xmin, ymin, xmax, ymax)
    is_box = len(ring) in (4, 5) and bool(shapely.Polygon(ring).equals(box))
    return (xmin, xmax, ymin, ymax) if is_box else ring
