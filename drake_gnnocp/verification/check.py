"""The check of a trajectory against everything that a plan promises, one finding for every promise."""

from __future__ import annotations

import math

import numpy as np

from drake_gnnocp.ends import COORDINATE_TOLERANCE, Target, nearest_target
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.scenario_files import LARGEST
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import Input, State, Vehicle
from drake_gnnocp.verification.clearance import TIGHT, Clearances, Least, proven_clearances
from drake_gnnocp.verification.motion import Motion, motion_of
from drake_gnnocp.verification.result import (
    ASKED,
    COLLIDES,
    CONTACT,
    HEADING_TOLERANCE,
    LIMIT_TOLERANCE,
    NOT_AT_REST,
    OUTSIDE,
    OVER_LIMIT,
    POSITION_TOLERANCE,
    REST_TOLERANCE,
    UNPROVEN,
    Finding,
    Verification,
    off_goal,
    off_heading,
)

NOTHING = "nothing"  # is there to keep clear of


def verify(scenario: Scenario, trajectory: Trajectory) -> Verification:
    """Check a trajectory against everything a plan promises.

    Args:
        scenario: the task; best near the origin (see `Scenario.translated`).
        trajectory: in the scenario's frame, and in its unit of length; what is found is in metres.
    """
    if scenario.unit != 1.0:
        return verify(scenario.in_metres, trajectory.scaled(scenario.unit))
    motion = _drive_if_possible(scenario, trajectory)
    if motion is None:
        nan = math.nan
        return Verification(False, 0.0, nan, nan, nan, False, False, False, False, False)
    target = scenario.targets[nearest_target(scenario.targets, motion.states[-1, : State.V])]
    gap = np.linalg.norm(motion.states[motion.knots, : State.THETA] - trajectory.states[:, : State.THETA], axis=1)
    kept = proven_clearances(scenario, motion, target)
    contact, inside, asked, proof = clearances = _clearances(kept)
    limits, ends = _limits(scenario.vehicle, motion, trajectory), _at_rest(scenario, motion, trajectory)
    goal = _goal_errors(target, motion)
    return Verification(
        collision_free=contact.ok,
        min_clearance_m=max(kept.obstacles.proven, 0.0) if contact.ok else 0.0,
        terminal_position_error_m=goal[0],
        terminal_heading_error_rad=goal[1],
        max_dynamics_gap_m=float(gap.max()),
        limits_ok=all(finding.ok for finding in limits),
        bounds_ok=inside.ok,
        ends_ok=all(finding.ok for finding in ends),
        certified=proof.ok and contact.ok and inside.ok,
        clearance_ok=asked.ok,
        findings=(
            *(finding for finding in clearances if finding.found != NOTHING),
            *limits,
            *_at_goal(target, motion, *goal),
            *ends,
        ),
    )


def _drive_if_possible(scenario: Scenario, trajectory: Trajectory) -> Motion | None:
    """The driven motion, or None where numbers are missing, time does not advance or the inputs overflow."""
    if trajectory.flaw:
        return None
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            motion = motion_of(scenario.start, trajectory, scenario.vehicle)
    except OverflowError:
        return None
    # None for NaN as well
    return motion if np.abs(motion.states).max() <= LARGEST and motion.errors[-1] <= LARGEST else None


def _clearances(kept: Clearances) -> tuple[Finding, Finding, Finding, Finding]:
    """On contact, the bounds, the clearance that is asked for, and the proof that neither of the first is touched."""
    free, inside, beyond = kept.obstacles, kept.bounds, kept.beyond_demand
    apart, is_inside = free.seen > 0, inside.seen >= -COORDINATE_TOLERANCE
    touches = not (apart and is_inside)
    proven = math.inf if touches else min(free.proven, inside.proven + kept.over)
    # what is refused as it was seen is not proven to be no less
    kept_clearance = kept.asked + (beyond.seen if beyond.seen < -TIGHT else beyond.proven)
    too_near = f"keeps {_rounded_down(kept_clearance):.2f} m where {kept.asked:.2f} m are asked"
    return (
        _least(free, CONTACT, "above 0 m", free.seen, apart, COLLIDES),
        _least(inside, "distance inside the bounds", "at least 0 m", inside.seen, is_inside, OUTSIDE),
        _least(beyond, ASKED, f"at least {kept.asked:.3f} m", kept_clearance, beyond.proven >= -TIGHT, too_near),
        _least(
            free if free.proven <= inside.proven else inside, "as proven", "above 0 m", proven, proven > 0, UNPROVEN
        ),
    )


