"""How far it is to several poses: what tells which of them to plan to first."""

from __future__ import annotations

import numpy as np

from drake_gnnocp.budget import Budget
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.search.arena import CELL_COUNTS, distance_field
from drake_gnnocp.search.heuristic import HolonomicHeuristic
from drake_gnnocp.search.reeds_shepp import path_length
from drake_gnnocp.search.regions import search_regions


def ways(scenario: Scenario, poses: np.ndarray, budget: Budget) -> np.ndarray:
    """Lengths of the ways from the start to poses: the larger of both heuristics of Hybrid A*.

    Args:
        scenario: the scene and its start, near the origin.
        poses: (C, 3) [m, m, rad].
        budget: where it ends early, lengths are too large.

    Returns:
        (C,), infinite where there is none [m].
    """
    vehicle, region = scenario.vehicle, search_regions(scenario, poses)[-1]
    field = distance_field(scenario.convex_obstacles, vehicle, region, CELL_COUNTS[0], scenario.clearance)
    among_obstacles = HolonomicHeuristic.of(field, vehicle, scenario.start, budget).at(poses[:, 0], poses[:, 1])
    curves = [path_length(tuple(scenario.start), pose, vehicle.turning_radius) for pose in poses]
    return np.maximum(curves, among_obstacles)
