"""What a verification found: every check with what was allowed, and where and when the worst of it was."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from typing import Any

POSITION_TOLERANCE = 0.01  # m, in x and in y at the goal
HEADING_TOLERANCE = math.radians(1.0)  # rad, at the goal
LIMIT_TOLERANCE = 1e-3  # relative, v, a, phi, w
REST_TOLERANCE = 1e-3  # start state, and v, phi, a, w at both ends
COLLIDES, OUTSIDE, OVER_LIMIT = "collides with an obstacle", "leaves the bounds", "exceeds a limit of the vehicle"
UNPROVEN, NOT_AT_REST = "is not proven to keep clear at all times", "does not start or end at rest as asked"
CONTACT, ASKED = "distance to obstacles", "clearance asked for"  # what was checked


@dataclass(frozen=True)
class Finding:
    """One thing that was checked: what was allowed and what was found, where and when it was worst."""

    what: str
    allowed: str
    found: str
    ok: bool
    fault: str  # what to call it where it is not ok
    t: float  # s
    x: float  # m
    y: float  # m


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
    clearance_ok: bool = True  # whether it is proven for all times that the car keeps the clearance asked for
    findings: tuple[Finding, ...] = ()  # one by one; empty where nothing can be driven

    @property
    def verified(self) -> bool:
        """Whether the plan may be called solved."""
        return not self.faults

    @property
    def faults(self) -> list[str]:
        """Everything that keeps the plan from being verified."""
        touches = not (self.collision_free and self.bounds_ok)
        checks = {
            COLLIDES: self.collision_free,
            off_goal(self.terminal_position_error_m): self.terminal_position_error_m <= POSITION_TOLERANCE,
            off_heading(self.terminal_heading_error_rad): self.terminal_heading_error_rad <= HEADING_TOLERANCE,
            OVER_LIMIT: self.limits_ok,
            OUTSIDE: self.bounds_ok,
            UNPROVEN: self.certified or touches,
            self._too_near: self.clearance_ok or touches,
            NOT_AT_REST: self.ends_ok,
        }
        return [fault for fault, ok in checks.items() if not ok]

    @property
    def _too_near(self) -> str:
        texts = [finding.fault for finding in self.findings if finding.what == ASKED]
        return texts[0] if texts else "keeps less clearance than is asked for"

    @property
    def first_fault(self) -> Finding | None:
        """The fault that a drive meets first, where it is known."""
        return min(self._broken, key=lambda finding: finding.t) if self._broken else None

    @property
    def _broken(self) -> list[Finding]:
        return [finding for finding in self.findings if not finding.ok]

    @property
    def nearest(self) -> tuple[float, float, float] | None:
        """Where and when the clearance is least: t, x, y [s, m, m]; None without obstacles."""
        contacts = [finding for finding in self.findings if finding.what == CONTACT]
        return (contacts[0].t, contacts[0].x, contacts[0].y) if contacts else None

    @property
    def clearance_text(self) -> str:
        """The least clearance and where it is, in a few words."""
        if not math.isfinite(self.min_clearance_m):
            return "no obstacles"
        at = f" at ({self.nearest[1]:.1f}, {self.nearest[2]:.1f})" if self.nearest else ""
        return f"clearance {self.min_clearance_m:.2f} m{at}"

    def translated(self, dx: float, dy: float) -> Verification:
        """What is found of the same motion moved by (dx, dy) [m]."""
        return replace(self, findings=tuple(_moved(finding, dx, dy) for finding in self.findings))

    def to_dict(self) -> dict[str, Any]:
        """All findings by name; what is infinite (no obstacles) or NaN becomes None, as JSON has neither."""
        values = asdict(replace(self, findings=()))
        del values["findings"]
        plain = {name: value if math.isfinite(value) else None for name, value in values.items()}
        faults = [{key: getattr(finding, key) for key in ("fault", "t", "x", "y")} for finding in self._broken]
        return {**plain, "min_clearance_at": self.nearest and list(self.nearest), "faults": faults}


def _moved(finding: Finding, dx: float, dy: float) -> Finding:
    return replace(finding, x=float(finding.x + dx), y=float(finding.y + dy))


def off_goal(error: float) -> str:
    """The fault of a plan that ends so far off the goal [m]."""
    return f"ends {error:.3f} m off the goal"


def off_heading(error: float) -> str:
    """The fault of a plan that ends with so much error of its heading [rad]."""
    return f"ends {math.degrees(error):.1f} degrees off the goal's heading"
