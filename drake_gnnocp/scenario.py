"""A planning task: start, goal, what stands in the way, optional bounds and vehicle."""

from __future__ import annotations

import json
import logging
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from pathlib import Path
from reprlib import repr as shown  # short, and shallow where the value is nested
from typing import Any, ClassVar

import numpy as np
import shapely

from drake_gnnocp import scenario_arrays as arrays
from drake_gnnocp.blocked import Blocked, outline_of
from drake_gnnocp.ends import GoalTolerance, Ground, Target
from drake_gnnocp.files import write_atomically
from drake_gnnocp.maps.grid_outlines import fields_of_grid, with_places
from drake_gnnocp.maps.occupancy_grid import MEANINGS, grid_of_cells
from drake_gnnocp.polygons import polygons_from
from drake_gnnocp.scenario_files import (
    BOUNDS,
    KEYS,
    MAP_SUFFIXES,
    REQUIRED_KEYS,
    ScenarioError,
    as_json,
    bundled_scenarios,
    checked_fields,
    path_of,
    pose_as_json,
    read_fields,
    with_ends,
)
from drake_gnnocp.shapes import Area, Shapes, shapes_of
from drake_gnnocp.vehicle import Vehicle

__all__ = ["Area", "Scenario", "ScenarioError", "bundled_scenarios"]

MOST_CLEARANCE = 100.0  # m, that can be asked for

