r"""Verification of a plan by code that shares nothing with the optimal control problem or the simulation.

The inputs of the trajectory, linear between knots, drive the bicycle model from the scenario's start. With them v and
phi are known in closed form (quadratics in time), so theta, x and y are plain integrals,

    theta(t) = theta_0 + int v tan(phi) / L_w dt,  x(t) = x_0 + int v cos(theta) dt,  y(t) = y_0 + int v sin(theta) dt,

which Simpson's rule gives on steps of at most 5 ms. The footprint is then checked against the exact polygons.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import shapely

from drake_gnnocp.scenario import COORDINATE_TOLERANCE, Scenario
from drake_gnnocp.scenario_files import LARGEST
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import Input, State, Vehicle

MAX_STEP = 0.005  # s, of the integration
CHECK_STEP = 2  # footprints are checked at every second integration step, 10 ms apart
LOOK_EVERY = 16  # footprints, whose clearance tells which of the others can have less
POSITION_TOLERANCE = 0.01  # m, in x and in y at the goal
HEADING_TOLERANCE = math.radians(1.0)  # rad, at the goal
LIMIT_TOLERANCE = 1e-3  # relative, v, a, phi, w
REST_TOLERANCE = 1e-3  # start state, and v, phi, a, w at both ends


@dataclass(frozen=True)
class Verification:
    """What the dense check found; `verified` sums it up."""

    collision_free: bool
    min_clearance_m: float  # m, footprint to the nearest polygon, 0 in a collision, inf without obstacles
    terminal_position_error_m: float  # m, the larger of x and y
    terminal_heading_error_rad: float  # rad
    max_dynamics_gap_m: float  # m, knots as stated against knots as driven
    limits_ok: bool
    bounds_ok: bool
    ends_ok: bool  # starts at the start; v = phi = a = w = 0 at both ends

    @property
    def verified(self) -> bool:
        """Whether the plan may be called solved."""
        return not self.faults

    @property
    def faults(self) -> list[str]:
        """Everything that keeps the plan from being verified."""
        checks = {
            "collides with an obstacle": self.collision_free,
            f"ends {self.terminal_position_error_m:.3f} m off the goal": (
                self.terminal_position_error_m <= POSITION_TOLERANCE
            ),
            f"ends {math.degrees(self.terminal_heading_error_rad):.1f} degrees off the goal's heading": (
                self.terminal_heading_error_rad <= HEADING_TOLERANCE
            ),
            "exceeds a limit of the vehicle": self.limits_ok,
            "leaves the bounds": self.bounds_ok,
            "does not start or end at rest as asked": self.ends_ok,
        }
        return [fault for fault, ok in checks.items() if not ok]

    def to_dict(self) -> dict[str, Any]:
        """All findings by name; what is infinite (no obstacles) or NaN becomes None, as JSON has neither."""
        return {name: value if math.isfinite(value) else None for name, value in asdict(self).items()}


@dataclass(frozen=True)
class _Motion:
    """What the car does, by the integration of this module."""

    states: np.ndarray  # (M, 5) x, y, theta, v, phi, at most MAX_STEP apart, every knot among them
    steps_per_interval: int  # knot k is sample k * steps_per_interval


def _motion(start: np.ndarray, trajectory: Trajectory, vehicle: Vehicle) -> _Motion:
    """The motion from start, at rest, with the trajectory's inputs; its states are not used."""
    h = np.diff(trajectory.t)
    steps = max(2, CHECK_STEP * math.ceil(float(h.max()) / MAX_STEP / CHECK_STEP))
    tau = np.arange(2 * steps) / (2 * steps)  # fractions of an interval: every step and every half step
    a0, w0 = trajectory.inputs[:-1].T
    da, dw = np.diff(trajectory.inputs, axis=0).T
    v = _integral_of_linear(a0, da, h, tau)
    phi = _integral_of_linear(w0, dw, h, tau)
    step = np.repeat(h / steps, steps)  # (M - 1,) s
    theta_rate = v * np.tan(phi) / vehicle.wheelbase
    theta = _cumulative_at_half_steps(start[2], theta_rate, step)
    x = _cumulative_simpson(start[0], v * np.cos(theta), step)
    y = _cumulative_simpson(start[1], v * np.sin(theta), step)
    return _Motion(np.column_stack([x, y, theta[::2], v[::2], phi[::2]]), steps)


