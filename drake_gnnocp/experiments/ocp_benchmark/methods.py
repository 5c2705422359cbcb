"""The methods that are compared, each from a task and a guess to a plan and how it came about.

- drake: ours, refined until it is verified.
- casadi_mx, casadi_sx: the peer with its best settings, its graph mapped or expanded; one solve.
- casadi_plain: casadi_mx with Ipopt's default options.
- tutorial: Drake as a user would first write it; one solve.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from drake_gnnocp.experiments.ocp_benchmark.peer_problem import PeerProblem, peer_problem
from drake_gnnocp.ocp.refine import RefineOptions, optimise
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.trajectory import Trajectory

if TYPE_CHECKING:
    from drake_gnnocp.experiments.ocp_benchmark.casadi_peer import CasadiSolution
    from drake_gnnocp.experiments.ocp_benchmark.tutorial import TutorialSolution

DRAKE, CASADI_MX, CASADI_SX, CASADI_PLAIN, TUTORIAL = "drake", "casadi_mx", "casadi_sx", "casadi_plain", "tutorial"
METHODS = (DRAKE, CASADI_MX, CASADI_SX, CASADI_PLAIN, TUTORIAL)
CASADI = (CASADI_MX, CASADI_SX)  # the peer is the faster of the two, task by task
DRAKE_SUCCESS = ("Success", "Stop at acceptable point")


@dataclass(frozen=True)
class Outcome:
    """What a method made of a task."""

    trajectory: Trajectory
    build_seconds: float  # s, all rounds
    solve_seconds: float  # s, all rounds
    wall_seconds: float  # s, the whole call
    convex_steps: int  # before the first solve
    first_iterations: int
    iterations: int
    rounds: int
    rows: int
    converged: bool
    status: str


def run_method(method: str, scenario: Scenario, guess: Trajectory, max_seconds: float) -> Outcome:
    """Run one of `METHODS` on a scenario near the origin, for `max_seconds` [s] of wall time."""
    if method == DRAKE:
        return _run_drake(scenario, guess, max_seconds)
    return _run_peer(method, scenario, guess, max_seconds)


def warm_up() -> None:
    """Load what the solvers load at their first call, so that no task pays for it."""
    t = np.linspace(0.0, 12.0, 10)
    states = np.zeros((10, 5))
    states[:, 0], states[:, 3] = t, 1.0
    block = np.array([[4.0, 2.0], [8.0, 2.0], [8.0, 4.0], [4.0, 4.0]])
    scenario = Scenario("warm up", np.zeros(3), np.array([12.0, 0.0, 0.0]), (block,))
    for method in (DRAKE, *CASADI):
        try:
            run_method(method, scenario, Trajectory(t, states, np.zeros((10, 2))), 5.0)
        except ModuleNotFoundError:  # casadi is optional, and the command line has asked for it where it is needed
            return


def _run_drake(scenario: Scenario, guess: Trajectory, max_seconds: float) -> Outcome:
    begin = time.perf_counter()
    result = optimise(scenario, guess, RefineOptions(), time.monotonic() + max_seconds)
    wall = time.perf_counter() - begin
    rounds = result.rounds
    return Outcome(
        trajectory=result.trajectory,
        build_seconds=sum(r.build_seconds for r in rounds),
        solve_seconds=sum(r.solve_seconds for r in rounds),
        wall_seconds=wall,
        convex_steps=rounds[0].convex_steps if rounds else 0,
        first_iterations=rounds[0].iterations if rounds else 0,
        iterations=sum(r.iterations for r in rounds),
        rounds=len(rounds),
        rows=rounds[0].rows if rounds else 0,
        converged=bool(rounds) and rounds[-1].status in DRAKE_SUCCESS,
        status=rounds[-1].status if rounds else "no solve",
    )


def _run_peer(method: str, scenario: Scenario, guess: Trajectory, max_seconds: float) -> Outcome:
    begin = time.perf_counter()
    solution: TutorialSolution | CasadiSolution
    problem = peer_problem(scenario, guess, RefineOptions())
    chosen = time.perf_counter() - begin  # choosing the rows is part of building
    if method == TUTORIAL:
        from drake_gnnocp.experiments.ocp_benchmark.tutorial import solve_tutorial

        solution = solve_tutorial(problem, max_seconds - chosen)
    else:
        from drake_gnnocp.experiments.ocp_benchmark.casadi_peer import PLAIN, TUNED, solve_with_casadi

        settings = PLAIN if method == CASADI_PLAIN else TUNED
        solution = solve_with_casadi(problem, method == CASADI_SX, max_seconds - chosen, settings)
    return Outcome(
        trajectory=_finite(problem, solution.trajectory),
        build_seconds=chosen + solution.build_seconds,
        solve_seconds=solution.solve_seconds,
        wall_seconds=time.perf_counter() - begin,
        convex_steps=0,
        first_iterations=solution.iterations,
        iterations=solution.iterations,
        rounds=1,
        rows=problem.n_rows,
        converged=solution.success,
        status=solution.status,
    )


def _finite(problem: PeerProblem, trajectory: Trajectory) -> Trajectory:
    """The trajectory, or the guess where a solver gave numbers that are none."""
    ok = math.isfinite(float(np.sum(np.abs(trajectory.states)) + np.sum(np.abs(trajectory.inputs))))
    return trajectory if ok else problem.guess
