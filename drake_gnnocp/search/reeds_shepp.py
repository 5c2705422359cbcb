"""Shortest paths of a car that turns no tighter than a radius and may reverse (Reeds-Shepp curves).

Source: J. A. Reeds and L. A. Shepp, "Optimal paths for a car that goes both forwards and backwards", Pacific Journal
of Mathematics 145(2), 1990. The shortest path between two poses is one of finitely many words of full-lock arcs and
straights; `_reeds_shepp_words` has them and their lengths t, u, v. Here they are tried for both senses of the first arc
(the reflected goal) and both gears (the goal in reversed time), and the shortest is taken.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Any

import numpy as np

from drake_gnnocp.search._reeds_shepp_words import ARRAY, FLOAT, QUARTER, WORDS, Functions, Real, Word, centres

Pose = Sequence[float] | np.ndarray  # x, y, theta [m, m, rad]
_Solution = tuple[float, Word, int, int, float, float, float]  # length, word, sense of the first arc, gear, t, u, v

TWO_PI = 2.0 * math.pi
ZERO_LENGTH = 1e-12  # turning radii: shorter segments are rounding noise and are dropped
STEER = {"L": 1, "S": 0, "R": -1}


@dataclass(frozen=True)
class Segment:
    """A piece of constant steering and gear."""

    steer: int  # +1 left arc, 0 straight, -1 right arc
    length: float  # m, signed: negative means reverse gear


@dataclass(frozen=True)
class ReedsSheppPath:
    """A path of full-lock arcs and straights."""

    segments: tuple[Segment, ...]  # zero-length segments dropped
    turning_radius: float  # m

    @property
    def length(self) -> float:
        """Distance driven, forwards and in reverse [m]."""
        return sum(abs(segment.length) for segment in self.segments)

    def sample(self, start: Pose, step: float) -> tuple[np.ndarray, np.ndarray]:
        """Poses along the path, both ends of every segment among them.

        Args:
            start: x, y, theta [m, m, rad].
            step: largest distance along the path between neighbouring poses [m].

        Returns:
            poses: (N, 3) x, y, theta [m, m, rad]; theta is continuous, not reduced to one turn.
            gears: (N,) +1 or -1, gear of the motion that arrives at the pose; the first equals the second.

        Raises:
            ValueError: step is not positive.
        """
        if not step > 0:
            raise ValueError(f"step must be positive, is {step}")
        pieces = [np.asarray(start, dtype=float)[None]]
        gears = [1] if not self.segments else [self._gear(self.segments[0])]
        for segment in self.segments:
            x, y, theta = pieces[-1][-1]
            count = math.ceil(abs(segment.length) / step)
            s = segment.length * np.arange(1, count + 1) / count
            half_turn = 0.5 * segment.steer * s / self.turning_radius
            chord = s * np.sinc(half_turn / math.pi)  # 2 R sin(half_turn), and s on a straight
            along = theta + half_turn  # the chord's direction
            pieces.append(np.column_stack([x + chord * np.cos(along), y + chord * np.sin(along), along + half_turn]))
            gears += [self._gear(segment)] * count
        return np.concatenate(pieces), np.array(gears)

    @staticmethod
    def _gear(segment: Segment) -> int:
        return 1 if segment.length > 0 else -1


def shortest_path(start: Pose, goal: Pose, turning_radius: float) -> ReedsSheppPath:
    """The shortest path from start to goal, each x, y, theta [m, m, rad]; no segments where they are the same.

    Raises:
        ValueError: a pose is not finite, or turning_radius [m] is not positive and finite.
    """
    return _path(min(_solutions(start, goal, turning_radius), key=itemgetter(0)), turning_radius)


def all_paths(start: Pose, goal: Pose, turning_radius: float) -> list[ReedsSheppPath]:
    """One path from start to goal for every word that has a solution, shortest first, some of them twice.

    Paths with changes of gear that a shortest path never has are among them: the words leave the signs of t and v open.

    Raises:
        ValueError: a pose is not finite, or turning_radius [m] is not positive and finite.
    """
    solutions = sorted(_solutions(start, goal, turning_radius), key=itemgetter(0))
    return [_path(solution, turning_radius) for solution in solutions]


def path_length(start: Pose, goal: Pose, turning_radius: float) -> float:
    """Length of the shortest path from start to goal, each x, y, theta [m, m, rad], in m.

    Raises:
        ValueError: a pose is not finite, or turning_radius [m] is not positive and finite.
    """
    return turning_radius * min(_solutions(start, goal, turning_radius), key=itemgetter(0))[0]


def path_lengths(poses: np.ndarray, goal: Pose, turning_radius: float) -> np.ndarray:
    """Lengths of the shortest paths from many poses to one goal.

    Args:
        poses: (N, 3) x, y, theta [m, m, rad].
        goal: x, y, theta [m, m, rad].
        turning_radius: smallest radius the car can drive [m].

    Returns:
        (N,) [m].

    Raises:
        ValueError: a pose is not finite, or turning_radius is not positive and finite.
    """
    # arrays of shape (2 senses of the first arc, 2 gears, N)
    x, y, phi = _goal_from_start(ARRAY, np.asarray(poses, dtype=float).T, goal, turning_radius)
    sense = np.array([1, -1])[:, None, None]
    gear = np.array([1, -1])[:, None]
    shortest = np.full(np.shape(x), math.inf)
    for words, (rho, theta) in zip(WORDS, centres(ARRAY, x, sense * y, sense * phi), strict=True):
        theta = np.concatenate([theta, math.pi - theta], axis=1)
        for word in words:
            inside = rho.clip(word.nearest, word.farthest)
            t, u, v = word.solve(ARRAY, inside, theta, sense * gear * phi)
            t, v = t - TWO_PI * np.rint(t / TWO_PI), v - TWO_PI * np.rint(v / TWO_PI)
            length = np.abs(t) + word.repeats * np.abs(u) + word.quarters + np.abs(v)
            length = np.where(inside == rho, length, math.inf)
            shortest = np.minimum(shortest, length.min(axis=(0, 1)))
    return turning_radius * shortest


def _goal_from_start(m: Functions, start: Any, goal: Pose, turning_radius: float) -> tuple[Real, Real, Real]:
    """The goal in the start's frame: x and y in turning radii, phi in rad."""
    if not 0 < turning_radius < math.inf:
        raise ValueError(f"turning_radius must be positive and finite, is {turning_radius}")
    x0, y0, theta0 = start
    x1, y1, theta1 = map(float, goal)
    x, y, phi = (x1 - x0) / turning_radius, (y1 - y0) / turning_radius, theta1 - theta0
    if not m.all_finite(x + y + phi):
        raise ValueError("start and goal must be finite")
    s, c = m.sin(theta0), m.cos(theta0)
    return c * x + s * y, c * y - s * x, phi


