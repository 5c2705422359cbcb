"""The methods that are compared: ways to plan a task, and ways to solve the optimal control problem from a guess.

Of planning, where the guess comes from; what follows is the same planner for all:

- gnn: the network's best hypotheses, one after the other, and nothing else.
- gnn_paper: the same with the paper's network.
- hybrid_astar, rrt_star: the search with the speed planner.
- auto: gnn, then Hybrid A* where that gave no verified plan.
- gnn_direct, hybrid_astar_direct: what the guess is worth to Ipopt alone. The first guess goes straight to it, without
  SQP steps before it; no other hypothesis is looked at, and no second attempt made.

Of solving:

- drake: ours, refined until it is verified.
- casadi_mx, casadi_sx: the peer with its best settings, its graph mapped or expanded; one solve.
- casadi_plain: casadi_mx with Ipopt's default options.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from drake_gnnocp.budget import Budget
from drake_gnnocp.experiments.benchmark.disparity import disparity
from drake_gnnocp.experiments.benchmark.guesses import blocked_share, mean_defect
from drake_gnnocp.experiments.benchmark.runs import Key, Run
from drake_gnnocp.experiments.benchmark.tasks import Task
from drake_gnnocp.guesses import Guess, GuessUnavailable
from drake_gnnocp.guesses.learned import bundled_weights
from drake_gnnocp.ocp.costs import CostWeights, evaluate_cost
from drake_gnnocp.ocp.formulation import formulate
from drake_gnnocp.ocp.ipopt import FINISH, USUAL
from drake_gnnocp.planner import FromGuess, Plan, PlanOptions, plan
from drake_gnnocp.planner.attempt import attempt
from drake_gnnocp.planner.options import source_named
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.verification import verify

GNN, GNN_PAPER, HYBRID_ASTAR, RRT_STAR, AUTO = "gnn", "gnn_paper", "hybrid_astar", "rrt_star", "auto"
GNN_DIRECT, HYBRID_ASTAR_DIRECT = "gnn_direct", "hybrid_astar_direct"
PLANNERS = (GNN, HYBRID_ASTAR, RRT_STAR, AUTO, GNN_PAPER, GNN_DIRECT, HYBRID_ASTAR_DIRECT)
DIRECT = {GNN_DIRECT: GNN, HYBRID_ASTAR_DIRECT: HYBRID_ASTAR}
KINDS = {GNN_PAPER: GNN, **DIRECT}  # of the guess that the planner is asked for, where the method's name is another

DRAKE, CASADI_MX, CASADI_SX, CASADI_FATROP, CASADI_PLAIN = SOLVERS = (
    "drake",
    "casadi_mx",
    "casadi_sx",
    "casadi_fatrop",
    "casadi_plain",
)
CASADI = (CASADI_MX, CASADI_SX, CASADI_FATROP)  # the peer is the fastest of them, task by task
DRAKE_SUCCESS = ("Success", "Stop at acceptable point")
STOP_NOTE = f"""\
Stopped by progress: cost
  within {USUAL.objective_change:.1%} and constraints within {USUAL.feasibility:g} m for {USUAL.settled_iterations}
  iterations; where the SQP steps have converged, cost within {FINISH.objective_change:.2%} in one iteration."""
WARM_UP_SECONDS = 5.0  # s, most for one method


# ------------------------------------------------------------------------------------------------------------ planning

PAPER_PLAN = PlanOptions(cost=CostWeights.paper(), margin=0.1, comfort=0.0)  # what the tables compare


@dataclass(frozen=True)
class Method:
    """A way to plan."""

    name: str  # in the rows
    kind: str  # of guess that the planner is asked for
    options: PlanOptions = PAPER_PLAN

    @property
    def source(self) -> str:
        """The guess that is asked for first."""
        return GNN if self.kind == AUTO else self.kind

    @property
    def weights(self) -> Path | None:
        """The file of the network, None where there is none in this method."""
        return (self.options.weights or bundled_weights()) if self.source == GNN else None


def method_named(name: str, seed: int = 0, weights: Path | None = None) -> Method:
    """One of PLANNERS, with a seed for RRT* and the weights of gnn, gnn_direct and auto (None: the package's)."""
    options = replace(PAPER_PLAN, seed=seed, weights=bundled_weights("paper") if name == GNN_PAPER else weights)
    return Method(name, KINDS.get(name, name), direct(options) if name in DIRECT else options)


def network_method(name: str, weights: Path, is_direct: bool) -> Method:
    """Gnn or gnn_direct under another name, with the network in a file."""
    return replace(method_named(GNN_DIRECT if is_direct else GNN, weights=weights), name=name)


def direct(options: PlanOptions) -> PlanOptions:
    """Options with which the first guess goes straight to Ipopt, and nothing else is tried."""
    return replace(options, sqp=False, hypotheses=1, most_attempts=1)


def default_of(parameter: str) -> float:
    """The planner's value of what `varied` can change."""
    options = PAPER_PLAN
    values = {"hypotheses": options.hypotheses, "knots": options.knots}
    return {**values, "lambda2": options.cost.lambda2, "gamma": options.cost.gamma}[parameter]


def varied(method: Method, parameter: str, value: float) -> Method:
    """The method with another number of `hypotheses` or `knots`, or another weight `lambda2` or `gamma` of the cost."""
    options = method.options
    if parameter == "hypotheses":
        return replace(method, options=replace(options, hypotheses=int(value)))
    if parameter == "knots":
        return replace(method, options=replace(options, knots=int(value)))
    cost = replace(options.cost, lambda2=value) if parameter == "lambda2" else replace(options.cost, gamma=value)
    return replace(method, options=replace(options, cost=cost))


def check_methods(methods: Iterable[Method]) -> None:
    """Raise GuessUnavailable where a method needs what is not there; `auto` needs weights here as well."""
    for method in methods:
        source_named(method.source, method.options)


def why_unavailable(method: Method) -> str:
    """What a method needs that is not there, in one line; empty where it can be used."""
    try:
        check_methods([method])
    except GuessUnavailable as error:
        return " ".join(str(error).split())
    return ""


def planned(task: Task, method: Method, max_seconds: float, repeat: int = 0) -> Plan:
    """The plan of a task by a method; `max_seconds` is the wall-clock budget [s]."""
    options = replace(method.options, seed=method.options.seed + repeat)
    return plan(task.scenario, method.kind, max_seconds=max_seconds, options=options)


def run_planner(task: Task, method: Method, repeat: int, max_seconds: float) -> Run:
    """Plan a task with a method; `max_seconds` is the wall-clock budget [s]."""
    key = (*task.key, "", method.name, repeat)
    return run_of_plan(key, method.source, planned(task, method, max_seconds, repeat))


def run_of_plan(key: Key, source: str, result: Plan) -> Run:
    """The row of a plan that was asked for from a source of guesses."""
    solves = [attempt for attempt in result.attempts if attempt.solver_status]
    check, off = result.verification, disparity(result.guess, result.trajectory)
    return Run(
        *key,
        guess_s=sum(attempt.guess_seconds for attempt in result.attempts),
        build_s=sum(attempt.build_seconds for attempt in result.attempts),
        solve_s=sum(attempt.solve_seconds for attempt in result.attempts),
        total_s=result.total_seconds,
        convex_steps=solves[0].sqp_steps if solves else 0,
        first_iterations=solves[0].first_iterations if solves else 0,
        iterations=sum(attempt.iterations for attempt in solves),
        rounds=sum(1 + attempt.refinements for attempt in solves),
        cost=result.cost.J if result.cost else math.nan,
        verified=result.verified,
        fallback=result.guess_source != source,
        clearance_m=check.min_clearance_m if check else math.nan,
        duration_s=result.trajectory.duration if result.trajectory else math.nan,
        gear_changes=result.trajectory.gear_changes if result.trajectory else math.nan,
        disparity_position=off.position,
        disparity_theta=off.theta,
        disparity_v=off.v,
        disparity_phi=off.phi,
        guess_blocked=blocked_share(result.scenario, result.guess),
        guess_gap_m=mean_defect(result.scenario, result.guess),
        status=result.status,
        reason="; ".join(f"{attempt.source}: {attempt.reason}" for attempt in result.attempts if attempt.reason),
    )


def warm_up_planners(methods: Sequence[Method]) -> None:
    """Load what the methods load at their first call, so that no run pays for it."""
    for method in {(method.kind, method.weights): method for method in methods}.values():  # options load nothing else
        run_planner(_warm_up_task(), method, 0, WARM_UP_SECONDS)


def _warm_up_task() -> Task:
    block = np.array([[4.0, 2.0], [8.0, 2.0], [8.0, 4.0], [4.0, 4.0]])
    return Task(Scenario("warm up", np.zeros(3), np.array([12.0, 0.0, 0.0]), (block,)), "")


# ------------------------------------------------------------------------------------------------------------- solving


def run_solver(key: Key, scenario: Scenario, guess: Trajectory, max_seconds: float) -> tuple[Run, Trajectory]:
    """Solve a scenario near the origin from a guess, with the one of SOLVERS that the key names.

    Returns:
        The row and the plan; cost and verification are computed here, for all solvers alike.
    """
    solve = _with_drake if key[3] == DRAKE else _with_peer
    run, trajectory = solve(Run(*key), scenario, guess, max_seconds)
    return checked(run, scenario, trajectory), trajectory


def checked(run: Run, scenario: Scenario, trajectory: Trajectory) -> Run:
    """The row with the cost and the verification of a trajectory."""
    check = verify(scenario, trajectory)
    cost = evaluate_cost(trajectory, scenario, PAPER_PLAN.cost).J
    reason = "; ".join(check.faults)
    return replace(run, cost=cost, clearance_m=check.min_clearance_m, verified=check.verified, reason=reason)


def warm_up_solvers() -> None:
    """Load what the solvers load at their first call, so that no task pays for it."""
    t = np.linspace(0.0, 12.0, 10)
    states = np.zeros((10, 5))
    states[:, 0], states[:, 3] = t, 1.0
    task, guess = _warm_up_task(), Trajectory(t, states, np.zeros((10, 2)))
    for solver in (DRAKE, *CASADI):
        try:
            run_solver((*task.key, "", solver, 0), task.scenario, guess, WARM_UP_SECONDS)
        except ModuleNotFoundError:  # casadi is optional, and the command line has asked for it where it is needed
            return


def _with_drake(run: Run, scenario: Scenario, guess: Trajectory, max_seconds: float) -> tuple[Run, Trajectory]:
    begin = time.perf_counter()
    given = Guess("given", guess, is_timed=True)
    result = attempt(scenario, given, FromGuess(), Budget.of(max_seconds), PAPER_PLAN)
    wall = time.perf_counter() - begin
    if result.trajectory is None:
        return replace(run, total_s=wall, status="no solve"), guess
    made = replace(
        run,
        build_s=result.build_seconds,
        solve_s=result.solve_seconds,
        total_s=wall,
        convex_steps=result.sqp_steps,
        first_iterations=result.first_iterations,
        iterations=result.iterations,
        rounds=len(result.solves),
        rows=result.solves[0].rows,
        converged=result.solver_status in DRAKE_SUCCESS,
        status=result.solver_status,
    )
    return made, result.trajectory


def _with_peer(run: Run, scenario: Scenario, guess: Trajectory, max_seconds: float) -> tuple[Run, Trajectory]:
    from drake_gnnocp.experiments.benchmark.casadi_peer import solve_with_casadi  # optional
    from drake_gnnocp.experiments.benchmark.casadi_stages import solve_with_fatrop

    begin = time.perf_counter()
    problem = formulate(scenario, guess, PAPER_PLAN.cost, PAPER_PLAN.margin)
    if run.method == CASADI_FATROP:
        solution = solve_with_fatrop(problem)
    else:
        solution = solve_with_casadi(problem, run.method == CASADI_SX, max_seconds, run.method != CASADI_PLAIN)
    total = time.perf_counter() - begin
    made = replace(
        run,
        build_s=total - solution.solve_seconds,
        solve_s=solution.solve_seconds,
        total_s=total,
        first_iterations=solution.iterations,
        iterations=solution.iterations,
        rounds=1,
        rows=solution.rows,
        converged=solution.success,
        status=solution.status,
    )
    numbers = np.concatenate([solution.trajectory.states.ravel(), solution.trajectory.inputs.ravel()])
    return made, solution.trajectory if np.isfinite(numbers).all() else guess  # solvers may return NaN
