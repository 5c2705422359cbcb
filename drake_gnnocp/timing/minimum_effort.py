r"""Minimum-effort timing of a path: a guess close to what the optimiser will make of it.

A speed planner drives near the limits and waits at bends; the optimal control problem with a given duration spreads its
effort int a^2 + w^2 dt over all of it. Along a section of length l in one gear, driven in the time T, the least
int a^2 dt has the speed

    v(t) = 6 l / T^3  t (T - t),                                   peak 3 l / (2 T), effort 12 l^2 / T^3,

and where that exceeds v_max, a parabola up to v_max in tau = 3/2 (T - l / v_max), constant speed, a parabola down.
Sections share the duration so that the sum of efforts is least: T_i proportional to sqrt(l_i), but none shorter than
its acceleration and steering need. Guesses timed like this halved Ipopt's iterations, and knots slide less along the
path while it solves, so fewer of them meet obstacles they had no constraints for.
"""

from __future__ import annotations

import numpy as np

from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import State, Vehicle

STANDING = 1e-9  # m, and m/s: less is standing still
V_SHARE = 0.98  # of v_max: the optimiser's speed peaks between the knots
SMOOTHING_PART = 13  # phi is averaged, twice, over the number of knots divided by this


def with_duration(trajectory: Trajectory, duration: float) -> Trajectory:
    """The same motion played evenly faster or slower, so that it takes `duration` [s]."""
    factor = trajectory.duration / duration
    states, inputs = trajectory.states.copy(), trajectory.inputs.copy()
    states[:, State.V] *= factor
    inputs *= [factor**2, factor]
    return Trajectory(trajectory.t / factor, states, inputs)


def with_minimum_effort(trajectory: Trajectory, duration: float, vehicle: Vehicle) -> Trajectory:
    """The trajectory's path with its gear changes, driven in `duration` with the least acceleration.

    Args:
        trajectory: N equally spaced knots.
        duration: [s]; where the limits do not allow this timing in it, the motion is only scaled.
        vehicle: its limits.

    Returns:
        N equally spaced knots at rest at both ends. Inputs are derivatives of the speed and of the smoothed steering
        angle, clipped to the limits: a guess, not exact dynamics.
    """
    v = trajectory.column(State.V)
    arc = np.append(0.0, np.cumsum(np.diff(trajectory.t) * (np.abs(v[1:]) + np.abs(v[:-1])) / 2))
    stops, gears = _sections(v)
    lengths = np.diff(arc[stops])
    if arc[-1] < STANDING:
        return with_duration(trajectory, duration)
    v_max = V_SHARE * vehicle.v_max
    phi = trajectory.column(State.PHI)
    steering = np.array([np.abs(np.diff(phi[i : j + 1])).sum() for i, j in zip(stops, stops[1:], strict=False)])
    least = np.maximum(_shortest_times(lengths, v_max, vehicle.a_max), steering / vehicle.w_max)
    if least.sum() > duration:
        return with_duration(trajectory, duration)
    times = _shared(np.sqrt(lengths), least, duration)

    t = np.linspace(0.0, duration, len(trajectory))
    starts = np.append(0.0, np.cumsum(times))
    section = np.clip(np.searchsorted(starts, t, side="right") - 1, 0, len(times) - 1)
    s, speed, a = _profile(t - starts[section], lengths[section], times[section], v_max)
    s += arc[stops[section]]
    x, y, theta, angle = (np.interp(s, arc, column) for column in trajectory.states[:, [0, 1, 2, 4]].T)
    angle = _smoothed(angle, max(1, len(t) // SMOOTHING_PART) | 1)
    w = np.gradient(angle, t)
    states = np.column_stack([x, y, theta, gears[section] * speed, angle])
    limits = np.array([vehicle.a_max, vehicle.w_max])
    inputs = np.column_stack([gears[section] * a, w]).clip(-limits, limits)
    states[[0, -1], State.V :] = inputs[[0, -1]] = 0.0
    return Trajectory(t, states, inputs)


def _sections(v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Knots where sections in one gear meet, with both ends, and the sections' gears (+1, -1)."""
    moving = np.flatnonzero(np.abs(v) > STANDING)
    signs = np.sign(v[moving])
    changes = np.flatnonzero(np.diff(signs))
    # between the last knot in one gear and the first in the next the car stands, or passes through zero
    stops = [(moving[i] + moving[i + 1]) // 2 for i in changes]
    gears = signs[np.append(changes, -1)] if len(moving) else np.array([1.0])
    return np.array([0, *stops, len(v) - 1]), gears


def _shortest_times(lengths: np.ndarray, v_max: float, a_max: float) -> np.ndarray:
    """Times in which the profile of each section just keeps a_max [s]."""
    unlimited = np.sqrt(6 * lengths / a_max)
    limited = lengths / v_max + 4 * v_max / (3 * a_max)
    return np.where(1.5 * lengths > v_max * unlimited, limited, unlimited)


def _shared(weights: np.ndarray, least: np.ndarray, total: float) -> np.ndarray:
    """Share a total in proportion to weights, none below its least; the sum of these is at most the total."""
    fixed = np.zeros(len(weights), dtype=bool)
    while True:
        rest = total - least[fixed].sum()
        shares = np.where(fixed, least, rest * weights / max(weights[~fixed].sum(), STANDING))
        short = ~fixed & (shares < least)
        if not short.any():
            return shares * total / shares.sum()
        fixed |= short


def _profile(
    t: np.ndarray, length: np.ndarray, time: np.ndarray, v_max: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distance, speed and acceleration at times t into sections of a length and a duration: (N,) each."""
    half = 1.5 * length <= v_max * time  # a whole parabola, v_max is not reached
    tau = np.where(half, time / 2, 1.5 * (time - length / v_max))
    peak = np.where(half, 1.5 * length / time, v_max)
    from_end = np.minimum(t, time - t).clip(0.0)
    u = np.minimum(from_end / tau, 1.0)
    ramp = peak * tau * (u**2 - u**3 / 3) + peak * np.maximum(from_end - tau, 0.0)
    late = t > time / 2
    acceleration = np.where(late, -1.0, 1.0) * 2 * peak / tau * (1 - u)
    return np.where(late, length - ramp, ramp), peak * (1 - (1 - u) ** 2), acceleration


def _smoothed(values: np.ndarray, width: int) -> np.ndarray:
    """Moving average over an odd number of values, twice."""
    for _ in range(2):
        padded = np.pad(values, width // 2, mode="edge")
        values = np.convolve(padded, np.full(width, 1 / width), mode="valid")
    return values