DECIMALS = 10  # of lengths in a unit that is not the metre: a task at another scale is the same to the last bit then
COVER_TOLERANCE = 0.013  # of the car's length: what planners take obstacles of many vertices to be larger by
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

    Either a goal is given, or `goals` of which one is to be reached; a heading of None or NaN is free. Where there are
    several, or one with a free heading, `goals` are those as given, and `goal` is the first pose of them at which the
    car may stand: planners go for one pose at a time, see `aimed`.

    Raises:
        ScenarioError: a value is not of numbers, a polygon is not simple, or the car at the start or at all goals
            collides or leaves the bounds.
    """

    name: str
    start: np.ndarray  # (3,) x, y, theta
    goal: np.ndarray = field(default_factory=lambda: np.empty(0))  # (3,) x, y, theta; left out where there are goals
    obstacles: tuple[np.ndarray | Area, ...] = ()  # rings (N_j, 2), or rings with holes [m]
    bounds: tuple[float, float, float, float] | np.ndarray | None = None  # xmin, xmax, ymin, ymax, or a ring (N, 2) [m]
    vehicle: Vehicle = field(default_factory=Vehicle)
    clearance: float = 0.0  # m, kept to obstacles and bounds at all times, with the exemption of both ends
    lines: tuple[np.ndarray, ...] = ()  # polylines (N_j, 2) without thickness [m]
    points: np.ndarray = field(default_factory=lambda: np.empty((0, 3)))  # (K, 3) x, y, radius (may be 0) [m]
    goals: tuple[np.ndarray, ...] = ()  # (3,) x, y, theta; empty where `goal` is the only pose
    goal_tolerance: GoalTolerance | None = None  # how far from a goal a motion may end

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
        object.__setattr__(self, "start", arrays.pose("start", self.start))
        if fault := self._ground.fault(self.start):
            raise ScenarioError(f"start: {fault}")
        self._choose_goal()
        for which, pose in (("start", self.start), ("goal", self.goal)):
            if abs(pose[2]) > LARGEST_HEADING:
                logger.warning("%s: headings are in radians, and %g is many turns: are these degrees?", which, pose[2])

    def _choose_goal(self) -> None:
        """Set `goals` to what is given where that is not one pose, and `goal` to a pose at which the car may stand."""
        several = len(self.goals) > 1
        wanted = self.goals if len(self.goals) else (self.goal,)
        if np.shape(wanted[0]) == (0,):
            raise ScenarioError("goal: missing")
        given = tuple(arrays.pose(f"goals[{i}]" if several else "goal", goal, True) for i, goal in enumerate(wanted))
        same = [np.isnan(pose) | (pose == self.goal) for pose in given] if np.shape(self.goal) == (3,) else []
        if len(self.goals) and np.shape(self.goal) != (0,) and not any(is_same.all() for is_same in same):
            raise ScenarioError("goals: give either goal or goals, not both")
        object.__setattr__(self, "goals", given if several or np.isnan(given[0][2]) else ())
        object.__setattr__(self, "goal", given[0])
        faults = []
        for i, pose in enumerate(given):
            try:
                object.__setattr__(self, "goal", np.append(pose[:2], self.headings_at(i)[0]))
                return
            except ScenarioError as error:
                faults.append(str(error))
        raise ScenarioError(f"goals: the car can stand at none: {'; '.join(faults)}" if several else faults[0])

    def headings_at(self, which: int) -> np.ndarray:
        """Headings to plan to one of the goals with: (H,), its own, or where it is free those that the car may have.

        Raises:
            ScenarioError: the car at the goal collides or leaves the bounds.
        """
        headings, fault = self._ground.headings_at(self.targets[which], self.clearance)
        if fault:
            raise ScenarioError(f"{self.name_of_goal(which)}: {fault}")
        return headings

    def name_of_goal(self, which: int) -> str:
        """What one of the goals is called: "goal", or "goals[1]" where there are several."""
        return f"goals[{which}]" if len(self.goals) > 1 else "goal"

    @property
    def targets(self) -> tuple[Target, ...]:
        """Where a motion may end: (G,) all goals with the tolerance."""
        return tuple(Target(pose, self.goal_tolerance) for pose in self.goals or (self.goal,))

    def _convert(self) -> None:
        object.__setattr__(self, "clearance", float(arrays.doubles("clearance", self.clearance, "a number in m", ())))
        vertices = "a list of vertices [x, y]"
        areas = tuple(arrays.area(f"obstacles[{j}]", obstacle, vertices) for j, obstacle in enumerate(self.obstacles))
        object.__setattr__(self, "obstacles", areas)
        lines = tuple(arrays.doubles(f"lines[{j}]", line, vertices, (-1, 2)) for j, line in enumerate(self.lines))
        object.__setattr__(self, "lines", lines)
        object.__setattr__(self, "points", arrays.points(self.points))
        if self.bounds is not None:
            object.__setattr__(self, "bounds", arrays.bounds(self.bounds))
        if isinstance(self.goal_tolerance, Mapping):
            object.__setattr__(self, "goal_tolerance", GoalTolerance.from_dict(self.goal_tolerance))

    @cached_property
    def _ground(self) -> Ground:
        return Ground(self.vehicle, self.shapes, self.box)

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
        return outline_of(self.blocked, self.vehicle.width / 2)

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

    @property
    def as_planned(self) -> Scenario:
        """The same task as planners work on it: near the origin, in lengths of the car."""
        x0, y0, _ = self.start
        return self.translated(-x0, -y0).in_car_lengths

    @cached_property
    def in_car_lengths(self) -> Scenario:
        """The same task, near the origin, in a unit of length in which the car is as long as the default one.

        Planning in it makes plans of a task at another scale the same plans at that scale. Times stay as they are. It
        is checked in metres.
        """
        unit = self.vehicle.size
        if abs(unit - 1.0) < SAME_UNIT:
            return self
        scaled = self._mapped(lambda points: np.round(points / unit, DECIMALS))
        scaled.__dict__.update(
            vehicle=self.vehicle.scaled(1 / unit),
            clearance=self.clearance / unit,
            goal_tolerance=self.goal_tolerance and self.goal_tolerance.scaled(1 / unit),
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
            goals=tuple(np.append(change(goal[None, :2])[0], goal[2]) for goal in self.goals),
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
        other.__dict__.update({name: getattr(self, name) for name in known}, start=start, goal=goal, goals=())
        other._check_ends()
        return other

    def aimed(self, which: int, heading: float) -> Scenario:
        """The same scene with one of the goals alone, to be planned to with a heading [rad]."""
        given = self.targets[which].pose
        other = object.__new__(type(self))
        made: dict[str, Any] = {
            key: self.__dict__[key] for key in ("_blocked_anywhere", "unit") if key in self.__dict__
        }
        goal, goals = np.append(given[:2], heading), (given,) if np.isnan(given[2]) else ()
        other.__dict__.update({known.name: getattr(self, known.name) for known in fields(self)}, shapes=self.shapes)
        other.__dict__.update(made, goal=goal, goals=goals)
        return other

    @cached_property
    def exact(self) -> Scenario:
        """The same task with an end at `goal` exactly; itself where nothing else is allowed."""
        if not self.goals and self.targets[0].is_exact:
            return self
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__, goals=(), goal_tolerance=None)
        if self.unit != 1.0:
            other.__dict__.update(in_metres=self.in_metres.exact)
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
            made = with_ends(read_fields(path_of(source), unknown, layers), given)
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
        data = as_json({key: getattr(self, key) for key in KEYS if key != "goals"})
        if self.goals:
            data["goal"] = pose_as_json(self.goals[0])
        if len(self.goals) > 1:
            data |= {"goals": [pose_as_json(goal) for goal in self.goals]}
            del data["goal"]
        return {key: value for key, value in data.items() if key in REQUIRED_KEYS or value != []}

    def save(self, path: Path | str) -> None:
        """Write the scenario as JSON."""
        write_atomically(Path(path), json.dumps(self.to_dict(), indent=1) + "\n")
