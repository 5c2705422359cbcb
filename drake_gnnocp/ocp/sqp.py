r"""Sequential quadratic programming: steps that pull a rough guess near the optimum before Ipopt finishes it.

With the knots z at hand, d the change of all of them, and the letters of the other modules, one step is

    min   h sum of the cost terms' gradients and the convex part of their Hessians
          + h/2 sum rho |d state|^2  +  PENALTY h sum s
    s.t.  linearised defects (Hermite-Simpson) = 0,        v, phi, a, w within their limits,
          ends fixed (the last pose within the tolerance of the goal, where there is one)
          value_i + gradient_i . d >= lower_i - s,  s >= 0          (half planes of near pairs)

J1 has its exact Hessian here, which a limited-memory BFGS has to find out iteration by iteration. Only what keeps the
car from obstacles is soft: a step that meets the dynamics exists almost always, however far the guess is from them.
rho falls as the steps get shorter, and the defects fall with their square.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np
from pydrake.solvers import Binding, ClarabelSolver, MathematicalProgram, SolverOptions

from drake_gnnocp.budget import Budget
from drake_gnnocp.ocp.boxes import MOTION, NEAR_LIMIT, end_place, ends, limits
from drake_gnnocp.ocp.costs import cost_terms, total_cost
from drake_gnnocp.ocp.dynamics import dynamics
from drake_gnnocp.ocp.formulation import Formulation
from drake_gnnocp.ocp.half_planes import half_planes
from drake_gnnocp.ocp.rows import N_KNOT, N_STATES, THETA, RowBlock
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import State

# pydrake takes dense matrices: small blocks cost calls, large ones zeros. Without order="F" it looks for scipy first
INTERVALS_PER_BLOCK = 20  # of linearised dynamics
KNOTS_PER_BLOCK = 8  # of the cost
GROUPS_PER_BLOCK = 100  # of soft rows
USABLE_DEFECT = 0.1  # m (and rad), largest one with which steps that did not converge are still worth a start
CONVERGED_VIOLATION = 0.01  # m
HOPELESS_VIOLATION = 0.3  # m: steps that still lead so far into obstacles after a while are given up
PENALTY = 30.0  # 1/m/s, of a violation
LONGEST_STEP = np.array([1.5, 1.5, 0.5])  # m, m, rad: longer steps are shortened to it
RELAXATION, DAMPING = 0.1, 10.0  # what rho is multiplied by after a step that is shorter, or not: solutions take turns
# steps, 1/s, -; from so many steps on rho is at least this and grows with every step: solutions settle somewhere then
LATE, LATE_PROXIMAL, LATE_GROWTH = 20, 0.01, 1.15
SHORTER = 0.8  # of the step before: what counts as shorter
TOLERANCE = 1e-3  # of the solver


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


Linearised = tuple[np.ndarray, np.ndarray]  # values (M,) and entries of the Jacobian (P,) of a block


@dataclass(frozen=True, eq=False)
class _Iterate:
    """Knots with all that is known of them."""

    knots: np.ndarray  # (N, 7)
    cost: float
    dynamics: Linearised
    soft: list[tuple[RowBlock, Linearised]]

    @property
    def defect(self) -> float:
        return float(np.abs(self.dynamics[0]).max())

    @property
    def violation(self) -> float:
        return max([0.0, *(float((block.lower - value).max()) for block, (value, _) in self.soft)])


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
    program = _StepProgram(formulation)
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


class _StepProgram:
    """The quadratic program of a step, built once: steps change its numbers."""

    def __init__(self, formulation: Formulation) -> None:
        self._formulation, self._h = formulation, formulation.step
        self._terms = cost_terms(formulation.weights, formulation.proximity)
        self._limits = limits(formulation)
        n_knots = len(formulation.reference)
        self._program = MathematicalProgram()
        self._change = self._program.NewContinuousVariables(n_knots, N_KNOT, "d")
        self._slacks = np.zeros(0, dtype=object)
        self._ends = ends(formulation)
        is_free = formulation.target is not None
        fixed = np.concatenate([self._change[0], self._change[-1, MOTION if is_free else slice(None)]])
        self._program.AddBoundingBoxConstraint(np.zeros(len(fixed)), np.zeros(len(fixed)), fixed)
        (self._dynamics,) = dynamics(formulation, N_STATES, n_knots - 1)
        self._equalities = []
        for first in range(0, n_knots - 1, INTERVALS_PER_BLOCK):
            last = min(first + INTERVALS_PER_BLOCK, n_knots - 1)
            shape = (N_STATES * (last - first), N_KNOT * (last - first + 1))
            rows = self._program.AddLinearEqualityConstraint(
                np.zeros(shape, order="F"), np.zeros(shape[0]), self._change[first : last + 1].ravel()
            )
            self._equalities.append((first, last, rows.evaluator()))
        self._costs = []
        for first in range(1, n_knots - 1, KNOTS_PER_BLOCK):
            block = self._change[first : min(first + KNOTS_PER_BLOCK, n_knots - 1)]
            n = block.size
            term = self._program.AddQuadraticCost(np.zeros((n, n)), np.zeros(n), 0.0, block.ravel(), is_convex=True)
            self._costs.append((first, first + len(block), term.evaluator()))
        self._solver, self._settings = ClarabelSolver(), SolverOptions()
        for name in ("tol_gap_abs", "tol_gap_rel", "tol_feas"):
            self._settings.SetOption(self._solver.solver_id(), name, TOLERANCE)
        # the numbers are of order 1 and a thousandth is enough: without these three it takes 0.55 times as long
        for name in ("equilibrate_enable", "iterative_refinement_enable", "presolve_enable"):
            self._settings.SetOption(self._solver.solver_id(), name, 0)

    def _variables(self, block: RowBlock) -> np.ndarray:
        """The changes of the block's numbers."""
        return np.asarray(self._change[np.ix_(block.knots, block.knot_columns)].ravel())

    def first_iterate(self) -> _Iterate:
        """The reference, from start to goal exactly; an end that may vary stays what it is there."""
        knots = self._formulation.knots
        for box in self._ends:
            which = np.ix_(box.knots, box.knot_columns)
            knots[which] = knots[which].clip(box.lower, box.upper)
        return self.iterate(knots)

    def iterate(self, knots: np.ndarray) -> _Iterate:
        """What is to be known of knots (N, 7)."""
        poses = knots[:, : State.V]
        soft = half_planes(self._formulation, poses)
        return _Iterate(
            knots,
            total_cost(self._terms, knots, self._h),
            self._dynamics.function(self._dynamics.numbers(knots, self._h)),
            [(block, block.function(block.numbers(knots, self._h))) for block in soft],
        )

    def solve(self, iterate: _Iterate, proximal: float) -> np.ndarray | None:
        """The change of the knots (N, 7), in SI units; None where the solver failed."""
        numbers = [*iterate.dynamics, *(array for _, arrays in iterate.soft for array in arrays)]
        if not all(np.isfinite(array).all() for array in numbers):  # which Drake refuses by ending the process
            return None
        self._set_dynamics(*iterate.dynamics)
        self._set_cost(iterate.knots, proximal)
        added = self._limit_rows(iterate.knots) + self._end_rows(iterate.knots[-1]) + self._soft_rows(iterate)
        result = self._solver.Solve(self._program, None, self._settings)
        for binding in added:
            self._program.RemoveConstraint(binding)
        if not result.is_success():
            return None
        n_knots = len(self._change)  # the first variables, which Drake keeps column by column
        return result.get_x_val()[: self._change.size].reshape(N_KNOT, n_knots).T

    def _set_dynamics(self, value: np.ndarray, entries: np.ndarray) -> None:
        block, per_interval = self._dynamics, len(entries) // (len(self._change) - 1)
        for first, last, equalities in self._equalities:
            of_block = slice(first * per_interval, last * per_interval)
            matrix = np.zeros((N_STATES * (last - first), N_KNOT * (last - first + 1)))
            rows, columns = block.rows[of_block] - N_STATES * first, block.columns[of_block] - N_KNOT * first
            matrix[rows, columns] = entries[of_block]
            equalities.UpdateCoefficients(matrix, -value[N_STATES * first : N_STATES * last])

    def _set_cost(self, knots: np.ndarray, proximal: float) -> None:
        gradient, bend = np.zeros_like(knots), np.zeros((*knots.shape, N_KNOT))
        bend[:, range(N_STATES), range(N_STATES)] = self._h * proximal
        for term in self._terms:
            values, columns = knots[:, term.columns], term.columns
            gradient[:, columns] += self._h * term.evaluate(values)[1]
            bend[:, columns[:, None], columns] += self._h * term.convex_hessian(values)
        for first, last, cost in self._costs:
            n = last - first
            matrix, i = np.zeros((n, N_KNOT, n, N_KNOT)), np.arange(n)
            matrix[i, :, i] = bend[first:last]
            cost.UpdateCoefficients(matrix.reshape(n * N_KNOT, -1), gradient[first:last].ravel(), 0.0, is_convex=True)

    def _limit_rows(self, knots: np.ndarray) -> list[Binding]:
        where = np.ix_(self._limits.knots, self._limits.knot_columns)
        values, change = knots[where], self._change[where]
        close = np.abs(values) > NEAR_LIMIT * self._limits.upper
        if not close.any():
            return []
        lower, upper = self._limits.lower[close] - values[close], self._limits.upper[close] - values[close]
        return [self._program.AddBoundingBoxConstraint(lower, upper, change[close])]

    def _end_rows(self, end: np.ndarray) -> list[Binding]:
        """Bounds on the change of the last knot (7,) where its pose is a variable."""
        if (place := end_place(self._formulation)) is None:
            return []
        matrix, lower, upper = place
        middle, goal, change = matrix @ end[:2], self._ends[-1], self._change[-1]
        turn = np.array([goal.lower[0, THETA], goal.upper[0, THETA]]) - end[THETA]
        return [
            self._program.AddLinearConstraint(np.asfortranarray(matrix), lower - middle, upper - middle, change[:2]),
            self._program.AddBoundingBoxConstraint(*turn, change[THETA]),
        ]

    def _soft_rows(self, iterate: _Iterate) -> list[Binding]:
        groups = [len(block.lower) // block.group for block, _ in iterate.soft]
        self._add_slacks(sum(groups) - len(self._slacks))
        added, first = [], 0
        for (block, (value, entries)), n in zip(iterate.soft, groups, strict=True):
            slacks = self._slacks[first : first + n]
            added += self._soft_block(block, block.lower - value, entries, slacks)
            first += n
        return added

    def _soft_block(
        self, block: RowBlock, violation: np.ndarray, entries: np.ndarray, slacks: np.ndarray
    ) -> list[Binding]:
        """Rows of a block whose groups have a slack each; every row has the same number of entries."""
        variables = self._variables(block)
        shape = (len(slacks), block.group, -1)
        entries, columns, violation = entries.reshape(shape), block.columns.reshape(shape), violation.reshape(shape[:2])
        by_knot = np.argsort(columns[:, 0, 0], kind="stable")
        added = []
        for groups in np.array_split(by_knot, math.ceil(len(by_knot) / GROUPS_PER_BLOCK)):
            used, position = np.unique(columns[groups], return_inverse=True)
            n, i = len(groups), np.arange(len(groups))
            matrix = np.zeros((n, block.group, len(used) + n))
            row = np.arange(block.group)[:, None]
            matrix[i[:, None, None], row, position.reshape(columns[groups].shape)] = entries[groups]
            matrix[i, :, len(used) + i] = 1.0
            lower = violation[groups].ravel()
            rows = np.asfortranarray(matrix.reshape(len(lower), -1))
            numbers = np.concatenate([variables[used], slacks[groups]])
            added.append(self._program.AddLinearConstraint(rows, lower, np.full(len(lower), np.inf), numbers))
        return added

    def _add_slacks(self, n: int) -> None:
        if n <= 0:
            return
        new = self._program.NewContinuousVariables(n, "s")
        self._program.AddBoundingBoxConstraint(np.zeros(n), np.full(n, np.inf), new)
        self._program.AddLinearCost(np.full(n, PENALTY * self._h), 0.0, new)
        self._slacks = np.concatenate([self._slacks, new])
