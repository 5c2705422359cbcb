"""Bounds of the workspace: the corners of the car stay inside at every knot that comes near a side."""

from __future__ import annotations

import numpy as np
from pydrake.solvers import MathematicalProgram

from drake_gnnocp.ocp.variables import Variables, add_block
from drake_gnnocp.vehicle import Vehicle

# (axis, sign) of xmin, xmax, ymin, ymax: sign * (coordinate - bound) >= 0 inside
SIDES = ((0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0))


def add_workspace(
    program: MathematicalProgram,
    variables: Variables,
    vehicle: Vehicle,
    bounds: tuple[float, float, float, float],
    poses: np.ndarray,
    near: float,
    margin: float,
) -> None:
    """Keep all corners `margin` inside the bounds at the knots whose corners are nearer than `near` at the guess.

    Args:
        program: to add to.
        variables: its variables.
        vehicle: the car.
        bounds: xmin, xmax, ymin, ymax [m].
        poses: (N, 3) of the guess [m, m, rad].
        near: [m].
        margin: [m].
    """
    footprints = vehicle.footprints(poses)
    for (axis, sign), bound in zip(SIDES, bounds, strict=True):
        distance = (sign * (footprints[..., axis] - bound)).min(axis=1)
        distance[[0, -1]] = np.inf  # fixed
        knots = np.flatnonzero(distance < near)
        if len(knots):
            _add_side(program, variables, vehicle, knots, axis, sign, bound, margin)


def _add_side(
    program: MathematicalProgram,
    variables: Variables,
    vehicle: Vehicle,
    knots: np.ndarray,
    axis: int,
    sign: float,
    bound: float,
    margin: float,
) -> None:
    corner_x, corner_y = vehicle.corners.T
    scale = variables.state_scale

    def evaluate(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        poses = x.reshape(-1, 2) * scale  # this axis's coordinate and theta
        cos, sin = np.cos(poses[:, 1:]), np.sin(poses[:, 1:])
        offset_x, offset_y = cos * corner_x - sin * corner_y, sin * corner_x + cos * corner_y
        offset, turned = (offset_x, -offset_y) if axis == 0 else (offset_y, offset_x)
        values = sign * (poses[:, :1] + offset - bound)
        entries = sign * scale * np.stack([np.ones_like(turned), turned], axis=-1)
        return values.ravel(), entries.ravel()

    n = len(knots) * len(corner_x)
    rows = np.repeat(np.arange(n), 2)
    columns = (2 * np.repeat(np.arange(len(knots)), len(corner_x))[:, None] + np.arange(2)).ravel()
    block = variables.knots[knots][:, [axis, 2]].ravel()
    name = ("xmin", "xmax", "ymin", "ymax")[2 * axis + (sign < 0)]
    add_block(program, evaluate, np.full(n, margin), np.full(n, np.inf), block, rows, columns, f"bound {name}")
