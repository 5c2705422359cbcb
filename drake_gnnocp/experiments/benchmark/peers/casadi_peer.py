r"""The peer: the same problem in CasADi, with exact Hessians, solved by Ipopt with MUMPS.

Variables are the knots in SI units, 7 each; h is fixed. The constraints are those of `drake_gnnocp.ocp`:

    x_{k+1} - x_k - h / 6 (f_k + 4 f(x_m, u_m) + f_{k+1}) = 0      Hermite-Simpson, all five states
    sum_i S(P, A_i, A_{i+1}) >= S + margin * length                  triangle areas of the pairs near the guess
    corners inside the bounds, |v|, |phi|, |a|, |w| within limits, both ends fixed

Functions of one interval and of one point are written once and mapped over the knots, as CasADi's manual advises. There
is one solve and no refinement. With `expand` the whole graph is scalar (SX): slower to build, faster to evaluate.

Settings of Ipopt: of 18 tried on 20 random tasks none took less time than `TUNED` beyond the noise: 16 iterations and
0.28 s (median), mapped. Ipopt's defaults took 31 iterations and 0.38 s, the small `mu_init` and pushes that our BFGS
needs 22 and 0.33 s; of the gain of `TUNED` over the defaults the rule to stop by progress is a quarter.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from drake_gnnocp.experiments.benchmark.peers.problem import (
    N_KNOT,
    N_STATES,
    PairRows,
    PeerProblem,
    PeerSolution,
    SideRows,
    area,
)
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import Vehicle

HUGE = 1e20
# what is missing are our numbers: the limit of the iterations, and in TUNED the rule to stop by progress
PLAIN = {"linear_solver": "mumps"}
TUNED = {
    **PLAIN,
    "mu_strategy": "adaptive",
    "adaptive_mu_globalization": "kkt-error",
    "acceptable_tol": HUGE,
    "acceptable_dual_inf_tol": HUGE,
}


@dataclass(frozen=True)
class Nlp:
    """minimise f(x) subject to g_low <= g(x) <= g_high, x_low <= x <= x_high."""

    x: ca.MX  # (7 N,) knot by knot
    f: ca.MX
    g: ca.MX
    x0: np.ndarray
    x_low: np.ndarray
    x_high: np.ndarray
    g_low: np.ndarray
    g_high: np.ndarray


def solve_with_casadi(problem: PeerProblem, expand: bool, max_seconds: float, settings: dict[str, Any]) -> PeerSolution:
    """Build and solve.

    Args:
        problem: in numbers.
        expand: whether to make the whole graph scalar.
        max_seconds: limit of the solve [s]; the build, which CasADi cannot interrupt, comes on top.
        settings: of Ipopt.
    """
    begin = time.perf_counter()
    nlp = formulate(problem)
    ipopt = {**settings, "max_wall_time": max_seconds, "print_level": 0, "sb": "yes"}
    options = {"expand": expand, "calc_lam_p": False, "print_time": False, "error_on_fail": False, "ipopt": ipopt}
    solver = ca.nlpsol("peer", "ipopt", {"x": nlp.x, "f": nlp.f, "g": nlp.g}, options)
    built = time.perf_counter()
    result = solver(x0=nlp.x0, lbx=nlp.x_low, ubx=nlp.x_high, lbg=nlp.g_low, ubg=nlp.g_high)
    end = time.perf_counter()
    stats = solver.stats()
    knots = np.array(result["x"]).reshape(-1, N_KNOT)
    trajectory = Trajectory(problem.guess.t, knots[:, :N_STATES], knots[:, N_STATES:])
    success, status, iterations = bool(stats["success"]), stats["return_status"], stats["iter_count"]
    return PeerSolution(trajectory, success, status, iterations, built - begin, end - built)


def formulate(problem: PeerProblem) -> Nlp:
    """The nonlinear program as an expression graph."""
    n, vehicle, h = len(problem.guess), problem.scenario.vehicle, problem.step
    knots = ca.MX.sym("knots", N_KNOT, n)
    constraints: list[tuple[ca.MX, np.ndarray | float, float]]  # g, least, most
    constraints = [(ca.vec(_defects(vehicle, h).map(n - 1)(knots[:, :-1], knots[:, 1:])), 0.0, 0.0)]
    for rows in problem.pairs:
        if len(rows.knot):  # CasADi maps nothing over no knots
            constraints.append((_areas(knots, rows), area(rows.ring) / rows.length + problem.margin, math.inf))
    for side in problem.sides:
        if len(side.knots):
            constraints.append((_distances(knots, side, vehicle), problem.bounds_margin, math.inf))
    lower = np.concatenate([np.broadcast_to(low, g.numel()) for g, low, _ in constraints])
    upper = np.concatenate([np.broadcast_to(high, g.numel()) for g, _, high in constraints])

    x_high = np.full((n, N_KNOT), math.inf)
    x_high[:, 3:] = problem.limits
    x_low = -x_high
    for k, pose in ((0, problem.scenario.start), (-1, problem.goal)):
        x_low[k] = x_high[k] = np.append(pose, np.zeros(4))
    x0 = np.hstack([problem.guess.states, problem.guess.inputs])
    g = ca.vertcat(*(g for g, _, _ in constraints))
    return Nlp(ca.vec(knots), _cost(knots, problem), g, x0.ravel(), x_low.ravel(), x_high.ravel(), lower, upper)


def _rates(state: ca.SX, control: ca.SX, wheelbase: float) -> ca.SX:
    theta, v, phi = state[2], state[3], state[4]
    return ca.vertcat(v * ca.cos(theta), v * ca.sin(theta), v * ca.tan(phi) / wheelbase, control)


def _defects(vehicle: Vehicle, h: float) -> ca.Function:
    """(5,) of one interval from its left and its right knot."""
    left, right = ca.SX.sym("left", N_KNOT), ca.SX.sym("right", N_KNOT)
    (x0, u0), (x1, u1) = ca.vertsplit(left, [0, N_STATES, N_KNOT]), ca.vertsplit(right, [0, N_STATES, N_KNOT])
    f0, f1 = _rates(x0, u0, vehicle.wheelbase), _rates(x1, u1, vehicle.wheelbase)
    middle = (x0 + x1) / 2 + h / 8 * (f0 - f1)
    fm = _rates(middle, (u0 + u1) / 2, vehicle.wheelbase)
    return ca.Function("defects", [left, right], [x1 - x0 - h / 6 * (f0 + 4 * fm + f1)])


def _areas(knots: ca.MX, rows: PairRows) -> ca.MX:
    """sum_i S(P, A_i, A_{i+1}) / length of every row."""
    pose, point, scale = ca.SX.sym("pose", 3), ca.SX.sym("point", 2), ca.SX.sym("scale")
    cos, sin = ca.cos(pose[2]), ca.sin(pose[2])
    if rows.of_car:
        p = pose[:2] + ca.vertcat(cos * point[0] - sin * point[1], sin * point[0] + cos * point[1])
    else:
        from_axle = point - pose[:2]
        p = ca.vertcat(cos * from_axle[0] + sin * from_axle[1], cos * from_axle[1] - sin * from_axle[0])
    total = ca.SX(0)
    for first, second in zip(rows.ring, np.roll(rows.ring, -1, axis=0), strict=True):
        a, b = first - p, second - p
        total += ca.fabs(a[0] * b[1] - a[1] * b[0]) / 2
    one_row = ca.Function("areas", [pose, point, scale], [total * scale])
    return one_row.map(len(rows.knot))(knots[:3, rows.knot.tolist()], rows.point.T, (1 / rows.length)[None]).T


def _distances(knots: ca.MX, side: SideRows, vehicle: Vehicle) -> ca.MX:
    """Distance of all corners to one side of the bounds, at the knots near it."""
    pose = ca.SX.sym("pose", 3)
    cos, sin = ca.cos(pose[2]), ca.sin(pose[2])
    corners = [(cos * x - sin * y, sin * x + cos * y)[side.axis] + pose[side.axis] for x, y in vehicle.corners]
    at_knot = ca.Function("distances", [pose], [side.sign * (ca.vertcat(*corners) - side.bound)])
    return ca.vec(at_knot.map(len(side.knots))(knots[:3, side.knots.tolist()]))


def _cost(knots: ca.MX, problem: PeerProblem) -> ca.MX:
    """lambda1 J1 + lambda2 J2, summed over the knots times h."""
    knot, weights = ca.SX.sym("knot", N_KNOT), problem.weights
    smoothness = ca.sumsqr(knot[N_STATES:])
    proximity = ca.SX(0)
    for centroid in problem.centroids:
        proximity += ca.exp(-math.log(weights.gamma) * ca.sumsqr(knot[:2] - centroid))
    at_knot = ca.Function("cost", [knot], [weights.lambda1 * smoothness + weights.lambda2 * proximity])
    return problem.step * ca.sum2(at_knot.map(knots.shape[1])(knots))
