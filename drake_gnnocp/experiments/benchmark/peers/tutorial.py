"""The same problem as a user of Drake would first write it: variables in SI units, one Python function a constraint.

Every interval, every knot and obstacle, and every knot of the cost is a callback of its own on AutoDiffXd numbers, with
a dense gradient, and Ipopt keeps its default options. It shows what the formulation of `drake_gnnocp.ocp` is worth.
"""

from __future__ import annotations

import math
import re
import tempfile
import time
from pathlib import Path

import numpy as np
from pydrake.math import cos, exp, sin, tan
from pydrake.solvers import IpoptSolver, MathematicalProgram, SolverOptions

from drake_gnnocp.experiments.benchmark.peers.problem import (
    N_KNOT,
    N_STATES,
    PairRows,
    PeerProblem,
    PeerSolution,
    SideRows,
    area,
    triangle_sum,
)
from drake_gnnocp.trajectory import Trajectory


def solve_tutorial(problem: PeerProblem, max_seconds: float) -> PeerSolution:
    """Build and solve; the limit [s] covers both, except that Ipopt finishes the iteration it is in."""
    begin = time.perf_counter()
    program, knots = build_tutorial(problem)
    built = time.perf_counter()
    solver, settings = IpoptSolver(), SolverOptions()
    with tempfile.TemporaryDirectory(prefix="tutorial") as folder:
        log = Path(folder) / "log"
        left = max(max_seconds - (built - begin), 1e-3)
        for name, value in {"max_wall_time": left, "output_file": str(log), "file_print_level": 3}.items():
            settings.SetOption(solver.solver_id(), name, value)
        result = solver.Solve(program, program.initial_guess(), settings)
        end = time.perf_counter()
        found = re.search(r"Number of Iterations\.*: *(\d+)", log.read_text())
    values = result.GetSolution(knots)
    trajectory = Trajectory(problem.guess.t, values[:, :N_STATES], values[:, N_STATES:])
    status = result.get_solver_details().ConvertStatusToString()
    iterations = int(found.group(1)) if found else 0
    return PeerSolution(trajectory, result.is_success(), status, iterations, built - begin, end - built)


def build_tutorial(problem: PeerProblem) -> tuple[MathematicalProgram, np.ndarray]:
    """The program and its variables (N, 7)."""
    program = MathematicalProgram()
    knots = program.NewContinuousVariables(len(problem.guess), N_KNOT, "knot")
    for k, pose in ((0, problem.scenario.start), (-1, problem.goal)):
        values = np.append(pose, np.zeros(4))
        program.AddBoundingBoxConstraint(values, values, knots[k])
    for knot in knots[1:-1]:
        program.AddBoundingBoxConstraint(-problem.limits, problem.limits, knot[3:])
    _add_dynamics(program, knots, problem)
    for rows in problem.pairs:
        _add_areas(program, knots, rows, problem.margin)
    for side in problem.sides:
        _add_side(program, knots, side, problem)
    _add_cost(program, knots, problem)
    program.SetInitialGuess(knots, np.hstack([problem.guess.states, problem.guess.inputs]))
    return program, knots


def _add_dynamics(program: MathematicalProgram, knots: np.ndarray, problem: PeerProblem) -> None:
    h, wheelbase = problem.step, problem.scenario.vehicle.wheelbase

    def rates(knot: np.ndarray) -> np.ndarray:
        _, _, theta, v, phi, a, w = knot
        return np.array([v * cos(theta), v * sin(theta), v * tan(phi) / wheelbase, a, w])

    def defect(x: np.ndarray) -> np.ndarray:
        left, right = x[:N_KNOT], x[N_KNOT:]
        f0, f1 = rates(left), rates(right)
        middle = (left + right) / 2
        middle[:N_STATES] = middle[:N_STATES] + h / 8 * (f0 - f1)
        return right[:N_STATES] - left[:N_STATES] - h / 6 * (f0 + 4 * rates(middle) + f1)

    zeros = np.zeros(N_STATES)
    for left, right in zip(knots[:-1], knots[1:], strict=True):
        program.AddConstraint(defect, zeros, zeros, np.append(left, right))


def _add_areas(program: MathematicalProgram, knots: np.ndarray, rows: PairRows, margin: float) -> None:
    for k in np.unique(rows.knot):
        at_knot = rows.knot == k
        points, length = rows.point[at_knot], rows.length[at_knot]

        def distances(pose: np.ndarray, points: np.ndarray = points, length: np.ndarray = length) -> np.ndarray:
            c, s = cos(pose[2]), sin(pose[2])
            rotation = np.array([[c, -s], [s, c]])
            seen = pose[:2] + points @ rotation.T if rows.of_car else (points - pose[:2]) @ rotation
            return (triangle_sum(seen, rows.ring) - area(rows.ring)) / length

        lower, upper = np.full(len(points), margin), np.full(len(points), math.inf)
        program.AddConstraint(distances, lower, upper, knots[k, :3])


def _add_side(program: MathematicalProgram, knots: np.ndarray, side: SideRows, problem: PeerProblem) -> None:
    corners = problem.scenario.vehicle.corners

    def distances(pose: np.ndarray) -> np.ndarray:
        c, s = cos(pose[2]), sin(pose[2])
        turned = corners @ np.array([[c, s], [-s, c]])
        return side.sign * (pose[side.axis] + turned[:, side.axis] - side.bound)

    lower, upper = np.full(len(corners), problem.bounds_margin), np.full(len(corners), math.inf)
    for k in side.knots:
        program.AddConstraint(distances, lower, upper, knots[k, :3])


def _add_cost(program: MathematicalProgram, knots: np.ndarray, problem: PeerProblem) -> None:
    h, weights = problem.step, problem.weights

    def proximity(position: np.ndarray) -> object:
        squared = ((position - problem.centroids) ** 2).sum(axis=1)
        return weights.lambda2 * h * sum(exp(-math.log(weights.gamma) * d2) for d2 in squared)

    for knot in knots:
        program.AddQuadraticCost(weights.lambda1 * h * (knot[5] ** 2 + knot[6] ** 2))
        if len(problem.centroids):
            program.AddCost(proximity, vars=knot[:2])