def _solutions(start: Pose, goal: Pose, turning_radius: float) -> list[_Solution]:
    """Every word's solution, lengths in turning radii."""
    x, y, phi = _goal_from_start(FLOAT, map(float, start), goal, turning_radius)
    found: list[_Solution] = []
    for sense in (1, -1):
        for words, (rho, theta) in zip(WORDS, centres(FLOAT, x, sense * y, sense * phi), strict=True):
            for word in words:
                if not word.nearest <= rho <= word.farthest:
                    continue
                for gear in (1, -1):
                    t, u, v = word.solve(FLOAT, rho, theta if gear == 1 else math.pi - theta, sense * gear * phi)
                    t, v = math.remainder(t, TWO_PI), math.remainder(v, TWO_PI)
                    length = abs(t) + word.repeats * abs(u) + word.quarters + abs(v)
                    found.append((length, word, sense, gear, t, u, v))
    return found


def _path(solution: _Solution, turning_radius: float) -> ReedsSheppPath:
    _, word, sense, gear, t, u, v = solution
    lengths = {"t": t, "u": u, "v": v, "w": -u, "q": -QUARTER}
    segments = []
    for turn, letter in zip(word.segments, word.lengths, strict=True):
        if abs(lengths[letter]) > ZERO_LENGTH:
            segments.append(Segment(sense * STEER[turn], gear * turning_radius * lengths[letter]))
    return ReedsSheppPath(tuple(segments), turning_radius)
