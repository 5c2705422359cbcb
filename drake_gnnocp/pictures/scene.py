"""What a picture shows, in coordinates near zero.

Some maps use world coordinates of 1e9 m: their tick labels are unreadable, and WebGL's 32-bit floats resolve only 512 m
there. Everything is therefore drawn relative to an origin.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import shapely

from drake_gnnocp.ends import nearest_target
from drake_gnnocp.polygons import moved
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.trajectory import Trajectory

LEAST_ROOM, ROOM = 100.0, 2.0  # m, and of the larger side of the box around start and goal: drawn around it at most
FAR_AWAY = 1e4  # m, from here on tick labels have too many digits to read


def readable_origin(scenario: Scenario) -> np.ndarray:
    """The point (2,) to draw relative to: zero, or for far-away maps whole metres near the start [m]."""
    start = scenario.start[:2]
    return np.round(start) if np.abs(start).max() > FAR_AWAY else np.zeros(2)


def relative_bounds(scenario: Scenario, origin: np.ndarray) -> shapely.Polygon | None:
    """What is inside the bounds relative to an origin (2,) [m], None without bounds."""
    if isinstance(scenario.bounds, tuple):
        return shapely.box(*(np.reshape(scenario.bounds, (2, 2)).T - origin).ravel())
    return None if scenario.shapes.fence is None else moved(scenario.shapes.fence, -origin)


def relative_poses(poses: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """Poses (N, 3) or one (3,) relative to an origin (2,) [m, m, rad]."""
    return poses - np.append(origin, 0.0)


def goal_poses(scenario: Scenario, trajectory: Trajectory | None) -> tuple[np.ndarray, int | None]:
    """The goals as they are shown, and which of them a trajectory ends at or nearest to.

    Returns:
        (G, 3) poses; a free heading is that of the trajectory's end at the goal it ends at, and NaN at others. The
        index is None without a trajectory.
    """
    poses = np.stack([target.pose for target in scenario.targets])
    if trajectory is None or not np.isfinite(trajectory.poses[-1]).all():
        return poses, None
    end = trajectory.poses[-1]
    reached = nearest_target(scenario.targets, end)
    if np.isnan(poses[reached, 2]):
        poses[reached, 2] = end[2]
    return poses, reached


def extent(scenario: Scenario, trajectories: Iterable[Trajectory | None], origin: np.ndarray) -> np.ndarray:
    """The box around all that is drawn.

    Of what is far from start and goal, the near part is drawn. A failed attempt may run far away as well; it widens the
    box by at most the map's own size on each side.

    Returns:
        (2, 2) lower left and upper right corner relative to the origin [m].
    """
    poses = np.vstack([scenario.start, np.nan_to_num(goal_poses(scenario, None)[0])])
    ends = scenario.vehicle.footprints(relative_poses(poses, origin))
    points = [ends.reshape(-1, 2), shapely.get_coordinates(scenario.shapes.all) - origin]
    if (bounds := relative_bounds(scenario, origin)) is not None:
        points.append(shapely.get_coordinates(bounds))
    low, high = points[0].min(axis=0), points[0].max(axis=0)
    room = max(LEAST_ROOM, ROOM * float((high - low).max()))
    fixed = np.concatenate(points).clip(low - room, high + room)
    low, high = fixed.min(axis=0), fixed.max(axis=0)
    size = high - low
    shown = [fixed]
    for trajectory in trajectories:
        if trajectory is not None:
            swept = scenario.vehicle.footprints(relative_poses(trajectory.poses, origin)).reshape(-1, 2)
            shown.append(np.clip(swept[np.isfinite(swept).all(axis=1)], low - size, high + size))
    drawn = np.concatenate(shown)
    return np.stack([drawn.min(axis=0), drawn.max(axis=0)])
