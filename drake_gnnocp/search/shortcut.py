r"""Shortens a path: pieces of it are replaced by cheaper free Reeds-Shepp paths between their ends.

A search on a grid finds paths that wiggle, and that change gear where the grid suggests it. Here the path is cut into
pieces of a few metres. From the start on, the longest run of pieces that a cheaper path can replace is replaced. Then a
second round does the same with other cuts.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from drake_gnnocp.budget import Budget
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.search.collision import FootprintTest
from drake_gnnocp.search.connection import connect
from drake_gnnocp.search.moves import Costs, Move, joints, length_of, merged
from drake_gnnocp.search.reeds_shepp import path_length

CUT_EVERY = (2.0, 1.1)  # m, most between two cuts, in each round
MOST_CUTS = 24  # long paths are cut less often: pairs of cuts are tried
CANDIDATES = 3  # Reeds-Shepp paths tried for one piece
REACH = 60.0  # m, longest run that is replaced: the work grows with the length of the path, not with its square
GAIN = 0.05  # m, smaller improvements are left


def shortened(scenario: Scenario, moves: list[Move], test: FootprintTest, costs: Costs, budget: Budget) -> list[Move]:
    """A path from the scenario's start that costs no more than the given one and is as free.

    Args:
        scenario: the task.
        moves: a free path from start to goal.
        test: the collision test.
        costs: what a path costs.
        budget: when it is over, what there is by then is returned.
    """
    for longest in CUT_EVERY:
        if not budget.is_over:
            moves = _round(scenario, _cut(moves, longest), test, costs, budget)
    return moves


def _round(scenario: Scenario, pieces: list[Move], test: FootprintTest, costs: Costs, budget: Budget) -> list[Move]:
    """Replace the longest run of pieces that can be, from the start on, and go on behind it."""
    cuts, radius = joints(scenario.start, pieces), scenario.vehicle.turning_radius
    along = np.cumsum([0.0, *(abs(piece.length) for piece in pieces)])
    farthest = np.maximum(np.searchsorted(along, along[:-1] + REACH, side="right") - 1, np.arange(len(pieces)) + 1)
    result: list[Move] = []
    first = 0
    while first < len(pieces):
        past, new = first + 1, pieces[first : first + 1]
        for last in range(int(farthest[first]), first + 1, -1):
            if budget.is_over:
                return merged(result + pieces[first:])
            # the changes of gear and steering at both ends count as well
            cost_of = partial(_cost, costs, radius, result[-1] if result else None, pieces[last : last + 1])
            limit = cost_of(pieces[first:last]) - GAIN
            if path_length(cuts[first], cuts[last], radius) < limit:
                better = connect(cuts[first], cuts[last], radius, test, cost_of, limit, CANDIDATES)
                if better is not None:
                    past, new = last, better[1]
                    break
        result += new
        first = past
    return merged(result)


def _cost(costs: Costs, radius: float, before: Move | None, after: list[Move], moves: list[Move]) -> float:
    return costs.of(moves + after, 1.0 / radius, before)


def _cut(moves: list[Move], longest: float) -> list[Move]:
    """The same path in moves no longer than a length [m], longer on long paths."""
    longest = max(longest, length_of(moves) / MOST_CUTS)
    pieces = []
    for move in moves:
        count = max(1, math.ceil(abs(move.length) / longest))
        pieces += [Move(move.curvature, move.length / count)] * count
    return pieces
