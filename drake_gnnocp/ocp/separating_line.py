r"""Swept separating lines: collision constraints that hold between the knots as well.

For an interval and a convex obstacle, a line with the normal n = (cos alpha, sin alpha) and offset beta has the four
corners of the car at both knots on one side and the obstacle on the other:

    n . p_i - beta >= gap   (8 corners),        beta - n . q_m >= 0   (vertices of the obstacle)

alpha and beta are two more decision variables. A convex set that separates both footprints separates their convex hull,
which holds the footprints in between but for the bulge of a turning corner, r dtheta^2 / 8: the gap covers it. Where
the guess overlaps the obstacle the rows still have a gradient, along the shortest way out, which triangle areas lack.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydrake.solvers import MathematicalProgram

from drake_gnnocp.ocp.variables import Variables, add_block
from drake_gnnocp.vehicle import Vehicle


@dataclass(frozen=True)
class Separation:
    """A pair that needs a line."""

    interval: int  # between knots interval and interval + 1
    ring: np.ndarray  # (M, 2) convex obstacle [m]
    gap: float  # m


def best_normal(points: np.ndarray, ring: np.ndarray) -> tuple[float, float, float]:
    """The direction in which the points clear the ring most, or overlap it least.

    Args:
        points: (P, 2) whose convex hull is one of the two sets [m].
        ring: (M, 2) convex, counter-clockwise [m].

    Returns:
        alpha [rad], beta [m], and the distance along the normal (negative: overlap) [m]. Candidates are the normals of
        the ring's edges, of the edges between points, and the directions between points and vertices.
    """
    edges = np.roll(ring, -1, axis=0) - ring
    chords = (points[:, None] - points[None]).reshape(-1, 2)
    between = (points[:, None] - ring[None]).reshape(-1, 2)
    turned = np.concatenate([edges, chords])[:, ::-1] * [1, -1]
    normals = np.concatenate([turned, between])
    length = np.linalg.norm(normals, axis=1)
    normals = normals[length > 1e-9] / length[length > 1e-9, None]
    distance = (points @ normals.T).min(axis=0) - (ring @ normals.T).max(axis=0)
    best = int(np.argmax(distance))
    n = normals[best]
    beta = float((ring @ n).max() + distance[best] / 2)
    return float(np.arctan2(n[1], n[0])), beta, float(distance[best])


def add_separating_line(
    program: MathematicalProgram,
    variables: Variables,
    vehicle: Vehicle,
    separation: Separation,
    poses: np.ndarray,
) -> np.ndarray:
    """Add the line of one pair, with an initial guess from the poses (2, 3) at its knots [m, m, rad].

    Returns:
        (2,) the new variables: alpha and beta, over the scale of the states.
    """
    corners, ring, gap = vehicle.corners, separation.ring, separation.gap
    scale = variables.state_scale
    alpha, beta, _ = best_normal(vehicle.footprints(poses).reshape(-1, 2), ring)
    line = program.NewContinuousVariables(2, f"line{separation.interval}_")
    program.SetInitialGuess(line, np.array([alpha, beta]) / scale)
    n_vertices = len(ring)

    def evaluate(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        values = x * scale
        poses, (alpha, beta) = values[:6].reshape(2, 3), values[6:]
        n, turned = np.array([np.cos(alpha), np.sin(alpha)]), np.array([-np.sin(alpha), np.cos(alpha)])
        offsets = vehicle.footprints(poses) - poses[:, None, :2]  # (2, 4, 2) corners from the rear axle
        corner_value = (offsets + poses[:, None, :2]) @ n - beta
        d_theta = offsets[..., 0] * n[1] - offsets[..., 1] * n[0]
        d_alpha = (offsets + poses[:, None, :2]) @ turned
        ones = np.ones((2, 4))
        corner_entries = np.stack([n[0] * ones, n[1] * ones, d_theta, d_alpha, -ones], axis=-1)
        vertex_entries = np.column_stack([-ring @ turned, np.ones(n_vertices)])
        entries = np.concatenate([corner_entries.ravel(), vertex_entries.ravel()]) * scale
        return np.concatenate([corner_value.ravel(), beta - ring @ n]), entries

    knot = np.repeat([0, 1], len(corners))
    corner_columns = np.column_stack([3 * knot, 3 * knot + 1, 3 * knot + 2, np.full(8, 6), np.full(8, 7)])
    rows = np.concatenate([np.repeat(np.arange(8), 5), 8 + np.repeat(np.arange(n_vertices), 2)])
    columns = np.concatenate([corner_columns.ravel(), np.tile([6, 7], n_vertices)])
    lower = np.concatenate([np.full(8, gap), np.zeros(n_vertices)])
    k = separation.interval
    block = np.concatenate([variables.knots[k : k + 2, :3].ravel(), line])
    add_block(
        program, evaluate, lower, np.full(len(lower), np.inf), block, rows, columns, f"separating line of interval {k}"
    )
    return line
