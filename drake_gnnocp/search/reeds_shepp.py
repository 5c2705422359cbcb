r"""Shortest paths of a car that turns no tighter than a radius and may reverse (Reeds-Shepp curves).

Source: J. A. Reeds and L. A. Shepp, "Optimal paths for a car that goes both forwards and backwards", Pacific Journal
of Mathematics 145(2), 1990, section 8, from which the letters are taken. Lengths are in turning radii.

The start is the origin, heading along x, and the goal is (x, y, phi). A word such as L R S L is a path of left arcs
(L), right arcs (R) and straights (S) with the signed lengths t, u, v, negative in reverse. The turning circle at the
left of the start has the centre (0, 1). The goal's left and right circles are seen from it at

    L ... L:  (x - sin phi, y - 1 + cos phi) = rho (cos theta, sin theta)
    L ... R:  (x + sin phi, y - 1 - cos phi) = rho (cos theta, sin theta)

and t, u and v follow from rho, theta and phi alone. `WORDS` has the ten words that begin with L. The others are these
ten for the reflected goal (x, -y, -phi), with L and R exchanged, and for the goal in reversed time (-x, y, -phi), i.e.
theta -> pi - theta, with the lengths negated. The paper's third symmetry (the path run backwards) exchanges start and
goal: it maps L R S L to L S R L and L R S R to L S L R, listed here, and each other word to one already there.

The paper also asks for signs of t and v. They are left out: with both reduced to [-pi, pi] every solution ends at the
goal, whatever the signs, so the least length is the same, and no tolerance is needed where an arc shrinks to zero.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import itemgetter

import numpy as np

from drake_gnnocp.search.moves import Move

Pose = Sequence[float] | np.ndarray  # x, y, theta [m, m, rad]
Lengths = tuple[float, float, float]  # t, u, v [turning radii]

QUARTER = 0.5 * math.pi
TWO_PI = 2.0 * math.pi
ZERO_LENGTH = 1e-12  # turning radii: shorter segments are rounding noise and are dropped
STEER = {"L": 1, "S": 0, "R": -1}


def all_paths(start: Pose, goal: Pose, turning_radius: float) -> list[list[Move]]:
    """One path from start to goal for every word that has a solution, shortest first, some of them twice.

    Paths with changes of gear that a shortest path never has are among them: the words leave the signs of t and v open.
    A path has no moves of no length; where start and goal are the same, the first has none at all.

    Args:
        start: x, y, theta [m, m, rad].
        goal: x, y, theta [m, m, rad].
        turning_radius: of all arcs [m].

    Raises:
        ValueError: a pose is not finite, or turning_radius is not positive and finite.
    """
    solutions = sorted(_solutions(start, goal, turning_radius), key=itemgetter(0))
    return [_moves(solution, turning_radius) for solution in solutions]


def path_length(start: Pose, goal: Pose, turning_radius: float) -> float:
    """Length of the shortest path from start to goal, each x, y, theta [m, m, rad], in m.

    Raises:
        ValueError: a pose is not finite, or turning_radius [m] is not positive and finite.
    """
    return turning_radius * min(_solutions(start, goal, turning_radius), key=itemgetter(0))[0]


def _lsl(rho: float, theta: float, phi: float) -> Lengths:
    return theta, rho, phi - theta


def _lrl(rho: float, theta: float, phi: float) -> Lengths:
    u = -2 * math.asin(0.25 * rho)
    t = theta + 0.5 * u + math.pi
    return t, u, phi - t + u


def _lrsl(rho: float, theta: float, phi: float) -> Lengths:
    r = math.sqrt(rho * rho - 4)
    t = theta + math.atan2(r, -2)
    return t, 2 - r, phi - QUARTER - t


def _lsrl(rho: float, theta: float, phi: float) -> Lengths:
    v, u, t = _lrsl(rho, phi - theta, phi)
    return t, u, v


def _lsr(rho: float, theta: float, phi: float) -> Lengths:
    u = math.sqrt(rho * rho - 4)
    t = theta + math.atan2(2, u)
    return t, u, t - phi


def _lrsr(rho: float, theta: float, phi: float) -> Lengths:
    t = theta + QUARTER
    return t, 2 - rho, t + QUARTER - phi


def _lslr(rho: float, theta: float, phi: float) -> Lengths:
    return theta + math.pi, 2 - rho, theta + QUARTER - phi


def _lrlr_middle_opposed(rho: float, theta: float, phi: float) -> Lengths:
    u = math.acos(0.25 * (2 + rho))
    t = theta + u + QUARTER
    return t, u, t - 2 * u - phi


def _lrlr_middle_alike(rho: float, theta: float, phi: float) -> Lengths:
    u = -math.acos(0.0625 * (20 - rho * rho))
    t = theta + math.atan2(2 - math.cos(u), math.sin(u))
    return t, u, t - phi


def _lrslr(rho: float, theta: float, phi: float) -> Lengths:
    r = math.sqrt(rho * rho - 4)
    t = theta + math.atan2(r, -2)
    return t, 4 - r, t - phi


@dataclass(frozen=True, slots=True)
class Word:
    """One row of the table; `lengths` has a letter per segment: t, u, v, w for -u and q for a quarter turn of -pi/2."""

    segments: str  # L, S, R
    lengths: str
    nearest: float  # least rho with a solution [turning radii]
    farthest: float  # largest rho with a solution [turning radii]
    solve: Callable[[float, float, float], Lengths]  # from rho, theta, phi
    repeats: int  # segments of length |u|
    quarters: float  # length of the quarter turns together [turning radii]


def _word(
    segments: str, lengths: str, nearest: float, farthest: float, solve: Callable[[float, float, float], Lengths]
) -> Word:
    repeats = lengths.count("u") + lengths.count("w")
    return Word(segments, lengths, nearest, farthest, solve, repeats, QUARTER * lengths.count("q"))


# rho is bounded to where u is real and has the sign the paper asks for
WORDS = (
    (  # the last arc turns like the first
        _word("LSL", "tuv", 0.0, math.inf, _lsl),
        _word("LRL", "tuv", 0.0, 4.0, _lrl),
        _word("LRSL", "tquv", math.sqrt(8.0), math.inf, _lrsl),
        _word("LSRL", "tuqv", math.sqrt(8.0), math.inf, _lsrl),
    ),
    (  # the last arc turns against the first
        _word("LSR", "tuv", 2.0, math.inf, _lsr),
        _word("LRLR", "tuwv", 0.0, 2.0, _lrlr_middle_opposed),
        _word("LRLR", "tuuv", 2.0, math.sqrt(20.0), _lrlr_middle_alike),
        _word("LRSR", "tquv", 2.0, math.inf, _lrsr),
        _word("LSLR", "tuqv", 2.0, math.inf, _lslr),
        _word("LRSLR", "tquqv", math.sqrt(20.0), math.inf, _lrslr),
    ),
)
_Solution = tuple[float, Word, int, int, float, float, float]  # length, word, sense of the first arc, gear, t, u, v


def _solutions(start: Pose, goal: Pose, turning_radius: float) -> list[_Solution]:
    """Every word's solution for both senses of the first arc and both gears, lengths in turning radii."""
    x, y, phi = _goal_from_start(start, goal, turning_radius)
    found: list[_Solution] = []
    for sense in (1, -1):
        for words, (rho, theta) in zip(WORDS, _centres(x, sense * y, sense * phi), strict=True):
            for word in words:
                if not word.nearest <= rho <= word.farthest:
                    continue
                for gear in (1, -1):
                    t, u, v = word.solve(rho, theta if gear == 1 else math.pi - theta, sense * gear * phi)
                    t, v = math.remainder(t, TWO_PI), math.remainder(v, TWO_PI)
                    length = abs(t) + word.repeats * abs(u) + word.quarters + abs(v)
                    found.append((length, word, sense, gear, t, u, v))
    return found


