"""Where to search: first around start and goal, where nearly all paths stay, then the whole map."""

from __future__ import annotations

import numpy as np
import shapely

from drake_gnnocp.scenario import Scenario
from drake_gnnocp.search.collision import Box

ROOM = 10.0  # m, least free space around start, goal and obstacles that is searched where there are no bounds
DETOUR = 30.0  # m, around the box of start and goal: the surroundings, searched first
LONGEST_DETOUR = 500.0  # m, no search goes further than this from that box, whatever bounds and obstacles say


def search_regions(scenario: Scenario, goals: np.ndarray | None = None) -> list[Box]:
    """The rectangles that are searched in turn, each xmin, xmax, ymin, ymax [m].

    The first is the surroundings of start and goal, which a far obstacle does not enlarge. Where the whole map is
    larger, it is the second: the box around all obstacles and ends with room for the car to turn, within the bounds.

    Args:
        scenario: the task.
        goals: (G, 3) poses in the place of its goal [m, m, rad].
    """
    vehicle = scenario.vehicle
    goals = scenario.goal[None] if goals is None else goals
    ends = vehicle.footprints(np.vstack([scenario.start, goals])).reshape(-1, 2)
    everything = np.concatenate([ends, shapely.get_coordinates(scenario.polygons)])
    room = max(ROOM, 2.0 * vehicle.turning_radius + vehicle.length)
    low, high = everything.min(axis=0) - room, everything.max(axis=0) + room
    surroundings = _clipped(scenario, ends, DETOUR, low, high)
    whole_map = _clipped(scenario, ends, LONGEST_DETOUR, low, high)
    return [surroundings] if surroundings == whole_map else [surroundings, whole_map]


def _clipped(scenario: Scenario, ends: np.ndarray, detour: float, low: np.ndarray, high: np.ndarray) -> Box:
    """The box from low to high (2,), no further than `detour` from the ends (N, 2) and within the bounds [m]."""
    low = np.maximum(low, ends.min(axis=0) - detour)
    high = np.minimum(high, ends.max(axis=0) + detour)
    if scenario.box is not None:
        low = np.maximum(low, scenario.box[0::2])
        high = np.minimum(high, scenario.box[1::2])
    return float(low[0]), float(high[0]), float(low[1]), float(high[1])
