r"""Convex steps: quadratic programs that pull a rough guess near the optimum before Ipopt finishes it.

With the knots z at hand, d the change of all of them, and the letters of the other modules, one step is

    min   lambda1 h sum (a + da)^2 + (w + dw)^2  +  J2's gradient and the convex part of its Hessian
          + h/2 sum rho |d state|^2  +  penalty h sum s
    s.t.  linearised defects (Hermite-Simpson) = 0,        ends fixed,        v, phi, a, w within their limits,
          distance_i + gradient_i . d_k >= margin_i - s_i,  s_i >= 0          (half planes of near pairs)

J1 has its exact Hessian here, which a limited-memory BFGS has to find out iteration by iteration. Only the obstacles
are soft: a step that meets the dynamics exists almost always, however far the guess is from them. rho falls as the
steps get shorter, and the defects fall with their square.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np
from pydrake.solvers import Binding, ClarabelSolver, MathematicalProgram, SolverOptions

from drake_gnnocp.ocp.cost import convex_proximity, proximity
from drake_gnnocp.ocp.dynamics import defects
from drake_gnnocp.ocp.half_planes import POINTS, SWEPT_GAP, HalfPlanes, half_planes
from drake_gnnocp.ocp.problem import ProblemOptions
from drake_gnnocp.ocp.rings import ConvexRings
from drake_gnnocp.ocp.variables import N_KNOT, N_STATES
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import State

# pydrake takes dense matrices: small blocks cost calls, large ones zeros. Without order="F" it looks for scipy first
INTERVALS_PER_BLOCK = 20  # of linearised dynamics
KNOTS_PER_BLOCK = 8  # of the cost
PAIRS_PER_BLOCK = 100  # of half planes
POSE, FIRST_INPUT = int(State.V), N_STATES  # columns of a knot: x, y, theta | v, phi | a, w
WALL = 20.0  # m, thickness of the walls around the bounds


@dataclass(frozen=True)
class ConvexOptions:
    """How many steps and how large."""

    most_steps: int = 12  # 0: none
    useless: float = 0.1  # m (and rad), largest defect with which steps that did not settle are still worth a start
    settled_cost: float = 2e-3  # relative, change of the cost in the last step before a stop
    settled_defect: float = 1e-4  # m (and rad), largest defect left
    settled_missing: float = 0.01  # m, largest margin missing
    patience: int = 12  # steps, after which those that lead into obstacles are given up
    hopeless: float = 0.3  # m, margin missing then
    near: float = 0.8  # m, pairs that get half planes
    penalty: float = 30.0  # 1/m/s, of a missing margin
    reach: tuple[float, float, float] = (1.5, 1.5, 0.5)  # m, m, rad: longer steps are shortened to it
    proximal: float = 0.1  # 1/s, rho of the first step
    relaxation: float = 0.1  # what rho is multiplied by after a step that is shorter than the one before
    damping: float = 10.0  # ... and after one that is not: two solutions then take turns
    shrinking: float = 0.8  # of the step before: what counts as shorter
    near_limit: float = 0.5  # of a limit: what is beyond it gets the limit as a row
    tolerance: float = 1e-3  # of the solver


@dataclass(frozen=True)
class ConvexSteps:
    """Where the steps ended."""

    trajectory: Trajectory
    steps: int
    settled: bool  # whether cost and defects had settled
    missing: float  # m, the largest margin missing, inf where that is not known
    seconds: float  # s


def convex_steps(
    scenario: Scenario, guess: Trajectory, problem: ProblemOptions, options: ConvexOptions, deadline: float = math.inf
) -> ConvexSteps:
    """Take convex steps until they have settled or there were enough.

    Args:
        scenario: the task, near the origin.
        guess: equally spaced knots, any quality.
        problem: gives the cost's weights and the margins; its horizon is taken as fixed.
        options: see `ConvexOptions`.
        deadline: instant of `time.monotonic()` [s] after which no step begins.

    Returns:
        The guess itself where a program could not be solved, or the steps led to nothing that can be driven.
    """
    begin = time.perf_counter()
    h = guess.duration / (len(guess) - 1)
    knots = np.hstack([guess.states, guess.inputs])
    turns = 2 * np.pi * np.round((knots[-1, State.THETA] - scenario.goal[2]) / (2 * np.pi))
    for end, pose in ((0, scenario.start), (-1, scenario.goal + [0.0, 0.0, turns])):
        knots[end] = np.append(pose, np.zeros(N_KNOT - len(pose)))
    program = StepProgram(scenario, len(knots), h, problem, options)
    planes, cost, proximal, largest = program.planes(knots), math.inf, options.proximal, math.inf
    steps, settled, missing = 0, False, math.inf
    while steps < options.most_steps and not settled and time.monotonic() < deadline:
        change = program.solve(knots, planes, proximal)
        if change is None:  # the limits that the last step went beyond cannot be held
            return ConvexSteps(guess, steps, False, math.inf, time.perf_counter() - begin)
        before, largest_before = cost, largest
        largest = float((np.abs(change[:, :POSE]).max(axis=0) / options.reach).max())
        knots, steps = knots + change / max(1.0, largest), steps + 1
        proximal *= options.relaxation if largest < options.shrinking * largest_before else options.damping
        planes, cost = program.planes(knots), program.cost(knots)
        missing = float(program.missing(planes).max(initial=0.0))
        settled = (
            abs(before - cost) < options.settled_cost * cost
            and program.gap(knots) < options.settled_defect
            and missing < options.settled_missing
        )
        if steps >= options.patience and missing > options.hopeless:
            break
    trajectory = guess
    if steps and program.gap(knots) < options.useless:
        trajectory = Trajectory(guess.t, knots[:, :N_STATES], knots[:, N_STATES:])
    return ConvexSteps(trajectory, steps, settled, missing, time.perf_counter() - begin)


class StepProgram:
    """The quadratic program of a step, built once: steps change its numbers."""

    def __init__(
        self, scenario: Scenario, n_knots: int, h: float, problem: ProblemOptions, options: ConvexOptions
    ) -> None:
        self._scenario, self._h, self._weights, self._options = scenario, h, problem.weights, options
        self._obstacles, self._margins = _guarded(scenario, problem)
        self._program = MathematicalProgram()
        self._change = self._program.NewContinuousVariables(n_knots, N_KNOT, "d")
        self._slacks = np.zeros(0, dtype=object)
        fixed = self._change[[0, -1]].ravel()
        self._program.AddBoundingBoxConstraint(np.zeros(len(fixed)), np.zeros(len(fixed)), fixed)
        self._dynamics = []
        for first in range(0, n_knots - 1, INTERVALS_PER_BLOCK):
            last = min(first + INTERVALS_PER_BLOCK, n_knots - 1)
            shape = (N_STATES * (last - first), N_KNOT * (last - first + 1))
            rows = self._program.AddLinearEqualityConstraint(
                np.zeros(shape, order="F"), np.zeros(shape[0]), self._change[first : last + 1].ravel()
            )
            self._dynamics.append((first, last, rows.evaluator()))
        self._costs = []
        for first in range(1, n_knots - 1, KNOTS_PER_BLOCK):
            block = self._change[first : min(first + KNOTS_PER_BLOCK, n_knots - 1)]
            n = block.size
            term = self._program.AddQuadraticCost(np.zeros((n, n)), np.zeros(n), 0.0, block.ravel(), is_convex=True)
            self._costs.append((first, first + len(block), term.evaluator()))
        self._solver, self._settings = ClarabelSolver(), SolverOptions()
        for name in ("tol_gap_abs", "tol_gap_rel", "tol_feas"):
            self._settings.SetOption(self._solver.solver_id(), name, options.tolerance)
        # the numbers are of order 1 and a thousandth is enough: without these three it takes 0.55 times as long
        for name in ("equilibrate_enable", "iterative_refinement_enable", "presolve_enable"):
            self._settings.SetOption(self._solver.solver_id(), name, 0)
        vehicle = scenario.vehicle
        self._limits = np.array([vehicle.v_max, vehicle.phi_max, vehicle.a_max, vehicle.w_max])

    def cost(self, knots: np.ndarray) -> float:
        """J of knots (N, 7)."""
        j1 = np.sum(knots[:, FIRST_INPUT:] ** 2)
        j2 = proximity(knots[:, :2], self._scenario.centroids, self._weights.gamma)[0].sum()
        return self._h * float(self._weights.lambda1 * j1 + self._weights.lambda2 * j2)

    def gap(self, knots: np.ndarray) -> float:
        """The largest defect of knots (N, 7) [m, rad]."""
        return float(np.abs(defects(knots, self._h, self._scenario.vehicle.wheelbase)[0]).max())

    def planes(self, knots: np.ndarray) -> HalfPlanes:
        """Rows of the obstacles near knots (N, 7)."""
        poses = knots[:, :POSE]
        return half_planes(poses, self._obstacles, self._scenario.vehicle, self._options.near)

    def missing(self, planes: HalfPlanes) -> np.ndarray:
        """What the rows lack of their margins: (P, POINTS), negative where they have more [m]."""
        margins = self._margins[planes.obstacle]
        margins[planes.between] = np.minimum(margins[planes.between], SWEPT_GAP)
        return margins[:, None] - planes.value

    def solve(self, knots: np.ndarray, planes: HalfPlanes, proximal: float) -> np.ndarray | None:
        """The change of the knots (N, 7), in SI units; None where the solver failed."""
        self._set_dynamics(knots)
        self._set_cost(knots, proximal)
        added = self._limit_rows(knots) + (self._plane_rows(planes) if len(planes) else [])
        result = self._solver.Solve(self._program, None, self._settings)
        for binding in added:
            self._program.RemoveConstraint(binding)
        if not result.is_success():
            return None
        n_knots = len(self._change)  # the first variables, which Drake keeps column by column
        return result.get_x_val()[: self._change.size].reshape(N_KNOT, n_knots).T

    def _set_dynamics(self, knots: np.ndarray) -> None:
        value, derivative = defects(knots, self._h, self._scenario.vehicle.wheelbase)
        for first, last, rows in self._dynamics:
            n = last - first
            matrix, i = np.zeros((n, N_STATES, n + 1, N_KNOT)), np.arange(n)
            matrix[i, :, i] = derivative[first:last, :, :N_KNOT]
            matrix[i, :, i + 1] = derivative[first:last, :, N_KNOT : 2 * N_KNOT]
            rows.UpdateCoefficients(matrix.reshape(N_STATES * n, -1), -value[first:last].ravel())

    def _set_cost(self, knots: np.ndarray, proximal: float) -> None:
        factor, weights = 2 * self._h * self._weights.lambda1, self._weights
        gradient = np.zeros_like(knots)
        gradient[:, FIRST_INPUT:] = factor * knots[:, FIRST_INPUT:]
        _, slope, bend = convex_proximity(knots[:, :2], self._scenario.centroids, weights.gamma)
        gradient[:, :2] = self._h * weights.lambda2 * slope
        diagonal = np.diag([self._h * proximal] * N_STATES + [factor, factor])
        for first, last, term in self._costs:
            n = last - first
            matrix, i = np.zeros((n, N_KNOT, n, N_KNOT)), np.arange(n)
            matrix[i, :, i] = diagonal
            matrix[i, :2, i, :2] += self._h * weights.lambda2 * bend[first:last]
            term.UpdateCoefficients(matrix.reshape(n * N_KNOT, -1), gradient[first:last].ravel(), 0.0, is_convex=True)

    def _limit_rows(self, knots: np.ndarray) -> list[Binding]:
        values, change = knots[1:-1, POSE:], self._change[1:-1, POSE:]
        limits = np.broadcast_to(self._limits, values.shape)
        close = np.abs(values) > self._options.near_limit * limits
        if not close.any():
            return []
        values, limits = values[close], limits[close]
        return [self._program.AddBoundingBoxConstraint(-limits - values, limits - values, change[close])]

    def _plane_rows(self, planes: HalfPlanes) -> list[Binding]:
        self._add_slacks(len(planes) - len(self._slacks))
        lacking, by_knot = self.missing(planes), np.argsort(planes.knot, kind="stable")
        added = []
        for pairs in np.array_split(by_knot, math.ceil(len(by_knot) / PAIRS_PER_BLOCK)):
            knots, position = np.unique(planes.knot[pairs], return_inverse=True)
            n, poses = len(pairs), POSE * len(knots)
            matrix, i = np.zeros((n, POINTS, poses + n)), np.arange(n)
            for column in range(POSE):
                matrix[i, :, POSE * position + column] = planes.gradient[pairs, :, column]
            matrix[i, :, poses + i] = 1.0
            block = np.concatenate([self._change[knots, :POSE].ravel(), self._slacks[pairs]])
            lower = lacking[pairs].ravel()
            upper = np.full(len(lower), np.inf)
            rows = np.asfortranarray(matrix.reshape(len(lower), -1))
            added.append(self._program.AddLinearConstraint(rows, lower, upper, block))
        return added

    def _add_slacks(self, n: int) -> None:
        if n <= 0:
            return
        new = self._program.NewContinuousVariables(n, "s")
        self._program.AddBoundingBoxConstraint(np.zeros(n), np.full(n, np.inf), new)
        self._program.AddLinearCost(np.full(n, self._options.penalty * self._h), 0.0, new)
        self._slacks = np.concatenate([self._slacks, new])


def _guarded(scenario: Scenario, problem: ProblemOptions) -> tuple[ConvexRings, np.ndarray]:
    """Convex obstacles and walls around the bounds, and the margins (J,) asked of them [m].

    No obstacle is asked for more than it leaves at start and goal: the knots next to them cannot have it.
    """
    margins = np.minimum(problem.guess_share * scenario.end_clearances, problem.margin)
    obstacles = scenario.convex_obstacles
    if scenario.bounds is not None:
        xmin, xmax, ymin, ymax = scenario.bounds
        low, high = np.array([xmin, ymin]) - WALL, np.array([xmax, ymax]) + WALL
        boxes = ((low, (xmin, high[1])), ((xmax, low[1]), high), (low, (high[0], ymin)), ((low[0], ymax), high))
        obstacles += tuple(np.array([[a[0], a[1]], [b[0], a[1]], [b[0], b[1]], [a[0], b[1]]]) for a, b in boxes)
        margins = np.append(margins, np.full(len(boxes), problem.bounds_margin))
    return ConvexRings.of(obstacles), margins
