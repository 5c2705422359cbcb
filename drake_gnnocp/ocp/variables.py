"""The decision variables of the optimal control problem, and how numpy functions of them enter Drake.

Ipopt's limited-memory BFGS starts from a multiple of the identity. The cost J1 has the Hessian 2 h on the inputs and
none on the states, so the states stand in the program as value / state_scale: seen from there the identity is next to
nothing.
(`SetVariableScaling` does not reach Ipopt.)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from pydrake.autodiffutils import ExtractValue, InitializeAutoDiff
from pydrake.solvers import Binding, Constraint, MathematicalProgram

from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import Vehicle

N_STATES = 5  # x, y, theta, v, phi
N_KNOT = 7  # ... and a, w
STATE_SCALE = 100.0  # the usual state_scale: program variable = state / state_scale
STEP_SCALE = 10.0  # program variable = h / STEP_SCALE

# Values (M,) and the entries of their Jacobian, in the order of the sparsity pattern given beside the function.
BlockFunction = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class Variables:
    """Decision variables of a program."""

    knots: np.ndarray  # (N, 7) x, y, theta, v, phi over state_scale, and a, w
    step: np.ndarray  # (1,) h / STEP_SCALE where the horizon is free, else (0,)
    fixed_step: float  # s, h where it is fixed, else the guess's
    state_scale: float = STATE_SCALE

    def __len__(self) -> int:
        return len(self.knots)

    @property
    def knot_scale(self) -> np.ndarray:
        """What the 7 columns of `knots` are multiplied by to be in SI units."""
        return np.array([self.state_scale] * N_STATES + [1.0, 1.0])

    @property
    def free_horizon(self) -> bool:
        """Whether h is a decision variable."""
        return len(self.step) == 1

    def trajectory(self, values: np.ndarray, step: float) -> Trajectory:
        """The trajectory of program values (N, 7) at time step `step` [s]."""
        knots = values * self.knot_scale
        return Trajectory(step * np.arange(len(knots)), knots[:, :N_STATES], knots[:, N_STATES:])


def add_variables(
    program: MathematicalProgram, n_knots: int, step: float, free_horizon: bool, state_scale: float = STATE_SCALE
) -> Variables:
    """Add the knots' states and inputs, and h where the horizon is free."""
    knots = program.NewContinuousVariables(n_knots, N_KNOT, "knot")
    h = program.NewContinuousVariables(1, "h") if free_horizon else np.array([])
    return Variables(knots, h, step, state_scale)


def add_limits(program: MathematicalProgram, variables: Variables, vehicle: Vehicle, margin: float) -> None:
    """|v|, |phi|, |a|, |w| within the vehicle's limits, less a relative margin, at every knot."""
    limits = (1 - margin) * np.array([vehicle.v_max, vehicle.phi_max, vehicle.a_max, vehicle.w_max])
    columns = variables.knots[1:-1, 3:]
    bound = np.tile(limits / variables.knot_scale[3:], len(columns))
    program.AddBoundingBoxConstraint(-bound, bound, columns.ravel()).evaluator().set_description("limits")


def add_tube(program: MathematicalProgram, variables: Variables, poses: np.ndarray, reach: np.ndarray) -> None:
    """Poses no farther from the guess's (N, 3) than reach (3,) in x, y, theta [m, m, rad].

    It keeps the solver from jumping over thin obstacles, and to places where no rows guard it.
    """
    columns, low, high = variables.knots[1:-1, :3], poses[1:-1] - reach, poses[1:-1] + reach
    low, high = low / variables.state_scale, high / variables.state_scale
    box = program.AddBoundingBoxConstraint(low.ravel(), high.ravel(), columns.ravel())
    box.evaluator().set_description("tube")


def add_ends(program: MathematicalProgram, variables: Variables, start: np.ndarray, goal: np.ndarray) -> None:
    """Start and goal pose (3,), with v = phi = a = w = 0 at both (the paper's boundary conditions)."""
    for name, knot, pose in (("start", 0, start), ("goal", -1, goal)):
        values = np.append(pose, np.zeros(4)) / variables.knot_scale
        program.AddBoundingBoxConstraint(values, values, variables.knots[knot]).evaluator().set_description(name)


def add_block(
    program: MathematicalProgram,
    function: BlockFunction,
    lower: np.ndarray,
    upper: np.ndarray,
    variables: np.ndarray,
    rows: np.ndarray,
    columns: np.ndarray,
    description: str,
) -> Binding:
    """Add a vector constraint lower <= function(variables) <= upper whose Jacobian is analytic and sparse.

    Args:
        program: to add to.
        function: values (M,) and Jacobian entries (P,) of the program variables' values (V,).
        lower: (M,).
        upper: (M,).
        variables: (V,) program variables.
        rows: (P,) row of every Jacobian entry.
        columns: (P,) column of every Jacobian entry.
        description: what the rows are; infeasible ones are reported by it.
    """
    shape = (len(lower), len(variables))
    flat = rows * shape[1] + columns

    last_x, last = np.full(len(variables), np.nan), (lower, np.zeros(len(rows)))

    def evaluate(x: np.ndarray) -> np.ndarray:
        # Ipopt asks for the values at a trial point and, once it is accepted, for the Jacobian there
        nonlocal last_x, last
        with_gradient = x.dtype != float
        point = ExtractValue(x).ravel() if with_gradient else x
        if not np.array_equal(point, last_x):
            last_x, last = point.copy(), function(point)
        values, entries = last
        if not with_gradient:
            return values
        jacobian = np.zeros(shape)
        jacobian.flat[flat] = entries
        return InitializeAutoDiff(values, jacobian)

    binding: Binding = program.AddConstraint(evaluate, lower, upper, variables)
    evaluator: Constraint = binding.evaluator()
    evaluator.SetGradientSparsityPattern(list(zip(rows.tolist(), columns.tolist(), strict=True)))
    evaluator.set_description(description)
    return binding
