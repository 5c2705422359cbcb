r"""From a path with gears to a trajectory: when to be where, within the limits of speed, steering and their rates.

A section is a stretch of path in one gear, s the arc length along it. Three steps:

1. Speed over arc length: see `speed_profile`. The result is the mean speed over any stretch of time.
2. Knots. Each section gets a whole number of the equal intervals h, so every gear change falls on a knot. The car
   rests at both ends of a section, long enough for phi to swing from one section's curvature to the next one's.
3. Splines. Inputs that are linear between knots make v and phi quadratic splines. With one number c_j an interval,

       v_k = (c_{k-1} + c_k) / 2,   a_k = (c_k - c_{k-1}) / h   =>   v_{k+1} - v_k = h (a_k + a_{k+1}) / 2  exactly,

   the distance driven in interval j is h (c_{j-1} + 4 c_j + c_{j+1}) / 6, and v and a keep their limits where
   |c_j| <= v_max and |c_j - c_{j-1}| <= h a_max. The mean speeds of step 1 do, so nothing needs correction afterwards;
   phi and w likewise.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from drake_gnnocp.search.path import GearedPath
from drake_gnnocp.timing.speed_profile import W_FRACTION, Section, slope_limited, speed_profile
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import Vehicle

SAME_POINT = 1e-9  # m, shorter steps of a path are rounding noise
FEWEST_INTERVALS = 3  # of a section: rest, drive, rest
WHOLE_TOLERANCE = 1e-9  # intervals: a duration this little above a whole number of them still fits
STANDING_TIME = 1.0  # s, duration where there is no way to go


@dataclass(frozen=True)
class _Timetable:
    """The knots of the sections: how many intervals each takes, and how long the car rests at its ends."""

    step: float  # s, h
    counts: np.ndarray  # (S,) intervals
    rests: np.ndarray  # (S, 2) s, before and after the drive, each at least one interval

    @property
    def stops(self) -> np.ndarray:
        """Times of the start, the gear changes and the end: (S + 1,) [s]."""
        return self.step * np.append(0, np.cumsum(self.counts))


def plan_speed(path: GearedPath, vehicle: Vehicle, n_knots: int = 120) -> Trajectory:
    """Put a time to a path.

    Args:
        path: poses with gears; the curvature is taken from the headings.
        vehicle: its limits hold at every knot and between knots.
        n_knots: knots of the result, equally spaced in time.

    Returns:
        A trajectory that starts and ends with v = phi = a = w = 0 and has v = 0 at a knot for each gear change. The
        poses are those of the path at the distance driven; v and phi are the exact integrals of a and w.

    Raises:
        ValueError: the path is empty, or n_knots is too small for its gear changes.
    """
    if n_knots < 2 or len(path.poses) == 0:
        raise ValueError(f"plan_speed: needs a path and at least 2 knots, not {len(path.poses)} poses, {n_knots} knots")
    steps = _step_lengths(path.poses)
    moves = np.append(True, steps > SAME_POINT)
    s, poses, gears = np.append(0.0, np.cumsum(steps))[moves], path.poses[moves], path.gears[moves][1:]
    if len(gears) == 0:
        return _standing(poses[0], n_knots)
    ends = np.concatenate([[0], np.flatnonzero(np.diff(gears)) + 1, [len(gears)]])
    sections = [
        speed_profile(s[i : j + 1] - s[i], poses[i : j + 1, 2], int(gears[i]), vehicle)
        for i, j in itertools.pairwise(ends)
    ]
    swings = _swing_times(sections, W_FRACTION * vehicle.w_max)
    timetable = _timetable(sections, swings, n_knots - 1)
    return _trajectory(s, poses, sections, swings, timetable, vehicle)


def _standing(pose: np.ndarray, n_knots: int) -> Trajectory:
    states = np.tile(np.append(pose, [0.0, 0.0]), (n_knots, 1))
    return Trajectory(np.linspace(0.0, STANDING_TIME, n_knots), states, np.zeros((n_knots, 2)))


def _step_lengths(poses: np.ndarray) -> np.ndarray:
    """Arc lengths between neighbouring poses (N, 3): chords, bent as the heading turns: (N - 1,) [m]."""
    half_turn = 0.5 * np.diff(poses[:, 2])
    return np.linalg.norm(np.diff(poses[:, :2], axis=0), axis=1) / np.sinc(half_turn / math.pi)


def _swing_times(sections: list[Section], w: float) -> np.ndarray:
    """Time phi needs at the start (from 0), at each gear change, and at the end (to 0): (S + 1,) [s]."""
    arriving = np.array([0.0, *(section.phi[-1] for section in sections)])
    leaving = np.array([*(section.phi[0] for section in sections), 0.0])
    return np.abs(leaving - arriving) / w


def _timetable(sections: list[Section], swings: np.ndarray, n_intervals: int) -> _Timetable:
    """The shortest h with which all sections, each a whole number of intervals, fit into n_intervals."""
    if n_intervals < FEWEST_INTERVALS * len(sections):
        raise ValueError(f"plan_speed: {n_intervals + 1} knots are too few for a path of {len(sections)} sections")
    driving = np.array([section.duration for section in sections])
    swing_times = np.array([section.swing_time for section in sections])

    def attempt(step: float) -> _Timetable:
        # at a gear change half of the swing belongs to either section; at the ends of the path it is all on one side,
        # and begins in the middle of the first interval
        first = np.append(swings[0] + 0.5 * step, 0.5 * swings[1:-1])
        last = np.append(0.5 * swings[1:-1], swings[-1] + 0.5 * step)
        rests = np.maximum(np.stack([first, last], axis=1) - swing_times[:, None], step)
        counts = np.ceil((driving + rests.sum(axis=1)) / step - WHOLE_TOLERANCE).astype(int)
        return _Timetable(step, counts, rests)

    longest = float(driving.sum() + 2.0 * swings.sum())
    short, long = longest / (2 * n_intervals), 2.0 * longest  # the latter fits: FEWEST_INTERVALS a section
    for _ in range(40):
        middle = math.sqrt(short * long)
        short, long = (short, middle) if attempt(middle).counts.sum() <= n_intervals else (middle, long)
    best = attempt(long)
    best.counts[np.argmax(best.counts)] += n_intervals - best.counts.sum()
    return best


def _trajectory(
    s: np.ndarray,
    poses: np.ndarray,
    sections: list[Section],
    swings: np.ndarray,
    timetable: _Timetable,
    vehicle: Vehicle,
) -> Trajectory:
    """Assemble the splines: s (N,) is the arc length at poses (N, 3)."""
    h, stops = timetable.step, timetable.stops
    knots = h * np.arange(timetable.counts.sum() + 1)
    speed, phi = [], []
    for section, count, (rest, last) in zip(sections, timetable.counts, timetable.rests, strict=True):
        slower = (count * h - rest - last) / section.duration
        at_knots = section.arc_length((h * np.arange(count + 1) - rest) / slower)
        speed.append(section.gear * np.diff(at_knots) / h)
        in_the_middle = section.arc_length((h * (np.arange(count) + 0.5) - rest) / slower)
        phi.append(np.interp(in_the_middle, section.s, section.phi))
    c_v = np.concatenate(speed)
    c_phi = _swung(np.concatenate(phi), knots[:-1] + 0.5 * h, stops, swings)
    c_phi = _rate_limited(c_phi, vehicle.w_max * h)

    v, a = _spline(c_v, h)
    phi_knots, w = _spline(c_phi, h)
    driven = np.convolve(np.abs(c_v), [1.0, 4.0, 1.0], mode="same") * h / 6.0
    at = np.append(0.0, np.cumsum(driven))
    pose = np.stack([np.interp(at * s[-1] / at[-1], s, column) for column in poses.T], axis=1)
    return Trajectory(knots, np.column_stack([pose, v, phi_knots]), np.column_stack([a, w]))


def _swung(phi: np.ndarray, t: np.ndarray, stops: np.ndarray, swings: np.ndarray) -> np.ndarray:
    """Let phi (M,) at times t (M,) swing straight from one section's angle to the next one's, around each stop."""
    half = 0.5 * swings[1:-1]
    keep = ~np.any(np.abs(t[:, None] - stops[1:-1]) < half, axis=1)
    keep &= (t - t[0] >= swings[0]) & (t[-1] - t >= swings[-1])
    known_t, known_phi = t[keep], phi[keep]
    return np.interp(t, [t[0], *known_t, t[-1]], [0.0, *known_phi, 0.0])


def _rate_limited(c: np.ndarray, step: float) -> np.ndarray:
    """Change c (M,) as little as needed for zeros at its ends and differences of at most step.

    The mean of the lower and the upper envelope of slope step has no delay, unlike a limiter that runs forwards.
    """
    i = np.arange(len(c))
    cone = step * np.minimum(i, i[::-1])
    c = np.clip(c, -cone, cone)
    limited = 0.5 * (slope_limited(c, step) - slope_limited(-c, step))
    limited[[0, -1]] = 0.0  # but for rounding errors they are
    return limited


def _spline(c: np.ndarray, h: float) -> tuple[np.ndarray, np.ndarray]:
    """Values (M + 1,) and slopes (M + 1,) at the knots of the quadratic spline of c (M,), at rest before and after."""
    c = np.concatenate([[0.0], c, [0.0]])
    return 0.5 * (c[1:] + c[:-1]), np.diff(c) / h
