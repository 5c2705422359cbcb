"""Bounds on the numbers of the knots: the vehicle's limits, the trust region, and both ends.

Where the last pose is a variable, its place is bounded along and across the goal's heading: by linear rows.
"""

from __future__ import annotations

import numpy as np

from drake_gnnocp.ocp.formulation import Formulation
from drake_gnnocp.ocp.rows import N_KNOT, N_STATES, POSE, Box, V

MOTION = np.arange(V, N_KNOT)  # v, phi, a, w
NEAR_LIMIT = 0.5  # of a limit: what is beyond it gets rows where not all of them are written


def motion_limits(formulation: Formulation) -> np.ndarray:
    """What |v|, |phi|, |a|, |w| are limited to: the vehicle's limits less the margin: (4,) [m/s, rad, m/s^2, rad/s]."""
    vehicle = formulation.vehicle
    most = np.array([vehicle.v_max, vehicle.phi_max, vehicle.a_max, vehicle.w_max])
    return (1 - formulation.limits_margin) * most


def limits(formulation: Formulation) -> Box:
    """The limits at every knot but the ends."""
    inner = np.arange(1, len(formulation.reference) - 1)
    most = np.tile(motion_limits(formulation), (len(inner), 1))
    return Box("limits", inner, MOTION, -most, most)


def trust_region(formulation: Formulation) -> Box | None:
    """Poses no farther from the reference's than the trust region, where there is one.

    It keeps the solver from jumping over thin obstacles, and to places where no rows guard it.
    """
    if formulation.trust_region is None:
        return None
    inner = np.arange(1, len(formulation.reference) - (formulation.target is None))
    poses, radius = formulation.reference.poses[inner], np.array(formulation.trust_region)
    return Box("trust region", inner, POSE, poses - radius, poses + radius)


def ends(formulation: Formulation) -> list[Box]:
    """Start and goal: the states asked for, with a = w = 0 (the paper's boundary conditions)."""
    boxes = []
    for name, knot, state in (("start", 0, formulation.start), ("goal", -1, formulation.goal)):
        lower = np.append(state, np.zeros(N_KNOT - N_STATES))[None]
        upper = lower.copy()
        if name == "goal" and formulation.target is not None:
            half = np.array([np.inf, np.inf, formulation.target.half_sizes[2]])  # `end_place` has x and y
            lower[:, POSE], upper[:, POSE] = lower[:, POSE] - half, upper[:, POSE] + half
        boxes.append(Box(name, np.array([knot]), np.arange(N_KNOT), lower, upper))
    return boxes


def end_place(formulation: Formulation) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """What bounds the last x and y where they are variables: lower <= matrix @ (x, y) <= upper; else None.

    Returns:
        The matrix (2, 2), lower (2,) and upper (2,) [m].
    """
    if formulation.target is None:
        return None
    axes, half = formulation.target.axes, formulation.target.half_sizes[:2]
    middle = axes @ formulation.goal[:2]
    return axes, middle - half, middle + half
