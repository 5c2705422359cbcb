"""Bounds on the numbers of the knots: the vehicle's limits, the trust region, and both ends."""

from __future__ import annotations

import numpy as np

from drake_gnnocp.ocp.formulation import Formulation
from drake_gnnocp.ocp.rows import N_KNOT, N_STATES, POSE, Box, V
from drake_gnnocp.vehicle import Vehicle

MOTION = np.arange(V, N_KNOT)  # v, phi, a, w


def motion_limits(vehicle: Vehicle) -> np.ndarray:
    """What |v|, |phi|, |a| and |w| are limited to: (4,) [m/s, rad, m/s^2, rad/s]."""
    return np.array([vehicle.v_max, vehicle.phi_max, vehicle.a_max, vehicle.w_max])


def limits(formulation: Formulation) -> Box:
    """|v|, |phi|, |a|, |w| within the vehicle's limits, less a relative margin, at every knot but the ends."""
    inner = np.arange(1, len(formulation.reference) - 1)
    most = np.tile((1 - formulation.limits_margin) * motion_limits(formulation.vehicle), (len(inner), 1))
    return Box("limits", inner, MOTION, -most, most)


def trust_region(formulation: Formulation) -> Box | None:
    """Poses no farther from the reference's than the trust region, where there is one.

    It keeps the solver from jumping over thin obstacles, and to places where no rows guard it.
    """
    if formulation.trust_region is None:
        return None
    inner = np.arange(1, len(formulation.reference) - 1)
    poses, radius = formulation.reference.poses[inner], np.array(formulation.trust_region)
    return Box("trust region", inner, POSE, poses - radius, poses + radius)


def ends(formulation: Formulation) -> list[Box]:
    """Start and goal: the states asked for, with a = w = 0 (the paper's boundary conditions)."""
    boxes = []
    for name, knot, state in (("start", 0, formulation.start), ("goal", -1, formulation.goal)):
        values = np.append(state, np.zeros(N_KNOT - N_STATES))[None]
        boxes.append(Box(name, np.array([knot]), np.arange(N_KNOT), values, values))
    return boxes
