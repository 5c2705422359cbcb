r"""From a line of straight pieces to poses with gears: what a search without kinematics leaves open.

Each piece, in the direction d_k, is driven forwards with the heading d_k or backwards with d_k + pi. The gears are
those with the least

    sum_k |theta_{k+1} - theta_k|  +  CHANGE * (number of gear changes)  +  REVERSE * (length in reverse),

start and goal headings included: a dynamic program over the pieces. Between gear changes the corners are rounded, the
headings averaged along the way, so that they turn from the start's to the goal's. Nothing here is drivable exactly, and
roundings are not tested for collisions: this is a guess.
"""

from __future__ import annotations

import math

import numpy as np

from drake_gnnocp.search.path import GearedPath
from drake_gnnocp.vehicle import Vehicle

CHANGE = 1.0  # rad, that a gear change counts as
REVERSE = 0.02  # rad/m, that driving in reverse counts as
GEARS = (1, -1)
SPACING = 0.1  # m, between poses
CORNER = 2.0  # m, of the line around a corner that is bent
HEADING_WINDOW = 3.0  # m, over which headings are averaged
SAME_POINT = 1e-6  # m, shorter pieces have no direction


def geared(line: np.ndarray, start: np.ndarray, goal: np.ndarray, vehicle: Vehicle) -> GearedPath:
    """Poses along a line, from start to goal exactly.

    Args:
        line: (N, 2) positions of the middle of the car's rectangle, those of start and goal first and last [m].
        start: pose (3,) [m, m, rad].
        goal: the same.
        vehicle: whose rectangle it is.
    """
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    line = line[np.append(True, steps > SAME_POINT)]
    if len(line) < 2:  # the car turns where it stands, if at all
        turned = start[2] + math.remainder(goal[2] - start[2], 2 * math.pi)
        return GearedPath(np.array([start, [*goal[:2], turned]]), np.ones(2, dtype=int), np.zeros(2))
    gears = _gears(line, start[2], goal[2])
    cuts = [0, *(np.flatnonzero(np.diff(gears)) + 1), len(gears)]
    sections = [_rounded(line[i : j + 1]) for i, j in zip(cuts, cuts[1:], strict=False)]
    # the pose of a gear change belongs to the section that arrives there
    middles = np.concatenate([sections[0][:1], *(section[1:] for section in sections)])
    of_section = [np.full(len(section) - 1, gears[i]) for section, i in zip(sections, cuts, strict=False)]
    gear = np.concatenate([gears[:1], *of_section])
    theta = _headings(middles, gear[1:], start[2], goal[2])
    ahead = 0.5 * vehicle.length - vehicle.rear_hang  # of the rectangle's middle, from the rear axle
    positions = middles - ahead * np.column_stack([np.cos(theta), np.sin(theta)])
    positions[0], positions[-1] = start[:2], goal[:2]  # but for rounding errors they are
    driven = np.maximum(np.linalg.norm(np.diff(positions, axis=0), axis=1), SAME_POINT)
    curvature = gear[1:] * np.diff(theta) / driven
    return GearedPath(np.column_stack([positions, theta]), gear, np.append(curvature[:1], curvature))


def _gears(line: np.ndarray, start_heading: float, goal_heading: float) -> np.ndarray:
    """The gear of each piece: (N - 1,) +1 or -1."""
    pieces = np.diff(line, axis=0)
    lengths = np.linalg.norm(pieces, axis=1)
    # heading of each piece in each gear: (N - 1, 2)
    headings = np.arctan2(pieces[:, 1], pieces[:, 0])[:, None] + np.array([0.0, math.pi])
    in_reverse = REVERSE * lengths[:, None] * np.array([0.0, 1.0])
    costs = _turn(headings[0], start_heading) + in_reverse[0]
    chosen = []
    for heading, before, reverse in zip(headings[1:], headings, in_reverse[1:], strict=False):
        step = costs[:, None] + _turn(heading[None, :], before[:, None]) + CHANGE * (1 - np.eye(2))
        chosen.append(step.argmin(axis=0))
        costs = step.min(axis=0) + reverse
    costs = costs + _turn(goal_heading, headings[-1])
    which = [int(costs.argmin())]
    for came_from in reversed(chosen):
        which.append(int(came_from[which[-1]]))
    return np.array(GEARS)[which[::-1]]


def _turn(heading: np.ndarray | float, other: np.ndarray | float) -> np.ndarray:
    difference = np.asarray(heading) - np.asarray(other)
    return np.abs((difference + math.pi) % (2 * math.pi) - math.pi)


def _rounded(line: np.ndarray) -> np.ndarray:
    """Points SPACING apart along a line (N, 2), each the mean of those around it; the ends stay [m]."""
    at = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))
    s = np.linspace(0.0, at[-1], 1 + max(2, math.ceil(at[-1] / SPACING)))
    half_window = np.minimum(0.5 * CORNER, np.minimum(s, at[-1] - s))
    offsets = np.linspace(-1.0, 1.0, 21)
    around = s[:, None] + half_window[:, None] * offsets
    return np.stack([np.interp(around, at, column).mean(axis=1) for column in line.T], axis=1)


def _headings(points: np.ndarray, gear: np.ndarray, start_heading: float, goal_heading: float) -> np.ndarray:
    """Headings (N,) at points (N, 2) with the gears (N - 1,) between them, from the start's to the goal's [rad]."""
    steps = np.diff(points, axis=0)
    tangents = np.arctan2(gear * steps[:, 1], gear * steps[:, 0])
    theta = np.unwrap(np.concatenate([[start_heading], tangents, [goal_heading]]))
    half = round(0.5 * HEADING_WINDOW / SPACING)
    padded = np.pad(theta, half, mode="edge")
    mean = np.convolve(padded, np.full(2 * half + 1, 1 / (2 * half + 1)), mode="valid")  # (N + 1,)
    between = 0.5 * (mean[1:] + mean[:-1])
    # what averaging leaves of the difference to the ends' headings is brought in over the same distance
    i = np.arange(len(between))
    fading = min(half, 0.5 * i[-1])
    of_start, of_goal = (np.clip(1.0 - along / fading, 0.0, 1.0) for along in (i, i[::-1]))
    between += of_start * (theta[0] - between[0])
    return between + of_goal * (theta[-1] - between[-1])
