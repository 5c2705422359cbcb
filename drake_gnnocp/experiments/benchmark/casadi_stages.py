r"""The peer, stage by stage, for fatrop (Vanroye et al. 2023): an interior point method for optimal control.

Its solver wants x_{k+1} = F(x_k, u_k). With the inputs at a knot among the states and those at the next knot as
controls, Hermite-Simpson of a bicycle has that form: v and phi are linear in them, theta' depends on v and phi alone,
and x' and y' on theta besides. The numbers, the rows and the cost are those of `casadi_peer`.

Settings: of eight on 10 random tasks none took less time than `SETTINGS`: 18 iterations (median), with a cost up to
0.7 % above that of the other peers; fatrop's defaults took 25. It stops by the error of the optimality conditions.
"""

from __future__ import annotations

import math
import time

import casadi as ca
import numpy as np

from drake_gnnocp.experiments.benchmark.casadi_peer import (
    N_KNOT,
    N_STATES,
    PeerSolution,
    area_rows,
    cost_of,
    least_areas,
    pair_rows,
)
from drake_gnnocp.ocp.formulation import Formulation
from drake_gnnocp.ocp.ipopt import USUAL
from drake_gnnocp.trajectory import Trajectory

N_CONTROLS = 2  # a and w at the next knot
N_STAGE = N_KNOT + N_CONTROLS
SETTINGS = {"tol": 1e-3, "mu_init": 1e-4, "max_iter": USUAL.max_iterations, "print_level": 0}


def solve_with_fatrop(problem: Formulation) -> PeerSolution:
    """Build and solve; fatrop knows no limit of time, but one of iterations."""
    n, vehicle = len(problem.reference), problem.vehicle
    numbers = ca.MX.sym("numbers", N_STAGE * n - N_CONTROLS)
    stages = ca.reshape(ca.vertcat(numbers, ca.MX.zeros(N_CONTROLS)), N_STAGE, n)
    knots, controls = stages[:N_KNOT, :], stages[N_KNOT:, :-1]
    gaps = knots[:, 1:] - next_knot(vehicle.wheelbase, problem.step).map(n - 1)(knots[:, :-1], controls)
    ends = ca.horzcat(knots[:, 0] - _at_rest(problem.start), knots[:, -1] - _at_rest(problem.goal))
    all_rows = pair_rows(problem)
    areas = [area_rows(knots, rows) for rows in all_rows]
    g = ca.vertcat(ca.vec(gaps), ca.vec(ends), *areas)

    # the order that fatrop wants: of every stage the gap to the next, then its own constraints
    n_equal = N_KNOT * (n + 1)
    knot = np.concatenate([np.repeat(np.append(np.arange(n - 1), [0, n - 1]), N_KNOT), *(r.knot for r in all_rows)])
    is_gap = np.arange(len(knot)) < N_KNOT * (n - 1)
    order = np.lexsort((np.arange(len(knot)), ~is_gap, knot))
    lower = np.concatenate([np.zeros(n_equal), *(least_areas(rows) for rows in all_rows)])[order]
    is_equal = (np.arange(len(knot)) < n_equal)[order]
    most = np.full((n, N_STAGE), math.inf)
    most[1:-1, 3:N_KNOT] = vehicle.v_max, vehicle.phi_max, vehicle.a_max, vehicle.w_max  # the ends are fixed
    bounds = most.ravel()[:-N_CONTROLS]
    options = {
        "structure_detection": "manual",
        "N": n - 1,
        "nx": [N_KNOT] * n,
        "nu": [N_CONTROLS] * (n - 1) + [0],
        "ng": np.bincount(knot[~is_gap], minlength=n).tolist(),
        "equality": is_equal.tolist(),
        "print_time": False,
        "error_on_fail": False,
        "fatrop": SETTINGS,
    }
    program = {"x": numbers, "f": cost_of(knots, problem), "g": g[order.tolist()]}
    solver = ca.nlpsol("peer", "fatrop", program, options)
    guess = np.column_stack([problem.knots, np.roll(problem.knots[:, N_STATES:], -1, axis=0)]).ravel()[:-N_CONTROLS]
    begin = time.perf_counter()
    upper = np.where(is_equal, 0.0, math.inf)
    result = solver(x0=guess, lbx=-bounds, ubx=bounds, lbg=lower, ubg=upper)
    seconds = time.perf_counter() - begin
    stats = solver.stats()
    found = np.append(np.array(result["x"]).ravel(), np.zeros(N_CONTROLS)).reshape(n, N_STAGE)
    trajectory = Trajectory(problem.reference.t, found[:, :N_STATES], found[:, N_STATES:N_KNOT])
    status = "Solved" if stats["success"] else f"return flag {stats['return_status']}"
    return PeerSolution(trajectory, bool(stats["success"]), status, int(stats["iter_count"]), len(knot), seconds)


def next_knot(wheelbase: float, h: float) -> ca.Function:
    """The next knot (7,) of a knot (7,) and the inputs (2,) there, so that the defects of Hermite-Simpson vanish."""
    knot, control = ca.SX.sym("knot", N_KNOT), ca.SX.sym("control", N_CONTROLS)
    x, y, theta, v, phi, a, w = ca.vertsplit(knot)
    a_next, w_next = ca.vertsplit(control)
    v_next, phi_next = v + h / 2 * (a + a_next), phi + h / 2 * (w + w_next)
    v_middle = (v + v_next) / 2 + h / 8 * (a - a_next)
    phi_middle = (phi + phi_next) / 2 + h / 8 * (w - w_next)
    turn, turn_middle, turn_next = (
        speed * ca.tan(angle) / wheelbase for speed, angle in ((v, phi), (v_middle, phi_middle), (v_next, phi_next))
    )
    theta_next = theta + h / 6 * (turn + 4 * turn_middle + turn_next)
    theta_middle = (theta + theta_next) / 2 + h / 8 * (turn - turn_next)
    speeds, headings = (v, 4 * v_middle, v_next), (theta, theta_middle, theta_next)
    x_next = x + h / 6 * sum(speed * ca.cos(heading) for speed, heading in zip(speeds, headings, strict=True))
    y_next = y + h / 6 * sum(speed * ca.sin(heading) for speed, heading in zip(speeds, headings, strict=True))
    following = ca.vertcat(x_next, y_next, theta_next, v_next, phi_next, a_next, w_next)
    return ca.Function("next_knot", [knot, control], [following])


def _at_rest(state: np.ndarray) -> np.ndarray:
    """The knot (7,) of a state (5,) without inputs."""
    return np.append(state, np.zeros(N_CONTROLS))
