r"""The peer: our problem, before any refinement, in CasADi, with exact Hessians, solved by Ipopt with MUMPS.

Variables are the knots in SI units, 7 each; h is fixed. The data are those of `drake_gnnocp.ocp.formulation`, around
the same guess; the constraints are written here once more:

    x_{k+1} - x_k - h / 6 (f_k + 4 f(x_m, u_m) + f_{k+1}) = 0      Hermite-Simpson, all five states
    sum_i S(P, A_i, A_{i+1}) >= S + margin * length                  triangle areas, walls around the bounds included
    |v|, |phi|, |a|, |w| within limits, both ends fixed

As with us, the points P of a knot and an obstacle near it are the two corners of the car nearest to the obstacle, and
the two vertices of the obstacle nearest to the car.

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

import casadi as ca
import numpy as np
import shapely

from drake_gnnocp.ocp.formulation import END_SHARE, Formulation
from drake_gnnocp.ocp.ipopt import USUAL
from drake_gnnocp.trajectory import Trajectory

N_STATES, N_KNOT = 5, 7  # x, y, theta, v, phi; and a, w
POINTS_PER_PAIR = 2  # as ours; with all corners and vertices the peer took 1.5 times as long
TOUCHING = 1e-3  # m, points nearer than this say nothing of the length their row is divided by
SHORTEST = 0.05  # m, least that a row is divided by
FAR = 1e6  # m
HUGE = 1e20
PLAIN = {"linear_solver": "mumps", "max_iter": USUAL.max_iterations}
TUNED = PLAIN | {
    "mu_strategy": "adaptive",
    "adaptive_mu_globalization": "kkt-error",
    "acceptable_tol": HUGE,
    "acceptable_dual_inf_tol": HUGE,
    # the rule to stop by progress is ours, number for number
    "acceptable_constr_viol_tol": USUAL.feasibility,
    "acceptable_compl_inf_tol": USUAL.complementarity,
    "acceptable_obj_change_tol": USUAL.objective_change,
    "acceptable_iter": USUAL.settled_iterations,
}


@dataclass(frozen=True)
class PairRows:
    """Rows of one convex polygon: sum_i S(point, A_i, A_{i+1}) >= S + margin * length."""

    ring: np.ndarray  # (M, 2) convex; the obstacle in the world, or the car in its own frame [m]
    of_car: bool  # whether the points are corners of the car (else: vertices of an obstacle, seen from the car)
    knot: np.ndarray  # (R,) knot of the row
    point: np.ndarray  # (R, 2) corner in the frame of the car, or vertex in the world [m]
    length: np.ndarray  # (R,) what makes the excess over S the distance of the point at the guess [m]
    margin: np.ndarray  # (R,) [m]

    @property
    def divisor(self) -> np.ndarray:
        """What both sides of the rows are divided by: (R,) [m]."""
        return np.maximum(self.length, SHORTEST)


@dataclass(frozen=True)
class Nlp:
    """minimise f(x) subject to g_low <= g(x) <= g_high, x_low <= x <= x_high."""

    x: ca.MX  # (7 N,) knot by knot
    f: ca.MX
    g: ca.MX
    x_low: np.ndarray
    x_high: np.ndarray
    g_low: np.ndarray
    g_high: np.ndarray


@dataclass(frozen=True)
class PeerSolution:
    """What CasADi returned."""

    trajectory: Trajectory
    success: bool
    status: str
    iterations: int
    rows: int  # scalar constraints, bounds on variables aside
    solve_seconds: float  # s


def solve_with_casadi(problem: Formulation, expand: bool, max_seconds: float, tuned: bool = True) -> PeerSolution:
    """Build and solve, with Ipopt as it is best for the peer or (not `tuned`) with its default options.

    The limit [s] is of the solve; the build, which CasADi cannot interrupt, comes on top.
    """
    nlp = nonlinear_program(problem)
    ipopt = {**(TUNED if tuned else PLAIN), "max_wall_time": max_seconds, "print_level": 0, "sb": "yes"}
    options = {"expand": expand, "calc_lam_p": False, "print_time": False, "error_on_fail": False, "ipopt": ipopt}
    solver = ca.nlpsol("peer", "ipopt", {"x": nlp.x, "f": nlp.f, "g": nlp.g}, options)
    begin = time.perf_counter()
    result = solver(x0=problem.knots.ravel(), lbx=nlp.x_low, ubx=nlp.x_high, lbg=nlp.g_low, ubg=nlp.g_high)
    end = time.perf_counter()
    stats, knots = solver.stats(), np.array(result["x"]).reshape(-1, N_KNOT)
    trajectory = Trajectory(problem.reference.t, knots[:, :N_STATES], knots[:, N_STATES:])
    said = (bool(stats["success"]), stats["return_status"], stats["iter_count"])
    return PeerSolution(trajectory, *said, nlp.g.numel(), end - begin)


def nonlinear_program(problem: Formulation) -> Nlp:
    """The nonlinear program as an expression graph."""
    n, vehicle = len(problem.reference), problem.vehicle
    knots = ca.MX.sym("knots", N_KNOT, n)
    constraints: list[tuple[ca.MX, np.ndarray | float, float]]  # g, least, most
    defects = _defects(vehicle.wheelbase, problem.step).map(n - 1)(knots[:, :-1], knots[:, 1:])
    constraints = [(ca.vec(defects), 0.0, 0.0)]
    for rows in pair_rows(problem):
        constraints.append((area_rows(knots, rows), least_areas(rows), math.inf))
    lower = np.concatenate([np.broadcast_to(low, g.numel()) for g, low, _ in constraints])
    upper = np.concatenate([np.broadcast_to(high, g.numel()) for g, _, high in constraints])
    x_high = np.full((n, N_KNOT), math.inf)
    x_high[:, 3:] = vehicle.v_max, vehicle.phi_max, vehicle.a_max, vehicle.w_max
    x_low = -x_high
    for k, state in ((0, problem.start), (-1, problem.goal)):
        x_low[k] = x_high[k] = np.append(state, [0.0, 0.0])
    g = ca.vertcat(*(g for g, _, _ in constraints))
    return Nlp(ca.vec(knots), cost_of(knots, problem), g, x_low.ravel(), x_high.ravel(), lower, upper)


# ---------------------------------------------------------------------------------------------------- rows in numbers


def pair_rows(problem: Formulation) -> list[PairRows]:
    """The rows near the guess: corners of the car against each obstacle, vertices of all obstacles against the car."""
    obstacles, vehicle, reference = problem.obstacles, problem.vehicle, problem.reference
    pairs = obstacles.pairs_within(vehicle.footprints(reference.poses), reference.t, problem.rows_within)
    margin = np.minimum(problem.margins, END_SHARE * problem.end_clearances.min(initial=math.inf))[pairs.obstacle]
    poses = reference.poses[pairs.knot]
    seen = vehicle.footprints(poses)
    points = np.broadcast_to(vehicle.corners, seen.shape)
    groups = [(obstacles.ring(j), True, pairs.obstacle == j, points, seen) for j in np.unique(pairs.obstacle)]
    cos, sin = np.cos(poses[:, 2:]), np.sin(poses[:, 2:])
    x, y = np.moveaxis(pairs.rings - poses[:, None, :2], -1, 0)
    seen = np.stack([cos * x + sin * y, cos * y - sin * x], axis=-1)
    seen[~pairs.is_vertex] = FAR  # padding
    groups.append((vehicle.corners, False, np.full(len(pairs), True), pairs.rings, seen))
    found = []
    for ring, of_car, of, points, seen in groups:
        k, which, length = _nearest(ring, seen[of], problem.rows_within)
        found.append(PairRows(ring, of_car, pairs.knot[of][k], points[of][k, which], length, margin[of][k]))
    return [rows for rows in found if len(rows.knot)]  # CasADi maps nothing over no knots


def _nearest(ring: np.ndarray, seen: np.ndarray, within: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which k and i of the points (K, I, 2), as seen from a ring's frame, are nearest to it, and their lengths [m]."""
    distance = shapely.distance(shapely.Polygon(ring), shapely.points(seen))
    to_first, to_second = (vertices - seen[..., None, :] for vertices in (ring, np.roll(ring, -1, axis=0)))
    cross = to_first[..., 0] * to_second[..., 1] - to_first[..., 1] * to_second[..., 0]
    length = np.full_like(distance, np.linalg.norm(np.ptp(ring, axis=0)) / 2)
    np.divide(np.abs(cross).sum(axis=-1) / 2 - _area(ring), distance, out=length, where=distance > TOUCHING)
    rank = np.argsort(np.argsort(distance, axis=1), axis=1)
    k, which = np.nonzero((rank < POINTS_PER_PAIR) & (distance < within))
    return k, which, length[k, which]


