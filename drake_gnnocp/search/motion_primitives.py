"""Motion primitives: arcs of one length, every steering level in both gears, and what they cost after one another."""

from __future__ import annotations

import math

import numpy as np

from drake_gnnocp.search.moves import Costs, Move, advance


class MotionPrimitives:
    """The successors of a node, before collisions.

    Args:
        length: of every primitive [m].
        levels: steering levels from full left to full right; odd, so that straight is one of them.
        radius: turning radius at full lock [m].
        costs: what a path costs.
        sign: -1 where the path will be driven backwards, so that forward moves cost what reversing costs; 1 otherwise.
    """

    def __init__(self, length: float, levels: int, radius: float, costs: Costs, sign: float) -> None:
        curvatures = np.linspace(-1.0, 1.0, levels) / radius
        self.length = length
        self.moves = [Move(float(kappa), gear * length) for gear in (1, -1) for kappa in curvatures]
        sharpest = 1.0 / radius
        own = [costs.of_move(Move(move.curvature, sign * move.length), sharpest) for move in self.moves]
        changes = [[costs.of_change(a, b, sharpest) for b in self.moves] for a in self.moves]
        self.own_costs = own
        # row a, column b: cost of b after a; the last row is for a root, which no primitive leads to
        self.costs_after: list[list[float]] = np.vstack([np.array(changes) + own, own]).tolist()

    def sampled(self, spacing: float) -> np.ndarray:
        """Poses at most spacing [m] apart along every primitive from the origin: (P, K, 3) [m, m, rad]."""
        count = math.ceil(self.length / spacing)
        steps = np.arange(1, count + 1) / count
        return np.array([advance(np.zeros(3), move.curvature, move.length * steps) for move in self.moves])


def placed(poses: np.ndarray, frame: tuple[float, float, float]) -> np.ndarray:
    """Poses (..., 3) given in the frame of a pose x, y, theta, in the frame of the map [m, m, rad]."""
    x, y, theta = frame
    cos, sin = math.cos(theta), math.sin(theta)
    result = np.empty_like(poses)
    result[..., 0] = x + cos * poses[..., 0] - sin * poses[..., 1]
    result[..., 1] = y + sin * poses[..., 0] + cos * poses[..., 1]
    result[..., 2] = theta + poses[..., 2]
    return result
