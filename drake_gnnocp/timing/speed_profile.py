r"""The speed along a stretch of path in one gear, over its arc length s.

The heading is averaged over a sliding window, which turns jumps of the curvature kappa into ramps:

    kappa(s) = (theta(s + r) - theta(s - r)) / 2r,   phi = atan(L_w kappa).

The speed is capped by v_max and by the steering rate, v |dphi/ds| <= w_max. Then v^2 is limited to a slope of 2 a_max
in both directions, which is driving at constant acceleration, and starts and ends at zero.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from drake_gnnocp.vehicle import Vehicle

# of the vehicle's limits; the rest is left to the optimiser
V_FRACTION, A_FRACTION, W_FRACTION = 0.9, 0.6, 0.85
WINDOW = 1.5  # m, arc length over which curvature is averaged
SWING_DISTANCE = 0.15  # m, beside a gear change, within which the wheels may still swing
V_CRAWL = 0.05  # m/s, least cap on the speed however suddenly the curvature changes
CELL = 0.05  # m, of the grid along a section
NO_SLOPE = 1e-9  # rad/m, keeps the speed that the steering rate allows finite on straights and circles
FEWEST_CELLS = 24  # of a section, however short: its speed profile has a peak to resolve


@dataclass(frozen=True)
class Section:
    """A stretch of path in one gear with its speed profile, on a grid along it."""

    gear: int  # +1 forward, -1 reverse
    s: np.ndarray  # (G,) m, from 0
    phi: np.ndarray  # (G,) rad
    v: np.ndarray  # (G,) m/s, zero at both ends, not negative in reverse
    t: np.ndarray  # (G,) s, from 0
    swing_time: float  # s, at either end, in which the car moves at most the swing distance

    @property
    def length(self) -> float:
        """From one end to the other [m]."""
        return float(self.s[-1])

    @property
    def duration(self) -> float:
        """Time to drive it, without rests [s]."""
        return float(self.t[-1])

    def arc_length(self, t: np.ndarray) -> np.ndarray:
        """Where the car is at times t: the acceleration is constant within a cell of the grid."""
        t = np.clip(t, 0.0, self.duration)
        i = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.t) - 2)
        acceleration = np.diff(self.v) / np.diff(self.t)
        since = t - self.t[i]
        return np.clip(self.s[i] + (self.v[i] + 0.5 * acceleration[i] * since) * since, 0.0, self.length)


def speed_profile(s: np.ndarray, theta: np.ndarray, gear: int, vehicle: Vehicle) -> Section:
    """Steering angle and speed along a stretch of path.

    Args:
        s: (N,) arc lengths, from 0 [m].
        theta: (N,) headings there, continuous [rad].
        gear: +1 or -1.
        vehicle: its wheelbase and limits.

    Returns:
        The section on an even grid.
    """
    grid = np.linspace(0.0, s[-1], 1 + max(FEWEST_CELLS, math.ceil(s[-1] / CELL)))
    cell = grid[1]
    # the window shrinks towards the ends: those keep their curvature, and the heading gained stays the same
    half_window = np.clip(np.minimum(grid, s[-1] - grid), cell, 0.5 * WINDOW)
    low, high = np.maximum(grid - half_window, 0.0), np.minimum(grid + half_window, s[-1])
    curvature = gear * (np.interp(high, s, theta) - np.interp(low, s, theta)) / (high - low)
    phi = np.clip(np.arctan(vehicle.wheelbase * curvature), -vehicle.phi_max, vehicle.phi_max)

    slope = np.abs(np.diff(phi)) / cell
    steepest = np.maximum(np.append(slope, 0.0), np.append(0.0, slope))
    v_cap = W_FRACTION * vehicle.w_max / np.maximum(steepest, NO_SLOPE)
    v_max = V_FRACTION * vehicle.v_max
    v_cap = np.clip(v_cap, min(V_CRAWL, v_max), v_max)
    v_cap[[0, -1]] = 0.0
    a = A_FRACTION * vehicle.a_max
    v = np.sqrt(np.maximum(slope_limited(v_cap**2, 2.0 * a * cell), 0.0))
    v[[0, -1]] = 0.0
    t = np.append(0.0, np.cumsum(2.0 * cell / (v[1:] + v[:-1])))
    swing_time = min(math.sqrt(2.0 * SWING_DISTANCE / a), t[-1] / 3.0)
    return Section(gear, grid, phi, v, t, swing_time)


def slope_limited(values: np.ndarray, step: float) -> np.ndarray:
    """The largest sequence below values (N,) that changes by at most step from one element to the next."""
    ramp = step * np.arange(len(values))
    rising = np.minimum.accumulate(values - ramp) + ramp
    falling = np.minimum.accumulate((values + ramp)[::-1])[::-1] - ramp
    return np.minimum(rising, falling)
