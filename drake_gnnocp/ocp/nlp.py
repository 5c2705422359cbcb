"""A formulation as a Drake `MathematicalProgram` for Ipopt, in reading order.

Ipopt's limited-memory BFGS starts from a multiple of the identity. The cost J1 has the Hessian 2 h on the inputs and
none on the states, so the states stand in the program as value / STATE_SCALE: seen from there the identity is next to
nothing. (`SetVariableScaling` does not reach Ipopt.)
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from pydrake.autodiffutils import ExtractValue, InitializeAutoDiff
from pydrake.solvers import Binding, Constraint, LinearConstraint, LinearEqualityConstraint, MathematicalProgram
from scipy.sparse import csr_matrix

from drake_gnnocp.ocp.boxes import NEAR_LIMIT, end_place, ends, limits, motion_limits, trust_region
from drake_gnnocp.ocp.costs import CostTerm, cost_terms
from drake_gnnocp.ocp.dynamics import INTEGRATED, POSE_ROWS, dynamics
from drake_gnnocp.ocp.formulation import Formulation
from drake_gnnocp.ocp.rows import N_KNOT, N_STATES, Box, RowBlock
from drake_gnnocp.ocp.separating_lines import separating_lines
from drake_gnnocp.ocp.triangle_areas import triangle_areas
from drake_gnnocp.trajectory import Trajectory

STATE_SCALE = 100.0  # program variable = state / STATE_SCALE, and those of separating lines
STEP_SCALE = 10.0  # program variable = h / STEP_SCALE
SHORTEST_STEP, LONGEST_STEP = 0.1, 3.0  # of the reference's, where time is minimised
IPOPT_LARGEST_GRADIENT = 100.0  # its nlp_scaling_max_gradient: larger gradients at the start make it scale the cost
KNOTS_PER_COST = 4  # dense blocks: one matrix over all inputs would cost its square in every evaluation
KNOTS_PER_TERM = 120  # the same for other costs, which are calls of Python


@dataclass(frozen=True, eq=False)
class Nlp:
    """A program with its variables and its first iterate."""

    program: MathematicalProgram
    knots: np.ndarray  # (N, 7) variables: x, y, theta, v, phi over the state scale, and a, w
    step: np.ndarray  # (1,) h / STEP_SCALE where time is minimised, else (0,)
    fixed_step: float  # s, h where it is no variable
    knot_scale: np.ndarray  # (7,) what the columns of knots are multiplied by to be in SI units
    hessian: float  # the cost's second derivative with respect to an input

    @property
    def first_iterate(self) -> np.ndarray:
        """Values of all decision variables."""
        return np.array(self.program.initial_guess())

    @property
    def n_rows(self) -> int:
        """Scalar constraints, bounds on variables aside."""
        program = self.program
        linear = [*program.linear_equality_constraints(), *program.linear_constraints()]
        return sum(binding.evaluator().num_constraints() for binding in [*program.generic_constraints(), *linear])

    def trajectory(self, values: np.ndarray) -> Trajectory:
        """The trajectory in the values of all decision variables."""
        index = self.program.FindDecisionVariableIndices
        knots = values[index(self.knots.ravel())].reshape(self.knots.shape) * self.knot_scale
        step = float(values[index(self.step)][0]) * STEP_SCALE if len(self.step) else self.fixed_step
        return Trajectory(step * np.arange(len(knots)), knots[:, :N_STATES], knots[:, N_STATES:])


def build(formulation: Formulation, state_scale: float = STATE_SCALE) -> Nlp:
    """Build the program of a formulation, which starts from its reference."""
    program, n, h = MathematicalProgram(), len(formulation.reference), formulation.step
    knot_scale = np.array([state_scale] * N_STATES + [1.0] * (N_KNOT - N_STATES))
    knots = program.NewContinuousVariables(n, N_KNOT, "knot")
    step = program.NewContinuousVariables(1, "h") if formulation.minimum_time else np.array([])
    scale, hessian = _cost_scale(formulation)
    nlp = Nlp(program, knots, step, h, knot_scale, hessian)

    region = trust_region(formulation)
    for box in [limits(formulation), *([region] if region else []), *ends(formulation)]:
        _add_box(nlp, box)
    if (place := end_place(formulation)) is not None:
        matrix, lower, upper = place
        rows = program.AddLinearConstraint(matrix * state_scale, lower, upper, knots[-1, :2])
        rows.evaluator().set_description("place at the goal")
    if not formulation.minimum_time:
        _add_trapezoid_rule(nlp)
        _add_limits_in_between(nlp, formulation)
    _add_rows(nlp, dynamics(formulation, N_STATES if formulation.minimum_time else POSE_ROWS))
    _add_rows(nlp, triangle_areas(formulation))
    _add_rows(nlp, separating_lines(formulation))
    if formulation.minimum_time:
        _add_duration(nlp, scale * formulation.weights.time)
    for term in cost_terms(formulation.weights, formulation.proximity):
        _add_cost(nlp, term, scale)
    program.SetInitialGuess(knots, formulation.knots / knot_scale)
    return nlp


def _cost_scale(formulation: Formulation) -> tuple[float, float]:
    """What the whole cost is multiplied by, so that Ipopt does not scale it, and its Hessian over the inputs then.

    Ipopt would scale neither the first BFGS matrix nor the tolerances with it.
    """
    scale = 1.0
    if formulation.minimum_time:
        steepest = formulation.weights.time * (len(formulation.reference) - 1) * STEP_SCALE
        scale = min(1.0, IPOPT_LARGEST_GRADIENT / steepest)
    return scale, 2 * formulation.weights.lambda1 * formulation.step * scale


def _add_box(nlp: Nlp, box: Box) -> None:
    scale = nlp.knot_scale[box.knot_columns]
    variables = nlp.knots[np.ix_(box.knots, box.knot_columns)].ravel()
    lower, upper = (box.lower / scale).ravel(), (box.upper / scale).ravel()
    nlp.program.AddBoundingBoxConstraint(lower, upper, variables).evaluator().set_description(box.description)


def _add_trapezoid_rule(nlp: Nlp) -> None:
    """v_{k+1} - v_k = h (a_k + a_{k+1}) / 2 and phi likewise: the defects that are linear for a fixed h."""
    half, last = nlp.fixed_step / 2 / nlp.knot_scale[0], len(nlp.knots) - 1
    # one sparse constraint for all knots: Drake takes as long for one of a single row
    values = np.tile([-1.0, 1.0, -half, -half], (last, 1))
    columns = np.arange(last)[:, None] + [0, 1, last + 1, last + 2]
    matrix = csr_matrix((values.ravel(), columns.ravel(), 4 * np.arange(last + 1)), (last, 2 * (last + 1))).tocsc()
    rows = LinearEqualityConstraint(matrix, np.zeros(last))
    rows.set_description("trapezoid rule")
    for state, rate in INTEGRATED:
        nlp.program.AddConstraint(rows, np.concatenate([nlp.knots[:, state], nlp.knots[:, rate]]))


def _add_limits_in_between(nlp: Nlp, formulation: Formulation) -> None:
    """|v_k + h a_k / 2| and the same of phi within their limits, where the reference comes near them.

    Between two knots v is a parabola: it stays among v_k, v_k + h a_k / 2 and v_{k+1}, its points of control.
    """
    knots, half = formulation.knots, nlp.fixed_step / 2
    for (state, rate), most in zip(INTEGRATED, motion_limits(formulation), strict=False):
        row = LinearConstraint(np.array([[nlp.knot_scale[state], half]]), np.array([-most]), np.array([most]))
        row.set_description("limits between the knots")
        for k in np.flatnonzero(np.abs(knots[:-1, state]) + np.abs(half * knots[:-1, rate]) > NEAR_LIMIT * most):
            nlp.program.AddConstraint(row, np.array([nlp.knots[k, state], nlp.knots[k, rate]]))


def _add_rows(nlp: Nlp, blocks: list[RowBlock]) -> None:
    for block in blocks:
        add_block(nlp, block)


def add_block(nlp: Nlp, block: RowBlock) -> Binding:
    """Add the rows of a block, with the extra variables that they bring along."""
    program, state_scale = nlp.program, nlp.knot_scale[0]
    extra = np.array([])
    if len(block.extra):
        extra = program.NewContinuousVariables(len(block.extra), "extra")
        program.SetInitialGuess(extra, block.extra / state_scale)
    step = nlp.step if block.with_step else np.array([])
    of_knots = nlp.knots[np.ix_(block.knots, block.knot_columns)].ravel()
    variables = np.concatenate([of_knots, step, extra])
    scale = np.concatenate(
        [
            np.tile(nlp.knot_scale[block.knot_columns], len(block.knots)),
            np.full(len(step), STEP_SCALE),
            np.full(len(extra), state_scale),
        ]
    )
    evaluate = _callback(block, scale)
    binding: Binding = program.AddConstraint(evaluate, block.lower, block.upper, variables)
    evaluator: Constraint = binding.evaluator()
    evaluator.SetGradientSparsityPattern(list(zip(block.rows.tolist(), block.columns.tolist(), strict=True)))
    evaluator.set_description(block.description)
    return binding


def _callback(block: RowBlock, scale: np.ndarray) -> object:
    """The block as a function of program variables, which are its numbers over a scale (V,)."""
    shape = (len(block.lower), len(scale))
    flat, entry_scale = block.rows * shape[1] + block.columns, scale[block.columns]
    last_x, last = np.full(len(scale), np.nan), (block.lower, np.zeros(len(block.rows)))

    def evaluate(x: np.ndarray) -> np.ndarray:
        # Ipopt asks for the values at a trial point and, once it is accepted, for the Jacobian there
        nonlocal last_x, last
        with_gradient = x.dtype != float
        point = ExtractValue(x).ravel() if with_gradient else x
        if not np.array_equal(point, last_x):
            last_x, last = point.copy(), block.function(point * scale)
        values, entries = last
        if not with_gradient:
            return values
        jacobian = np.zeros(shape)
        jacobian.flat[flat] = entries * entry_scale
        return InitializeAutoDiff(values, jacobian)

    return evaluate


def _add_duration(nlp: Nlp, weight: float) -> None:
    """The weighted duration, and bounds on the time step."""
    h = nlp.fixed_step / STEP_SCALE
    nlp.program.AddLinearCost(np.array([weight * (len(nlp.knots) - 1) * STEP_SCALE]), 0.0, nlp.step)
    box = nlp.program.AddBoundingBoxConstraint(SHORTEST_STEP * h, LONGEST_STEP * h, nlp.step)
    box.evaluator().set_description("time step")
    nlp.program.SetInitialGuess(nlp.step, [h])


def _add_cost(nlp: Nlp, term: CostTerm, factor: float) -> None:
    """Factor h times the sum of a term over the knots; where time is minimised, at the reference's h."""
    variables, scale = nlp.knots[1:-1, term.columns], nlp.knot_scale[term.columns]
    factor = factor * nlp.fixed_step
    if term.is_quadratic:
        for block in np.array_split(variables, max(1, len(variables) // KNOTS_PER_COST)):
            size = block.size
            bend = factor * term.convex_hessian(np.zeros(block.shape)) * scale * scale[:, None]
            hessian, k = np.zeros((len(block), len(scale), len(block), len(scale))), np.arange(len(block))
            hessian[k, :, k] = bend
            nlp.program.AddQuadraticCost(hessian.reshape(size, size), np.zeros(size), block.ravel(), is_convex=True)
        return

    for block in np.array_split(variables, max(1, math.ceil(len(variables) / KNOTS_PER_TERM))):
        cost = nlp.program.AddCost(_cost_callback(term, scale, factor, block.shape), block.ravel())
        cost.evaluator().set_description(term.description)


def _cost_callback(term: CostTerm, scale: np.ndarray, factor: float, shape: tuple[int, ...]) -> object:
    """Factor times the sum of a term over a block of knots, a function of program variables, which are over a scale."""

    def evaluate(x: np.ndarray) -> object:
        with_gradient = x.dtype != float
        values = ExtractValue(x).ravel() if with_gradient else x
        value, gradient = term.evaluate(values.reshape(shape) * scale)
        total = np.array([factor * value.sum()])
        if not with_gradient:
            return float(total[0])
        return InitializeAutoDiff(total, factor * (gradient * scale).reshape(1, -1)).item()

    return evaluate
