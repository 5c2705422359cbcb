r"""Swept separating lines: collision constraints that hold between the knots as well.

For an interval and a convex obstacle, a line with the normal n = (cos alpha, sin alpha) and offset beta has the four
corners of the car at both knots on one side and the obstacle on the other:

    n . p_i - beta >= clearance   (8 corners),        beta - n . q_m >= 0   (vertices of the obstacle)

alpha and beta are two more decision variables. A convex set that separates both footprints separates their convex hull,
which holds the footprints in between but for the bulge of a turning corner, r dtheta^2 / 8: the clearance covers it.
Where the reference overlaps the obstacle the rows still have a gradient, along the shortest way out, which triangle
areas lack.
"""

from __future__ import annotations

import numpy as np

from drake_gnnocp.ocp.formulation import Formulation, Line
from drake_gnnocp.ocp.obstacles import SHORTEST_EDGE
from drake_gnnocp.ocp.rows import POSE, RowBlock

CORNERS = 8  # of the car at both knots


def separating_lines(formulation: Formulation) -> list[RowBlock]:
    """The rows of all lines that the formulation asks for."""
    return [_block(formulation, line) for line in formulation.lines]


def _block(formulation: Formulation, line: Line) -> RowBlock:
    vehicle, reference = formulation.vehicle, formulation.reference
    knots = np.array([line.interval, line.interval + 1])
    ring = formulation.obstacles.ring_during(line.obstacle, reference.t[knots])
    alpha, beta, _ = best_normal(vehicle.footprints(reference.poses[knots]).reshape(-1, 2), ring)
    n_vertices = len(ring)

    def evaluate(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        poses, (alpha, beta) = x[:6].reshape(2, 3), x[6:]
        n, turned = np.array([np.cos(alpha), np.sin(alpha)]), np.array([-np.sin(alpha), np.cos(alpha)])
        offsets = vehicle.footprints(poses) - poses[:, None, :2]  # (2, 4, 2) corners from the rear axle
        corner_value = (offsets + poses[:, None, :2]) @ n - beta
        d_theta = offsets[..., 0] * n[1] - offsets[..., 1] * n[0]
        d_alpha = (offsets + poses[:, None, :2]) @ turned
        ones = np.ones((2, 4))
        corner_entries = np.stack([n[0] * ones, n[1] * ones, d_theta, d_alpha, -ones], axis=-1)
        vertex_entries = np.column_stack([-ring @ turned, np.ones(n_vertices)])
        entries = np.concatenate([corner_entries.ravel(), vertex_entries.ravel()])
        return np.concatenate([corner_value.ravel(), beta - ring @ n]), entries

    first = 3 * np.repeat([0, 1], CORNERS // 2)
    corner_columns = np.column_stack([first, first + 1, first + 2, np.full(CORNERS, 6), np.full(CORNERS, 7)])
    lower = np.concatenate([np.full(CORNERS, line.clearance), np.zeros(n_vertices)])
    return RowBlock(
        description=f"separating line of interval {line.interval}",
        function=evaluate,
        lower=lower,
        upper=np.full(len(lower), np.inf),
        rows=np.concatenate([np.repeat(np.arange(CORNERS), 5), CORNERS + np.repeat(np.arange(n_vertices), 2)]),
        columns=np.concatenate([corner_columns.ravel(), np.tile([6, 7], n_vertices)]),
        knots=knots,
        knot_columns=POSE,
        extra=np.array([alpha, beta]),
    )


def best_normal(points: np.ndarray, ring: np.ndarray) -> tuple[float, float, float]:
    """The direction in which the points clear the ring most, or overlap it least.

    Args:
        points: (P, 2) whose convex hull is one of the two sets [m].
        ring: (M, 2) convex, counter-clockwise [m].

    Returns:
        alpha [rad], beta [m], and the distance along the normal (negative: penetration) [m]. Candidates are the normals
        of the ring's edges, of the edges between points, and the directions between points and vertices.
    """
    edges = np.roll(ring, -1, axis=0) - ring
    chords = (points[:, None] - points[None]).reshape(-1, 2)
    between = (points[:, None] - ring[None]).reshape(-1, 2)
    turned = np.concatenate([edges, chords])[:, ::-1] * [1, -1]
    normals = np.concatenate([turned, between])
    length = np.linalg.norm(normals, axis=1)
    normals = normals[length > SHORTEST_EDGE] / length[length > SHORTEST_EDGE, None]
    distance = (points @ normals.T).min(axis=0) - (ring @ normals.T).max(axis=0)
    best = int(np.argmax(distance))
    n = normals[best]
    beta = float((ring @ n).max() + distance[best] / 2)
    return float(np.arctan2(n[1], n[0])), beta, float(distance[best])