def _integral_of_linear(u0: np.ndarray, du: np.ndarray, h: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """Integral of u from 0 at the first knot, for u = u0 + du tau on every interval: (2 steps intervals + 1,)."""
    within = h[:, None] * (u0[:, None] * tau + 0.5 * du[:, None] * tau**2)
    at_knots = np.append(0.0, np.cumsum(h * (u0 + 0.5 * du)))
    return np.append((at_knots[:-1, None] + within).ravel(), at_knots[-1])


def _cumulative_simpson(initial: float, rate: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Integral at every step of a rate known at every half step."""
    area = step / 6 * (rate[:-2:2] + 4 * rate[1:-1:2] + rate[2::2])
    return initial + np.append(0.0, np.cumsum(area))


def _cumulative_at_half_steps(initial: float, rate: np.ndarray, step: np.ndarray) -> np.ndarray:
    """As `_cumulative_simpson`, and in between by the parabola through the same three rates."""
    values = np.empty_like(rate)
    values[::2] = _cumulative_simpson(initial, rate, step)
    values[1::2] = values[:-2:2] + step / 24 * (5 * rate[:-2:2] + 8 * rate[1:-1:2] - rate[2::2])
    return values


def verify(scenario: Scenario, trajectory: Trajectory) -> Verification:
    """Check a trajectory against everything a plan promises.

    Args:
        scenario: the task; best near the origin (see `Scenario.translated`).
        trajectory: in the scenario's frame.
    """
    motion = _drive_if_possible(scenario, trajectory)
    if motion is None:
        nan = math.nan
        return Verification(False, 0.0, nan, nan, nan, False, False, False)
    error = motion.states[-1, :3] - scenario.goal
    knots = motion.states[:: motion.steps_per_interval, : State.THETA]
    gap = np.linalg.norm(knots - trajectory.states[:, : State.THETA], axis=1)
    footprints = scenario.vehicle.footprints(motion.states[::CHECK_STEP, :3])
    clearance = min_clearance(scenario, footprints)
    return Verification(
        collision_free=clearance > 0,
        min_clearance_m=clearance,
        terminal_position_error_m=float(np.abs(error[:2]).max()),
        terminal_heading_error_rad=abs(_wrapped(float(error[2]))),
        max_dynamics_gap_m=float(gap.max()),
        limits_ok=_within_limits(scenario.vehicle, motion, trajectory),
        bounds_ok=_within_bounds(scenario, footprints),
        ends_ok=_ends_at_rest(scenario, motion, trajectory),
    )


def _drive_if_possible(scenario: Scenario, trajectory: Trajectory) -> _Motion | None:
    """The driven motion, or None where numbers are missing, time does not advance or the inputs overflow."""
    numbers = np.column_stack([trajectory.t, trajectory.states, trajectory.inputs])
    if not np.isfinite(numbers).all() or not (np.diff(trajectory.t) > 0).all():
        return None
    with np.errstate(over="ignore", invalid="ignore"):
        motion = _motion(scenario.start, trajectory, scenario.vehicle)
    return motion if np.abs(motion.states).max() <= LARGEST else None  # None for NaN as well


def min_clearance(scenario: Scenario, footprints: np.ndarray) -> float:
    """Smallest distance of the footprints (N, 4, 2) to the exact polygons [m]; inf without obstacles.

    A footprint is no nearer to an obstacle than another one less the way of the corner that moves most in between: so
    of a motion few need to be looked at.
    """
    if not scenario.polygons:
        return math.inf
    tree = shapely.STRtree(scenario.polygons)

    def distances(which: np.ndarray) -> np.ndarray:
        return tree.query_nearest(shapely.polygons(footprints[which]), return_distance=True, all_matches=False)[1]

    looked_at = np.unique(np.append(np.arange(0, len(footprints), LOOK_EVERY), len(footprints) - 1))
    found = distances(looked_at)
    way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(footprints, axis=0), axis=2).max(axis=1, initial=0.0)))
    after = np.searchsorted(looked_at, np.arange(len(footprints)))
    before = np.maximum(after - 1, 0)
    least = np.maximum(
        found[before] - np.abs(way - way[looked_at[before]]), found[after] - np.abs(way[looked_at[after]] - way)
    )
    rest = np.flatnonzero(least < found.min())
    return float(min(found.min(), distances(rest).min(initial=math.inf)))


def _within_limits(vehicle: Vehicle, motion: _Motion, trajectory: Trajectory) -> bool:
    peaks = [
        (vehicle.v_max, motion.states[:, State.V]),
        (vehicle.phi_max, motion.states[:, State.PHI]),
        (vehicle.a_max, trajectory.inputs[:, Input.A]),
        (vehicle.w_max, trajectory.inputs[:, Input.W]),
    ]
    return all(np.abs(values).max() <= limit * (1 + LIMIT_TOLERANCE) for limit, values in peaks)


def _within_bounds(scenario: Scenario, footprints: np.ndarray) -> bool:
    if scenario.bounds is None:
        return True
    xmin, xmax, ymin, ymax = scenario.bounds
    low, high = footprints.min(axis=(0, 1)), footprints.max(axis=(0, 1))
    inside = min(low[0] - xmin, xmax - high[0], low[1] - ymin, ymax - high[1])
    return bool(inside >= -COORDINATE_TOLERANCE)


def _ends_at_rest(scenario: Scenario, motion: _Motion, trajectory: Trajectory) -> bool:
    start_error = trajectory.states[0, :3] - scenario.start
    ends = np.hstack([trajectory.states, trajectory.inputs])[[0, -1], State.V :]
    at_rest = np.append(ends, motion.states[-1, State.V :])
    return bool(np.abs(start_error).max() <= REST_TOLERANCE and np.abs(at_rest).max() <= REST_TOLERANCE)


def _wrapped(angle: float) -> float:
    """The angle in [-pi, pi] [rad]."""
    return math.remainder(angle, 2 * math.pi)
