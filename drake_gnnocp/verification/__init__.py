"""Verification of a plan by code that shares nothing with the optimal control problem or the simulation.

The inputs of the trajectory, linear between knots, drive the bicycle model from the scenario's start (`motion`). What a
plan promises is proven for all times, not only at samples: no contact with the exact polygons, and the bounds, with the
errors of the integration and of rounding accounted for (`clearance`); the limits, since v, phi, a and w are known in
closed form; both ends.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from drake_gnnocp.scenario import COORDINATE_TOLERANCE, Scenario
from drake_gnnocp.scenario_files import LARGEST
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import Input, State, Vehicle
from drake_gnnocp.verification.clearance import TIGHT, min_clearance, proven_clearance, proven_inside
from drake_gnnocp.verification.motion import Motion, motion_of

__all__ = ["HEADING_TOLERANCE", "LIMIT_TOLERANCE", "POSITION_TOLERANCE", "Verification", "min_clearance", "verify"]

POSITION_TOLERANCE = 0.01  # m, in x and in y at the goal
HEADING_TOLERANCE = math.radians(1.0)  # rad, at the goal
LIMIT_TOLERANCE = 1e-3  # relative, v, a, phi, w
REST_TOLERANCE = 1e-3  # start state, and v, phi, a, w at both ends


@dataclass(frozen=True)
class Verification:
    """What the check found; `verified` sums it up."""

    collision_free: bool
    min_clearance_m: float  # m, proven lower bound over all times, 0 where none is, inf without obstacles
    terminal_position_error_m: float  # m, the larger of x and y
    terminal_heading_error_rad: float  # rad
    max_dynamics_gap_m: float  # m, knots as stated against knots as driven
    limits_ok: bool
    bounds_ok: bool
    ends_ok: bool  # starts at the start; v = phi = a = w = 0 at both ends
    certified: bool  # whether it is proven for all times that the car keeps clear of obstacles and inside the bounds

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
            "is not proven to keep clear at all times": self.certified or not (self.collision_free and self.bounds_ok),
            "does not start or end at rest as asked": self.ends_ok,
        }
        return [fault for fault, ok in checks.items() if not ok]

    def to_dict(self) -> dict[str, Any]:
        """All findings by name; what is infinite (no obstacles) or NaN becomes None, as JSON has neither."""
        return {name: value if math.isfinite(value) else None for name, value in asdict(self).items()}


def verify(scenario: Scenario, trajectory: Trajectory) -> Verification:
    """Check a trajectory against everything a plan promises.

    Args:
        scenario: the task; best near the origin (see `Scenario.translated`).
        trajectory: in the scenario's frame.
    """
    motion = _drive_if_possible(scenario, trajectory)
    if motion is None:
        nan = math.nan
        return Verification(False, 0.0, nan, nan, nan, False, False, False, False)
    error = motion.states[-1, :3] - scenario.goal
    knots = motion.states[:: motion.steps_per_interval, : State.THETA]
    gap = np.linalg.norm(knots - trajectory.states[:, : State.THETA], axis=1)
    clearance, sampled_clearance = proven_clearance(scenario, motion)
    inside, sampled_inside = proven_inside(scenario, motion)
    return Verification(
        collision_free=sampled_clearance > 0,
        min_clearance_m=max(clearance, 0.0),
        terminal_position_error_m=float(np.abs(error[:2]).max() + motion.errors[-1]),
        terminal_heading_error_rad=abs(_wrapped(float(error[2]))) + float(motion.heading_errors[-1]),
        max_dynamics_gap_m=float(gap.max()),
        limits_ok=_within_limits(scenario.vehicle, motion, trajectory),
        bounds_ok=sampled_inside >= -COORDINATE_TOLERANCE,
        ends_ok=_ends_at_rest(scenario, motion, trajectory),
        certified=clearance > 0 and inside >= -TIGHT,
    )


def _drive_if_possible(scenario: Scenario, trajectory: Trajectory) -> Motion | None:
    """The driven motion, or None where numbers are missing, time does not advance or the inputs overflow."""
    numbers = np.column_stack([trajectory.t, trajectory.states, trajectory.inputs])
    if not np.isfinite(numbers).all() or not (np.diff(trajectory.t) > 0).all():
        return None
    with np.errstate(over="ignore", invalid="ignore"):
        motion = motion_of(scenario.start, trajectory, scenario.vehicle)
    return motion if np.abs(motion.states).max() <= LARGEST else None  # None for NaN as well


def _within_limits(vehicle: Vehicle, motion: Motion, trajectory: Trajectory) -> bool:
    peaks = [
        (vehicle.v_max, motion.peaks[:1]),
        (vehicle.phi_max, motion.peaks[1:]),
        (vehicle.a_max, trajectory.inputs[:, Input.A]),
        (vehicle.w_max, trajectory.inputs[:, Input.W]),
    ]
    return all(np.abs(values).max() <= limit * (1 + LIMIT_TOLERANCE) for limit, values in peaks)


def _ends_at_rest(scenario: Scenario, motion: Motion, trajectory: Trajectory) -> bool:
    start_error = trajectory.states[0, :3] - scenario.start
    ends = np.hstack([trajectory.states, trajectory.inputs])[[0, -1], State.V :]
    at_rest = np.append(ends, motion.states[-1, State.V :])
    return bool(np.abs(start_error).max() <= REST_TOLERANCE and np.abs(at_rest).max() <= REST_TOLERANCE)


def _wrapped(angle: float) -> float:
    """The angle in [-pi, pi] [rad]."""
    return math.remainder(angle, 2 * math.pi)
