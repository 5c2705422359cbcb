"""The words of the Reeds-Shepp curves: which arcs and straights join two poses, and how long each is.

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
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

QUARTER = 0.5 * math.pi


class Functions(NamedTuple):
    """Lets one set of formulas serve floats, for which numpy is slow, and arrays."""

    sin: Callable[..., Any]
    cos: Callable[..., Any]
    hypot: Callable[..., Any]
    sqrt: Callable[..., Any]
    asin: Callable[..., Any]
    acos: Callable[..., Any]
    atan2: Callable[..., Any]
    all_finite: Callable[..., bool]


FLOAT = Functions(math.sin, math.cos, math.hypot, math.sqrt, math.asin, math.acos, math.atan2, math.isfinite)
ARRAY = Functions(
    np.sin, np.cos, np.hypot, np.sqrt, np.arcsin, np.arccos, np.arctan2, lambda a: bool(np.isfinite(a).all())
)
Real = Any  # a float or an array


def _lsl(m: Functions, rho: Real, theta: Real, phi: Real) -> tuple[Real, Real, Real]:
    return theta, rho, phi - theta


def _lrl(m: Functions, rho: Real, theta: Real, phi: Real) -> tuple[Real, Real, Real]:
    u = -2 * m.asin(0.25 * rho)
    t = theta + 0.5 * u + math.pi
    return t, u, phi - t + u


def _lrsl(m: Functions, rho: Real, theta: Real, phi: Real) -> tuple[Real, Real, Real]:
    r = m.sqrt(rho * rho - 4)
    t = theta + m.atan2(r, -2)
    return t, 2 - r, phi - QUARTER - t


def _lsrl(m: Functions, rho: Real, theta: Real, phi: Real) -> tuple[Real, Real, Real]:
    v, u, t = _lrsl(m, rho, phi - theta, phi)
    return t, u, v


def _lsr(m: Functions, rho: Real, theta: Real, phi: Real) -> tuple[Real, Real, Real]:
    u = m.sqrt(rho * rho - 4)
    t = theta + m.atan2(2, u)
    return t, u, t - phi


def _lrsr(m: Functions, rho: Real, theta: Real, phi: Real) -> tuple[Real, Real, Real]:
    t = theta + QUARTER
    return t, 2 - rho, t + QUARTER - phi


def _lslr(m: Functions, rho: Real, theta: Real, phi: Real) -> tuple[Real, Real, Real]:
    return theta + math.pi, 2 - rho, theta + QUARTER - phi


def _lrlr_middle_opposed(m: Functions, rho: Real, theta: Real, phi: Real) -> tuple[Real, Real, Real]:
    u = m.acos(0.25 * (2 + rho))
    t = theta + u + QUARTER
    return t, u, t - 2 * u - phi


def _lrlr_middle_alike(m: Functions, rho: Real, theta: Real, phi: Real) -> tuple[Real, Real, Real]:
    u = -m.acos(0.0625 * (20 - rho * rho))
    t = theta + m.atan2(2 - m.cos(u), m.sin(u))
    return t, u, t - phi


def _lrslr(m: Functions, rho: Real, theta: Real, phi: Real) -> tuple[Real, Real, Real]:
    r = m.sqrt(rho * rho - 4)
    t = theta + m.atan2(r, -2)
    return t, 4 - r, t - phi


@dataclass(frozen=True, slots=True)
class Word:
    """One row of the table; `lengths` has a letter per segment: t, u, v, w for -u and q for a quarter turn of -pi/2."""

    segments: str  # L, S, R
    lengths: str
    nearest: float  # least rho with a solution [turning radii]
    farthest: float  # largest rho with a solution [turning radii]
    solve: Callable[[Functions, Real, Real, Real], tuple[Real, Real, Real]]
    repeats: int  # segments of length |u|
    quarters: float  # length of the quarter turns together [turning radii]


def _word(segments: str, lengths: str, nearest: float, farthest: float, solve: Callable[..., Any]) -> Word:
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


def centres(m: Functions, x: Real, y: Real, phi: Real) -> tuple[tuple[Real, Real], tuple[Real, Real]]:
    """Rho and theta of the goal's left circle, then of its right one, from the start's left circle."""
    s, c = m.sin(phi), m.cos(phi)
    left_xi, left_eta, right_xi, right_eta = x - s, y - 1 + c, x + s, y - 1 - c
    left = m.hypot(left_xi, left_eta), m.atan2(left_eta, left_xi)
    right = m.hypot(right_xi, right_eta), m.atan2(right_eta, right_xi)
    return left, right
