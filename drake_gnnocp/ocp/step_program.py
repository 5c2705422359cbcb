r"""The quadratic program of an SQP step as sparse matrices, solved by PIQP.

With the knots z at hand, d the change of all of them, and the letters of the other modules, one step is

    min   h sum of the cost terms' gradients and the convex part of their Hessians
          + h/2 sum rho |d state|^2  +  PENALTY h sum s
    s.t.  linearised defects (Hermite-Simpson) = 0,        v, phi, a, w within their limits,
          ends fixed (the last pose within the tolerance of the goal, where there is one)
          value_i + gradient_i . d >= lower_i - s,  s >= 0          (half planes of near pairs)

Only what is not fixed is a variable: the changes of all knots but the ends', the last pose where there is a tolerance,
and the slacks s, one for every group of rows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import piqp
from scipy.sparse import csc_matrix

from drake_gnnocp.ocp.boxes import NEAR_LIMIT, end_place, ends, limits
from drake_gnnocp.ocp.costs import cost_terms
from drake_gnnocp.ocp.dynamics import dynamics
from drake_gnnocp.ocp.formulation import Formulation
from drake_gnnocp.ocp.half_planes import half_planes
from drake_gnnocp.ocp.rows import N_KNOT, N_STATES, POSE, THETA, RowBlock
from drake_gnnocp.vehicle import State

PENALTY = 30.0  # 1/m/s, of a violation
TOLERANCE = 1e-3  # of the solver
FIXED = -1  # in the place of a variable

Linearised = tuple[np.ndarray, np.ndarray]  # values (M,) and entries of the Jacobian (P,) of a block


@dataclass(frozen=True, eq=False)
class Iterate:
    """Knots with all that is known of them."""

    knots: np.ndarray  # (N, 7)
    cost: float
    gradient: np.ndarray  # (N, 7) of the cost
    dynamics: Linearised
    soft: list[tuple[RowBlock, Linearised]]  # half planes of near pairs

    @property
    def defect(self) -> float:
        """The largest defect of the dynamics [m or rad]."""
        return float(np.abs(self.dynamics[0]).max())

    @property
    def violation(self) -> float:
        """The largest violation of the half planes [m]."""
        return max([0.0, *(float((block.lower - value).max()) for block, (value, _) in self.soft)])


@dataclass(frozen=True, eq=False)
class _Rows:
    """Rows lower <= matrix @ d <= upper, by the entries of the matrix."""

    rows: np.ndarray  # (P,)
    columns: np.ndarray  # (P,) of the variables, or FIXED
    entries: np.ndarray  # (P,)
    lower: np.ndarray  # (M,)
    upper: np.ndarray  # (M,)


NO_INDEX, NO_NUMBER = np.zeros(0, dtype=int), np.zeros(0)
NO_ROWS = _Rows(NO_INDEX, NO_INDEX, NO_NUMBER, NO_NUMBER, NO_NUMBER)


class StepProgram:
    """The quadratic program of a step from any iterate."""

    def __init__(self, formulation: Formulation) -> None:
        self._formulation, self._h = formulation, formulation.step
        self._terms = cost_terms(formulation.weights, formulation.proximity)
        self._limits, self._ends = limits(formulation), ends(formulation)
        n_knots = len(formulation.reference)
        (self._dynamics,) = dynamics(formulation, N_STATES, n_knots - 1)
        varies = np.ones((n_knots, N_KNOT), dtype=bool)
        varies[[0, -1]] = False
        varies[-1, POSE] = formulation.target is not None
        self._places = np.where(varies, varies.cumsum().reshape(varies.shape) - 1, FIXED)  # among the variables
        self._n_changes = int(varies.sum())

    def first_iterate(self) -> Iterate:
        """The reference, from start to goal exactly; an end that may vary stays what it is there."""
        knots = self._formulation.knots
        for box in self._ends:
            which = np.ix_(box.knots, box.knot_columns)
            knots[which] = knots[which].clip(box.lower, box.upper)
        return self.iterate(knots)

    def iterate(self, knots: np.ndarray) -> Iterate:
        """What is to be known of knots (N, 7)."""
        soft = half_planes(self._formulation, knots[:, : State.V])
        cost, gradient = 0.0, np.zeros_like(knots)
        for term in self._terms:
            values, slopes = term.evaluate(knots[:, term.columns])
            cost += self._h * float(values.sum())
            gradient[:, term.columns] += self._h * slopes
        return Iterate(
            knots,
            cost,
            gradient,
            self._dynamics.function(self._dynamics.numbers(knots, self._h)),
            [(block, block.function(block.numbers(knots, self._h))) for block in soft],
        )

    def solve(self, iterate: Iterate, proximal: float) -> np.ndarray | None:
        """The change of the knots (N, 7), in SI units; None where the solver failed.

        Args:
            iterate: where the step begins.
            proximal: rho [1/s].
        """
        soft, n = self._soft_rows(iterate)
        bends = self._bends(iterate.knots[1:-1], proximal)
        places = np.broadcast_to(self._places[1:-1, :, None], bends.shape)
        quadratic = _matrix(places.ravel(), places.swapaxes(1, 2).ravel(), bends.ravel(), (n, n))
        linear = np.full(n, PENALTY * self._h)
        linear[: self._n_changes] = 0.0
        linear[self._places[1:-1]] = iterate.gradient[1:-1]
        value, entries = iterate.dynamics
        dynamics = _matrix(self._dynamics.rows, self._columns(self._dynamics), entries, (len(value), n))
        inequalities = _matrix(soft.rows, soft.columns, soft.entries, (len(soft.lower), n))
        lower, upper = self._bounds(iterate.knots, n)
        solver = piqp.SparseSolver()
        settings = solver.settings
        settings.preconditioner_iter = 0
        settings.eps_abs = settings.eps_rel = settings.eps_duality_gap_abs = settings.eps_duality_gap_rel = TOLERANCE
        solver.setup(quadratic, linear, dynamics, -value, inequalities, soft.lower, soft.upper, lower, upper)
        if solver.solve() != piqp.PIQP_SOLVED:
            return None
        found = np.append(solver.result.x[: self._n_changes], 0.0)  # for what is FIXED
        return found[self._places]

    def _columns(self, block: RowBlock) -> np.ndarray:
        """The variables of the block's entries."""
        return self._places[np.ix_(block.knots, block.knot_columns)].ravel()[block.columns]

    def _bends(self, knots: np.ndarray, proximal: float) -> np.ndarray:
        """The convex part of the cost's Hessian at knots (N, 7): (N, 7, 7)."""
        bends = np.zeros((*knots.shape, N_KNOT))
        bends[:, range(N_STATES), range(N_STATES)] = self._h * proximal
        for term in self._terms:
            columns = term.columns
            bends[:, columns[:, None], columns] += self._h * term.convex_hessian(knots[:, columns])
        return bends

    def _bounds(self, knots: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
        """Of all variables: limits that the knots are near, the last heading's, and slacks that are not negative."""
        lower, upper = np.full(n, -np.inf), np.full(n, np.inf)
        lower[self._n_changes :] = 0.0
        box = self._limits
        which = np.ix_(box.knots, box.knot_columns)
        values, places = knots[which], self._places[which]
        close = np.abs(values) > NEAR_LIMIT * box.upper
        lower[places[close]] = (box.lower - values)[close]
        upper[places[close]] = (box.upper - values)[close]
        if (place := self._places[-1, THETA]) != FIXED:
            goal = self._ends[-1]
            lower[place], upper[place] = (bound[0, THETA] - knots[-1, THETA] for bound in (goal.lower, goal.upper))
        return lower, upper

    def _soft_rows(self, iterate: Iterate) -> tuple[_Rows, int]:
        """The half planes, each group with a slack, and the last place's bounds; and how many variables there are."""
        parts, n = [NO_ROWS], self._n_changes
        for block, (value, entries) in iterate.soft:
            m = len(value)
            rows, slacks = np.append(block.rows, np.arange(m)), n + np.arange(m) // block.group
            columns = np.append(self._columns(block), slacks)
            part = _Rows(rows, columns, np.append(entries, np.ones(m)), block.lower - value, np.full(m, np.inf))
            parts.append(part)
            n += m // block.group
        if (place := end_place(self._formulation)) is not None:
            matrix, lower, upper = place
            at = matrix @ iterate.knots[-1, :2]
            rows, columns = np.repeat([0, 1], 2), np.tile(self._places[-1, :2], 2)
            parts.append(_Rows(rows, columns, matrix.ravel(), lower - at, upper - at))
        return _stacked(parts), n


def _stacked(parts: list[_Rows]) -> _Rows:
    """Rows, one part below the other."""
    firsts = np.cumsum([0, *(len(part.lower) for part in parts[:-1])])
    rows = np.concatenate([part.rows + first for part, first in zip(parts, firsts, strict=True)])
    others = ("columns", "entries", "lower", "upper")
    return _Rows(rows, *(np.concatenate([getattr(part, name) for part in parts]) for name in others))


def _matrix(rows: np.ndarray, columns: np.ndarray, entries: np.ndarray, shape: tuple[int, int]) -> csc_matrix:
    """A sparse matrix from its entries, without those of what is fixed."""
    stays = (rows != FIXED) & (columns != FIXED) & (entries != 0.0)
    return csc_matrix((entries[stays], (rows[stays], columns[stays])), shape=shape)