def _rounded_down(length: float) -> float:
    """To centimetres, but for rounding [m]."""
    return math.floor(100 * max(length, 0.0) + 1e-3) / 100 if math.isfinite(length) else length


def _least(least: Least, what: str, allowed: str, found: float, ok: bool, fault: str) -> Finding:
    return Finding(what, allowed, f"{found:.3f} m" if math.isfinite(found) else NOTHING, ok, fault, *least.place)


def _limits(vehicle: Vehicle, motion: Motion, trajectory: Trajectory) -> list[Finding]:
    """On |v|, |phi|, |a| and |w|, each where it is first beyond its limit, or largest."""
    sizes = np.abs(trajectory.inputs).T
    peaks = (
        ("speed", vehicle.v_max, motion.peaks[0], "m/s"),
        ("steering angle", vehicle.phi_max, motion.peaks[1], "rad"),
        ("acceleration", vehicle.a_max, sizes[Input.A], "m/s^2"),
        ("steering rate", vehicle.w_max, sizes[Input.W], "rad/s"),
    )
    found = []
    for what, limit, values, unit in peaks:
        beyond = values > limit * (1 + LIMIT_TOLERANCE)
        place = _sample(motion, motion.knots[int((beyond if beyond.any() else values).argmax())])
        texts = (f"at most {limit:g} {unit}", f"{values.max():.4g} {unit}")
        found.append(Finding(what, *texts, not beyond.any(), OVER_LIMIT, *place))
    return found


def _goal_errors(target: Target, motion: Motion) -> tuple[float, float]:
    """How far the motion may end beside the goal, beyond its tolerance: in x or y [m] and in the heading [rad]."""
    beyond, errors = np.abs(target.offset(motion.states[-1, : State.V])) - target.half_sizes, motion.errors[-1]
    position = max(float(beyond[:2].max() + errors), 0.0)
    return position, max(float(beyond[2]) + motion.heading_error, 0.0)


def _at_goal(target: Target, motion: Motion, position: float, heading: float) -> list[Finding]:
    """On the end's place and heading; what is beyond the scenario's tolerance may be as much as without one."""
    place, degrees, (x, y, turn) = _sample(motion, -1), math.degrees, target.half_sizes
    beyond = f" beyond {x:g} and {y:g} m" if x or y else ""
    texts = (f"at most {POSITION_TOLERANCE} m{beyond}", f"{position:.4f} m")
    in_degrees = (f"at most {degrees(HEADING_TOLERANCE):g} degrees", f"{degrees(heading):.3f} degrees")
    if target.is_free:
        in_degrees = ("any", f"{degrees(motion.states[-1, State.THETA]):.3f} degrees")
    elif turn:
        in_degrees = (f"{in_degrees[0]} beyond {degrees(turn):g}", in_degrees[1])
    return [
        Finding("x and y at the goal", *texts, position <= POSITION_TOLERANCE, off_goal(position), *place),
        Finding("heading at the goal", *in_degrees, heading <= HEADING_TOLERANCE, off_heading(heading), *place),
    ]


def _at_rest(scenario: Scenario, motion: Motion, trajectory: Trajectory) -> list[Finding]:
    """On the first knot's pose, and on v, phi, a and w at both ends, as stated and as driven."""
    stated = np.abs(np.hstack([trajectory.states, trajectory.inputs])[[0, -1], State.V :]).max(axis=1)
    errors = (
        ("pose at the start", float(np.abs(trajectory.poses[0] - scenario.start).max()), 0),
        ("v, phi, a, w at the start", float(stated[0]), 0),
        ("v, phi, a, w at the goal", float(max(stated[1], np.abs(motion.states[-1, State.V :]).max())), -1),
    )
    allowed = f"at most {REST_TOLERANCE:g}"
    return [
        Finding(what, allowed, f"{error:.4g}", error <= REST_TOLERANCE, NOT_AT_REST, *_sample(motion, i))
        for what, error, i in errors
    ]


def _sample(motion: Motion, i: int) -> tuple[float, float, float]:
    """Time and place of a sample."""
    return float(motion.t[i]), float(motion.states[i, State.X]), float(motion.states[i, State.Y])
