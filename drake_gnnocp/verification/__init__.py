"""Verification of a plan by code that shares nothing with the optimal control problem or the simulation.

The inputs of the trajectory, linear between knots, drive the bicycle model from the scenario's start (`motion`). What a
plan promises is proven for all times, not only at samples: no contact with the exact polygons, the clearance that is
asked for, and the bounds, with the errors of the integration and of rounding accounted for (`clearance`); the limits,
since v, phi, a and w are known in closed form; both ends.
"""

from drake_gnnocp.verification.check import verify
from drake_gnnocp.verification.clearance import min_clearance
from drake_gnnocp.verification.result import (
    HEADING_TOLERANCE,
    LIMIT_TOLERANCE,
    POSITION_TOLERANCE,
    Finding,
    Verification,
)

__all__ = [
    "HEADING_TOLERANCE",
    "LIMIT_TOLERANCE",
    "POSITION_TOLERANCE",
    "Finding",
    "Verification",
    "min_clearance",
    "verify",
]