def least_areas(rows: PairRows) -> np.ndarray:
    """What `area_rows` must not be below: (R,)."""
    return (_area(rows.ring) + rows.margin * rows.length) / rows.divisor


def _area(ring: np.ndarray) -> float:
    return float(shapely.Polygon(ring).area)


# ------------------------------------------------------------------------------------------------------ rows as graphs


def _rates(state: ca.SX, control: ca.SX, wheelbase: float) -> ca.SX:
    theta, v, phi = state[2], state[3], state[4]
    return ca.vertcat(v * ca.cos(theta), v * ca.sin(theta), v * ca.tan(phi) / wheelbase, control)


def _defects(wheelbase: float, h: float) -> ca.Function:
    """(5,) of one interval from its left and its right knot."""
    left, right = ca.SX.sym("left", N_KNOT), ca.SX.sym("right", N_KNOT)
    (x0, u0), (x1, u1) = ca.vertsplit(left, [0, N_STATES, N_KNOT]), ca.vertsplit(right, [0, N_STATES, N_KNOT])
    f0, f1 = _rates(x0, u0, wheelbase), _rates(x1, u1, wheelbase)
    fm = _rates((x0 + x1) / 2 + h / 8 * (f0 - f1), (u0 + u1) / 2, wheelbase)
    return ca.Function("defects", [left, right], [x1 - x0 - h / 6 * (f0 + 4 * fm + f1)])


def area_rows(knots: ca.MX, rows: PairRows) -> ca.MX:
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
    return one_row.map(len(rows.knot))(knots[:3, rows.knot.tolist()], rows.point.T, (1 / rows.divisor)[None]).T


def cost_of(knots: ca.MX, problem: Formulation) -> ca.MX:
    """lambda1 J1 + lambda2 J2, summed over the knots times h."""
    knot, near = ca.SX.sym("knot", N_KNOT), problem.proximity
    cost = problem.weights.lambda1 * ca.sumsqr(knot[N_STATES:])
    for along in near.along:
        on_car = knot[:2] + along * ca.vertcat(ca.cos(knot[2]), ca.sin(knot[2]))
        for point, share in zip(near.points, near.shares, strict=True):
            cost += near.weight * share * ca.exp(-near.decay * ca.sumsqr(on_car - point))
    at_knot = ca.Function("cost", [knot], [cost])
    return problem.step * ca.sum2(at_knot.map(knots.shape[1])(knots))