def _goal_from_start(start: Pose, goal: Pose, turning_radius: float) -> tuple[float, float, float]:
    """The goal in the start's frame: x and y in turning radii, phi in rad."""
    if not 0 < turning_radius < math.inf:
        raise ValueError(f"turning_radius must be positive and finite, is {turning_radius}")
    x0, y0, theta0 = map(float, start)
    x1, y1, theta1 = map(float, goal)
    x, y, phi = (x1 - x0) / turning_radius, (y1 - y0) / turning_radius, theta1 - theta0
    if not math.isfinite(x + y + phi):
        raise ValueError("start and goal must be finite")
    s, c = math.sin(theta0), math.cos(theta0)
    return c * x + s * y, c * y - s * x, phi


def _centres(x: float, y: float, phi: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """Rho and theta of the goal's left circle, then of its right one, from the start's left circle."""
    s, c = math.sin(phi), math.cos(phi)
    left_xi, left_eta, right_xi, right_eta = x - s, y - 1 + c, x + s, y - 1 - c
    left = math.hypot(left_xi, left_eta), math.atan2(left_eta, left_xi)
    right = math.hypot(right_xi, right_eta), math.atan2(right_eta, right_xi)
    return left, right


def _moves(solution: _Solution, turning_radius: float) -> list[Move]:
    _, word, sense, gear, t, u, v = solution
    lengths = {"t": t, "u": u, "v": v, "w": -u, "q": -QUARTER}
    return [
        Move(sense * STEER[turn] / turning_radius, gear * turning_radius * lengths[letter])
        for turn, letter in zip(word.segments, word.lengths, strict=True)
        if abs(lengths[letter]) > ZERO_LENGTH
    ]
