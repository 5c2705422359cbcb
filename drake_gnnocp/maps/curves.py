r"""Curves as polygons that cover what they enclose, and are at most FLATTENING larger.

A bulge b is that of DXF: an arc from P to Q turns by 4 atan b, counter-clockwise where b > 0. It is cut into n equal
parts of angle a. Chords lie inside of the circle; the tangents at the ends of the parts lie outside, and meet at the
distance r / cos(a/2) from the centre, so

    chords    r (1 - cos(a/2)) <= FLATTENING,      tangents    r (1 / cos(a/2) - 1) <= FLATTENING.

A ring takes tangents where an arc bulges outwards, chords where it bulges inwards (for bounds, the other way round). An
ellipse is the image of a circle under an affine map, which keeps tangents.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from drake_gnnocp.maps.drawing import Points
from drake_gnnocp.polygons import signed_area

FLATTENING = 5e-3  # m, between a curve and the polygon
MOST_PARTS = 5000  # of one curve: a circle of 25 km takes them
STRAIGHT = 1e-9  # m, an arc that is this near its chord is it


def ring_around(vertices: np.ndarray, outward: bool = True) -> Points:
    """The ring of a closed polyline with arcs.

    Args:
        vertices: (N, 3) x, y [m], and the bulge of the arc to the next vertex, of the last one to the first.
        outward: whether the ring covers what the polyline encloses, or the other way round.

    Raises:
        ValueError: an arc is so large that it would have too many parts.
    """
    chords = polyline_along(np.concatenate([vertices, vertices[:1]]))
    is_counter_clockwise = signed_area(np.array(chords[:-1])) > 0
    ring: Points = []
    for (x, y, bulge), (u, v, _) in pairwise(np.concatenate([vertices, vertices[:1]]).tolist()):
        is_outside = ((bulge > 0) == is_counter_clockwise) == outward
        ring += [[x, y], *(_tangents if is_outside else _chords)([x, y], [u, v], bulge)]
    return ring


def polyline_along(vertices: np.ndarray) -> Points:
    """The chords of an open polyline with arcs: (N, 3) as in `ring_around`; the last bulge has no meaning."""
    rows = vertices.tolist()
    points = [[*rows[0][:2]]]
    for (x, y, bulge), (u, v, _) in pairwise(rows):
        points += [*_chords([x, y], [u, v], bulge), [u, v]]
    return points


def ring_around_ellipse(centre: np.ndarray, major: np.ndarray, minor: np.ndarray, outward: bool = True) -> Points:
    """The ring around an ellipse, a circle among them; or within it.

    Args:
        centre: (2,) [m].
        major: (2,) from the centre to the end of one axis [m].
        minor: (2,) the same of the other axis [m].
        outward: whether the ring covers the ellipse, or the ellipse the ring.
    """
    n = max(4, _parts(2 * math.pi, float(max(np.linalg.norm(major), np.linalg.norm(minor)))))
    angles = 2 * math.pi * np.arange(n) / n
    size = 1 / math.cos(math.pi / n) if outward else 1.0
    return (centre + size * (np.cos(angles)[:, None] * major + np.sin(angles)[:, None] * minor)).tolist()


def polyline_along_ellipse(
    centre: np.ndarray, major: np.ndarray, minor: np.ndarray, begin: float, angle: float
) -> Points:
    """The chords of a part of an ellipse, as in `ring_around_ellipse`, from a parameter on, by an angle [rad]."""
    n = max(2, _parts(angle, float(max(np.linalg.norm(major), np.linalg.norm(minor)))))
    angles = begin + angle * np.arange(n + 1) / n
    return (centre + np.cos(angles)[:, None] * major + np.sin(angles)[:, None] * minor).tolist()


def _parts(angle: float, r: float) -> int:
    """How many equal parts of an arc keep FLATTENING, by tangents, and so by chords."""
    n = math.ceil(angle / (2 * math.acos(r / (r + FLATTENING)))) if r > 0 else 1
    if n > MOST_PARTS:
        raise ValueError(f"is a curve with a radius of {r:.3g} m: is the drawing's unit right?")
    return max(n, math.ceil(angle / (0.5 * math.pi) - 1e-9))  # parts of at most a quarter: tangents meet


def _arc(p: list[float], q: list[float], bulge: float) -> tuple[int, np.ndarray, np.ndarray, float]:
    """The parts of an arc, its centre (2,), the radius vector (2,) of its begin, and the signed angle of a part."""
    chord = math.dist(p, q)
    angle = 4 * math.atan(bulge)
    r = 0.25 * chord * (1 / abs(bulge) + abs(bulge))
    n = _parts(abs(angle), r)
    across = np.array([p[1] - q[1], q[0] - p[0]])  # to the left of the chord
    centre = 0.5 * np.add(p, q) + across * (1 - bulge**2) / (4 * bulge)
    return n, centre, p - centre, angle / n


def _is_straight(p: list[float], q: list[float], bulge: float) -> bool:
    return 0.5 * abs(bulge) * math.dist(p, q) < STRAIGHT


def _chords(p: list[float], q: list[float], bulge: float) -> Points:
    """The vertices between p and q of the chords of an arc."""
    if _is_straight(p, q, bulge):
        return []
    n, centre, radius, part = _arc(p, q, bulge)
    return (centre + _turned(radius, part * np.arange(1, n))).tolist()


def _tangents(p: list[float], q: list[float], bulge: float) -> Points:
    """The vertices between p and q of the tangents of an arc."""
    if _is_straight(p, q, bulge):
        return []
    n, centre, radius, part = _arc(p, q, bulge)
    if n == 1:  # without the centre, which is far away where the arc is flat
        height = -0.5 * math.tan(0.5 * part)  # of the apex to the left of the chord, in chords
        return [[0.5 * (p[0] + q[0]) + height * (p[1] - q[1]), 0.5 * (p[1] + q[1]) + height * (q[0] - p[0])]]
    return (centre + _turned(radius, part * (np.arange(n) + 0.5)) / math.cos(0.5 * part)).tolist()


def _turned(vector: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """A vector (2,) turned by angles (K,): (K, 2)."""
    x, y = vector
    return np.column_stack([np.cos(angles) * x - np.sin(angles) * y, np.sin(angles) * x + np.cos(angles) * y])
