r"""Between the predicted points: clamped cubic splines, which start and end with zero slope.

A spline through P equally spaced values y is linear in them. With u in [0, 1] from the first point to the last, the
slopes s at the points satisfy s_0 = s_{P-1} = 0 and, for d = 1 / (P - 1),

    s_{i-1} + 4 s_i + s_{i+1} = 3 (y_{i+1} - y_{i-1}) / d,

and between two points the Hermite cubic takes their values and slopes. The car rests at both ends, so all its states
have zero slopes there. Interpolated like this, points of an optimum took the solver half the iterations that linear
interpolation took.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np


@lru_cache(maxsize=16)
def spline_matrices(points: int, knots: int) -> tuple[np.ndarray, np.ndarray]:
    """Matrices (knots, points) that give a spline's values, and its derivatives with respect to u, at equal steps."""
    d = 1.0 / (points - 1)
    left, right = np.eye(points), np.zeros((points, points))
    for i in range(1, points - 1):
        left[i, [i - 1, i, i + 1]] = 1.0, 4.0, 1.0
        right[i, [i - 1, i + 1]] = -3.0 / d, 3.0 / d
    slopes = np.linalg.solve(left, right)
    u = np.linspace(0.0, 1.0, knots)
    i = np.minimum((u / d).astype(int), points - 2)
    t = (u / d - i)[:, None]
    identity = np.eye(points)
    values = (
        (1 + 2 * t) * (1 - t) ** 2 * identity[i]
        + t**2 * (3 - 2 * t) * identity[i + 1]
        + d * (t * (1 - t) ** 2 * slopes[i] - t**2 * (1 - t) * slopes[i + 1])
    )
    derivatives = (
        6 * t * (1 - t) / d * (identity[i + 1] - identity[i])
        + (1 - t) * (1 - 3 * t) * slopes[i]
        + t * (3 * t - 2) * slopes[i + 1]
    )
    return values, derivatives
