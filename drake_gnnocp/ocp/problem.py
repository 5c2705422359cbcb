"""The optimal control problem of a scenario as a Drake `MathematicalProgram`, in reading order."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from pydrake.solvers import MathematicalProgram

from drake_gnnocp.ocp.cost import CostWeights, add_cost
from drake_gnnocp.ocp.dynamics import add_dynamics
from drake_gnnocp.ocp.rings import ConvexRings
from drake_gnnocp.ocp.separating_line import Separation, add_separating_line
from drake_gnnocp.ocp.triangle_area import add_triangle_areas, near_rows
from drake_gnnocp.ocp.variables import (
    STATE_SCALE,
    STEP_SCALE,
    Variables,
    add_ends,
    add_limits,
    add_tube,
    add_variables,
)
from drake_gnnocp.ocp.workspace import add_workspace
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.trajectory import Trajectory


@dataclass(frozen=True)
class ProblemOptions:
    """What the problem asks for."""

    weights: CostWeights = field(default_factory=CostWeights)
    margin: float = 0.1  # m, clearance asked of the triangle areas at the knots
    least_margin: float = 0.02  # m, asked even where the guess is nearer
    guess_share: float = 0.9  # of the guess's clearance: in between, no row asks for more
    bounds_margin: float = 0.02  # m, clearance asked of the bounds at the knots
    limits_margin: float = 0.0  # relative, of the vehicle's limits at the knots (v and phi can peak in between)
    near: float = 2.5  # m, rows farther from their obstacle at the guess are left out
    tube: float = 2.0  # m, poses stay this near the guess's
    tube_heading: float = 0.8  # rad
    goal_offset: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m, m, rad: aimed beside the goal to end at it
    free_horizon: bool = False  # whether the duration is a decision variable
    state_scale: float = STATE_SCALE  # what the states are divided by in the program, see `variables`


@dataclass(frozen=True)
class Problem:
    """A built program with its variables and its guess."""

    program: MathematicalProgram
    variables: Variables
    guess: np.ndarray  # values of all decision variables
    hessian: float  # the cost's second derivative with respect to an input
    n_rows: int  # scalar constraints, bounds on variables aside


def build(scenario: Scenario, guess: Trajectory, separations: list[Separation], options: ProblemOptions) -> Problem:
    """Build the program around a guess.

    Args:
        scenario: the task, near the origin.
        guess: trajectory with equally spaced knots; gives the time step, the pairs that get rows, and the start.
        separations: pairs that get a separating line.
        options: see `ProblemOptions`.
    """
    program = MathematicalProgram()
    h = guess.duration / (len(guess) - 1)
    vehicle, poses = scenario.vehicle, guess.poses
    turns = 2 * np.pi * np.round((poses[-1, 2] - scenario.goal[2]) / (2 * np.pi))  # the goal the guess turns to

    variables = add_variables(program, len(guess), h, options.free_horizon, options.state_scale)
    add_limits(program, variables, vehicle, options.limits_margin)
    if not options.free_horizon:
        add_tube(program, variables, poses, np.array([options.tube, options.tube, options.tube_heading]))
    add_ends(program, variables, scenario.start, scenario.goal + options.goal_offset + [0.0, 0.0, turns])
    add_dynamics(program, variables, vehicle)
    rows = near_rows(poses, ConvexRings.of(scenario.convex_obstacles), vehicle, options.near)
    margins = np.clip(options.guess_share * rows.distance, min(options.least_margin, options.margin), options.margin)
    add_triangle_areas(program, variables, rows, margins)
    if scenario.bounds is not None:
        add_workspace(program, variables, vehicle, scenario.bounds, poses, options.near, options.bounds_margin)
    for pair in separations:
        add_separating_line(program, variables, vehicle, pair, poses[pair.interval : pair.interval + 2])
    scale = add_cost(program, variables, scenario.centroids, options.weights)

    program.SetInitialGuess(variables.knots, np.hstack([guess.states, guess.inputs]) / variables.knot_scale)
    if options.free_horizon:
        limits = program.AddBoundingBoxConstraint(0.1 * h / STEP_SCALE, 3 * h / STEP_SCALE, variables.step)
        limits.evaluator().set_description("time step")
        program.SetInitialGuess(variables.step, [h / STEP_SCALE])
    constraints = [*program.generic_constraints(), *program.linear_equality_constraints()]
    n_rows = sum(binding.evaluator().num_constraints() for binding in constraints)
    hessian = 2 * options.weights.lambda1 * h * scale
    return Problem(program, variables, program.initial_guess(), hessian, n_rows)


def unpack(problem: Problem, program_values: np.ndarray) -> Trajectory:
    """The trajectory in the values of all decision variables."""
    index = problem.program.FindDecisionVariableIndices
    variables = problem.variables
    knots = program_values[index(variables.knots.ravel())].reshape(variables.knots.shape)
    step = variables.fixed_step
    if variables.free_horizon:
        step = float(program_values[index(variables.step)][0]) * STEP_SCALE
    return variables.trajectory(knots, step)
