"""The cheapest collision-free Reeds-Shepp path between two poses, by the costs of the search instead of its length."""

from __future__ import annotations

import bisect
from collections.abc import Callable

import numpy as np

from drake_gnnocp.search.collision import FootprintTest
from drake_gnnocp.search.moves import Move, length_of, poses_along
from drake_gnnocp.search.reeds_shepp import all_paths

SPARSE = 1.0  # m, spacing of the poses that are tested first, which tell of most paths that collide
MOST_POSES = 500_000  # along a path that is tested: longer ones, of many kilometres, are not looked at


def connect(
    start: np.ndarray,
    end: np.ndarray,
    turning_radius: float,
    test: FootprintTest,
    cost_of: Callable[[list[Move]], float],
    limit: float,
    candidates: int,
) -> tuple[float, list[Move]] | None:
    """Connect two poses.

    Args:
        start: (3,) x, y, theta [m, m, rad].
        end: (3,) x, y, theta [m, m, rad].
        turning_radius: of all arcs [m].
        test: the collision test.
        cost_of: cost of moves, no less than their length [m].
        limit: dearer paths are of no interest [m].
        candidates: so many of the cheapest paths are tested for collisions.

    Returns:
        The cost and the moves of the cheapest free path among the candidates, None if there is none.
    """
    choices: list[tuple[float, int, list[Move]]] = []  # sorted; the counter keeps equal costs in the order they came
    for moves in all_paths(start, end, turning_radius):
        dearest = limit if len(choices) < candidates else choices[candidates - 1][0]
        if length_of(moves) >= dearest:  # they come shortest first
            break
        cost = cost_of(moves)
        if cost < dearest and length_of(moves) < MOST_POSES * test.spacing:
            bisect.insort(choices, (cost, len(choices), moves))
    del choices[candidates:]
    sparse = [poses_along(start, moves, max(SPARSE, test.spacing)).poses for _, _, moves in choices]
    for (cost, _, moves), collides in zip(choices, test.have_hits(sparse), strict=True):
        if not collides and not test.collides(poses_along(start, moves, test.spacing).poses).any():
            return cost, moves
    return None
