r"""A path as a list of moves, each of constant curvature kappa and signed length s (negative in reverse).

From the pose (x, y, theta) a move leads to theta + kappa s and, along the chord of the arc, to

    (x, y) + s sinc(kappa s / 2) (cos, sin)(theta + kappa s / 2),   sinc(u) = sin(u) / u.

The cost of a path, in metres of easy driving, is what the searches minimise: its length, with reversing and turning
dearer, and something for every change of gear and of steering.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from drake_gnnocp.search.path import GearedPath


class Move(NamedTuple):
    """A piece of constant curvature and gear."""

    curvature: float  # 1/m, positive left whatever the gear
    length: float  # m, negative in reverse


@dataclass(frozen=True)
class Costs:
    """What a path costs beyond its length."""

    reverse: float = 0.2  # per m driven in reverse
    steering: float = 0.1  # per m at full lock, in proportion below
    gear_change: float = 1.5  # per change, in m
    steering_change: float = 0.2  # per change from straight to full lock, in proportion otherwise, in m

    def of(self, moves: Iterable[Move], sharpest: float, before: Move | None = None) -> float:
        """Cost of driving moves, after the move `before` if there was one; `sharpest`: the largest curvature [1/m]."""
        total = 0.0
        for move in moves:
            total += self.of_move(move, sharpest)
            if before is not None:
                total += self.of_change(before, move, sharpest)
            before = move
        return total

    def of_move(self, move: Move, sharpest: float) -> float:
        """Cost of one move on its own."""
        per_metre = 1.0 + self.steering * abs(move.curvature) / sharpest + (self.reverse if move.length < 0 else 0.0)
        return abs(move.length) * per_metre

    def of_change(self, first: Move, second: Move, sharpest: float) -> float:
        """Cost of going over from one move to the next."""
        gear = self.gear_change if (first.length > 0) != (second.length > 0) else 0.0
        return gear + self.steering_change * abs(first.curvature - second.curvature) / sharpest


def length_of(moves: Iterable[Move]) -> float:
    """Distance driven, forwards and in reverse [m]."""
    return sum(abs(move.length) for move in moves)


def backwards(moves: Sequence[Move]) -> list[Move]:
    """The same path from its end to its start."""
    return [Move(move.curvature, -move.length) for move in reversed(moves)]


def merged(moves: Iterable[Move]) -> list[Move]:
    """Join neighbours of the same curvature and gear."""
    result: list[Move] = []
    for move in moves:
        if result and result[-1].curvature == move.curvature and (result[-1].length > 0) == (move.length > 0):
            result[-1] = Move(move.curvature, result[-1].length + move.length)
        else:
            result.append(move)
    return result


def advance(pose: np.ndarray, curvature: float, s: np.ndarray) -> np.ndarray:
    """Poses after driving the lengths s (N,) [m] at one curvature [1/m] from a pose (3,): (N, 3) [m, m, rad]."""
    return _driven(np.broadcast_to(pose, (len(s), 3)), np.full(len(s), curvature), s)


def joints(start: np.ndarray, moves: Sequence[Move]) -> np.ndarray:
    """The pose (3,) before the first move and those after each of M moves: (M + 1, 3) [m, m, rad]."""
    x, y, theta = map(float, start)
    poses = [(x, y, theta)]
    for curvature, length in moves:
        half_turn = 0.5 * curvature * length
        chord = length * (math.sin(half_turn) / half_turn if half_turn else 1.0)
        x += chord * math.cos(theta + half_turn)
        y += chord * math.sin(theta + half_turn)
        theta += 2.0 * half_turn
        poses.append((x, y, theta))
    return np.array(poses)


def poses_along(start: np.ndarray, moves: Sequence[Move], step: float) -> GearedPath:
    """Poses along moves at most step [m] apart, the ends of every move among them; without moves the start twice."""
    moves = moves or [Move(0.0, 0.0)]
    counts = [max(1, math.ceil(abs(length) / step)) for _, length in moves]
    which = np.repeat(np.arange(len(moves)), counts)
    fractions = np.concatenate([np.arange(1, count + 1) / count for count in counts])
    curvatures, lengths = np.array(moves)[which].T
    poses = _driven(joints(start, moves)[which], curvatures, lengths * fractions)
    gears = np.where(lengths >= 0, 1, -1)
    return GearedPath(
        np.concatenate([np.asarray(start, dtype=float)[None], poses]),
        np.concatenate([gears[:1], gears]),
        np.concatenate([curvatures[:1], curvatures]),
    )


def _driven(poses: np.ndarray, curvatures: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Where driving s (N,) [m] at curvatures (N,) [1/m] leads to from poses (N, 3): (N, 3) [m, m, rad]."""
    half_turn = 0.5 * curvatures * s
    safe = np.where(half_turn == 0.0, 1.0, half_turn)
    chord = np.where(half_turn == 0.0, s, s * np.sin(safe) / safe)
    theta = poses[:, 2] + half_turn
    result = np.empty((len(s), 3))
    result[:, 0] = poses[:, 0] + chord * np.cos(theta)
    result[:, 1] = poses[:, 1] + chord * np.sin(theta)
    result[:, 2] = theta + half_turn
    return result
