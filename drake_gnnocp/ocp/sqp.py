r"""Sequential quadratic programming: steps that pull a rough guess near the optimum before Ipopt finishes it.

The quadratic program of a step is in `step_program`. J1 has its exact Hessian there, which a limited-memory BFGS has to
find out iteration by iteration. Only what keeps the car from obstacles is soft: a step that meets the dynamics exists
almost always, however far the guess is from them. rho falls as the steps get shorter, and the defects fall with their
square.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np

from drake_gnnocp.budget import Budget
from drake_gnnocp.ocp.formulation import Formulation
from drake_gnnocp.ocp.rows import N_STATES
from drake_gnnocp.ocp.step_program import StepProgram
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import State

USABLE_DEFECT = 0.1  # m (and rad), largest one with which steps that did not converge are still worth a start
CONVERGED_VIOLATION = 0.01  # m
HOPELESS_VIOLATION = 0.3  # m: steps that still lead so far into obstacles after a while are given up
LONGEST_STEP = np.array([1.5, 1.5, 0.5])  # m, m, rad: longer steps are shortened to it
RELAXATION, DAMPING = 0.1, 10.0  # what rho is multiplied by after a step that is shorter, or not: solutions take turns
# steps, 1/s, -; from so many steps on rho is at least this and grows with every step: solutions settle somewhere then
LATE, LATE_PROXIMAL, LATE_GROWTH = 20, 0.01, 1.15
SHORTER = 0.8  # of the step before: what counts as shorter


@dataclass(frozen=True)
class SqpSettings:
    """How far the steps go."""

    proximal: float = 0.1  # 1/s, rho of the first step
    converged_cost: float = 2e-3  # relative, change of the cost in the last step before a stop
    converged_defect: float = 1e-4  # m (and rad), largest defect left
    most_steps: int = 60
    patience: int = 30  # steps, after which those that lead into obstacles are given up


SEARCHED = SqpSettings()
# learned guesses begin near the optimum, so a first step may be long, and what a last small step would gain, Ipopt
# gains as well: on validation maps a fifth fewer steps. Of those that converged later than the fifth, 97 % had a
# violation below 0.3 m by then
LEARNED = SqpSettings(proximal=0.03, converged_cost=1e-2, converged_defect=1e-3, most_steps=12, patience=5)


@dataclass(frozen=True, eq=False)
class SqpSteps:
    """Where the steps ended."""

    trajectory: Trajectory
    steps: int
    converged: bool  # the cost had stopped to change, with defects and violation below their tolerances
    violation: float  # m, largest one of the half planes, inf where it is not known
    seconds: float  # s


def sqp_steps(formulation: Formulation, settings: SqpSettings, budget: Budget) -> SqpSteps:
    """Take steps until they have converged or there were enough.

    Args:
        formulation: the problem, for a fixed time step.
        settings: see `SqpSettings`.
        budget: when it is over, no step begins.

    Returns:
        The reference itself where a program could not be solved, or the steps led to nothing that can be driven.
    """
    begin = time.perf_counter()
    program = StepProgram(formulation)
    iterate, cost, proximal, longest = program.first_iterate(), math.inf, settings.proximal, math.inf
    steps, converged = 0, False
    while steps < settings.most_steps and not converged and not budget.is_over:
        change = program.solve(iterate, proximal)
        if change is None:  # the limits that the last step went beyond cannot be held
            return SqpSteps(formulation.reference, steps, False, math.inf, time.perf_counter() - begin)
        before, longest_before = cost, longest
        longest = float((np.abs(change[:, : State.V]).max(axis=0) / LONGEST_STEP).max())
        iterate, steps = program.iterate(iterate.knots + change / max(1.0, longest)), steps + 1
        cost = iterate.cost
        proximal *= RELAXATION if longest < SHORTER * longest_before else DAMPING
        proximal = max(proximal, LATE_PROXIMAL * LATE_GROWTH ** (steps - LATE)) if steps >= LATE else proximal
        converged = (
            abs(before - cost) < settings.converged_cost * cost
            and iterate.defect < settings.converged_defect
            and iterate.violation < CONVERGED_VIOLATION
        )
        if steps >= settings.patience and iterate.violation > HOPELESS_VIOLATION:
            break
    trajectory = formulation.reference
    if steps and iterate.defect < USABLE_DEFECT:
        trajectory = Trajectory(trajectory.t, iterate.knots[:, :N_STATES], iterate.knots[:, N_STATES:])
    violation = iterate.violation if steps else math.inf
    return SqpSteps(trajectory, steps, converged, violation, time.perf_counter() - begin)
