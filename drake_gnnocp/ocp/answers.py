"""What the next solve is asked for, after the check of a plan."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from drake_gnnocp.ocp.close_pairs import Pair, close_pairs
from drake_gnnocp.ocp.formulation import Formulation, Line
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.simulation import DrivenMotion, drive
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import State
from drake_gnnocp.verification import HEADING_TOLERANCE, POSITION_TOLERANCE

LIMITS_STEP, LARGEST_LIMITS_MARGIN = 0.002, 0.5  # relative, added to what v or phi were exceeded by; most in all
LEFT_BY_STEPS = 1.0  # of their distance to an obstacle: SQP steps leave the margins that they were asked for
# where SQP steps have converged, little moves any more: Ipopt with its approximate Hessian is kept near there, or it
# wanders off along flat directions of long plans, for hundreds of iterations
FINISH_ROWS_WITHIN, FINISH_TRUST_REGION = 1.2, (0.15, 0.15, 0.1)  # m; m, m, rad


def to_finish(formulation: Formulation, found: Trajectory) -> Formulation:
    """The formulation near where SQP steps have ended."""
    return replace(
        formulation,
        reference=found,
        reference_share=LEFT_BY_STEPS,
        rows_within=FINISH_ROWS_WITHIN,
        trust_region=FINISH_TRUST_REGION,
    )


def answer(scenario: Scenario, formulation: Formulation, found: Trajectory) -> Formulation:
    """The formulation that asks for what the check missed in a converged plan, around that plan."""
    motion = drive(scenario.start, found, scenario.vehicle)
    excess = _beyond_limits(scenario, motion)
    limits_margin = formulation.limits_margin + excess + LIMITS_STEP
    answered = replace(
        formulation,
        reference=found,
        goal=_aimed_goal(scenario, formulation, motion, found),
        limits_margin=min(LARGEST_LIMITS_MARGIN, limits_margin) if excess > 0 else formulation.limits_margin,
    )
    return with_lines(answered, close_pairs(answered, motion))


def _aimed_goal(scenario: Scenario, formulation: Formulation, motion: DrivenMotion, found: Trajectory) -> np.ndarray:
    """The goal, or as far beside it as the driven motion ends to the other side."""
    at, end = formulation.goal[: State.V], motion.states[-1, : State.V]
    turns = 2 * np.pi * np.round((at[State.THETA] - scenario.goal[State.THETA]) / (2 * np.pi))
    error = end - (scenario.goal + [0.0, 0.0, turns])
    if formulation.target is not None:
        beyond = formulation.target.excess(end)
        error = np.append(beyond[:2] @ formulation.target.axes, beyond[2])
    if np.abs(error[:2]).max() <= POSITION_TOLERANCE / 2 and abs(error[2]) <= HEADING_TOLERANCE / 2:
        return formulation.goal
    return np.append(at - error, formulation.goal[State.V :])


def _beyond_limits(scenario: Scenario, motion: DrivenMotion) -> float:
    """How far v or phi exceed their limits anywhere, relative to them; negative when they do not."""
    v, phi = np.abs(motion.states[:, [State.V, State.PHI]]).max(axis=0)
    return float(max(v / scenario.vehicle.v_max, phi / scenario.vehicle.phi_max)) - 1.0


def with_lines(formulation: Formulation, close: dict[Pair, float]) -> Formulation:
    """The formulation where the pairs that came too close have a line, or a line with more clearance than before."""
    clearances = {(line.interval, line.obstacle): line.clearance for line in formulation.lines}
    asked = formulation.between(*np.array(list(close), dtype=int).reshape(-1, 2).T).tolist()
    for (pair, distance), least in zip(close.items(), asked, strict=True):
        if pair not in clearances:
            clearances[pair] = least
        elif distance < least:
            clearances[pair] = max(least, clearances[pair] + min(least - distance, least))
    lines = tuple(Line(interval, j, clearance) for (interval, j), clearance in sorted(clearances.items()))
    return replace(formulation, lines=lines)
