r"""From predicted points to knots: joined by lines, as in the paper, and by the clamped cubic spline.

Of lines, the path turns at the points only, and the acceleration jumps there. The turn of a path at a knot is
the angle between the steps before and after it, over their mean length.
"""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from drake_gnnocp.experiments.figures.maps import EXAMPLE
from drake_gnnocp.experiments.figures.plans import Plans, Skipped
from drake_gnnocp.experiments.figures.sheet import curves, draw_path, page, share_legend
from drake_gnnocp.pictures import style
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import State

logger = logging.getLogger(__name__)

ZOOM = 4.0  # m, side of the part that is enlarged
SHORTEST = 0.1  # m, steps below have no direction to speak of
CUSP = np.pi / 2  # rad, a path that turns more at once has changed its gear
LINES: dict[str, Any] = {"color": style.START, "linewidth": 1.1, "linestyle": "--", "label": "lines", "zorder": 4}
SPLINE: dict[str, Any] = {"color": style.GUESS, "linewidth": 1.4, "label": "clamped spline", "zorder": 3}
POINTS: dict[str, Any] = {"color": style.LIMIT, "marker": "o", "linestyle": "none", "markersize": 3.2, "zorder": 6}
DENSE: dict[str, Any] = {"color": style.PLAN, "linewidth": 0.9, "linestyle": ":", "zorder": 5}


def interpolation_figure(plans: Plans) -> Figure:
    """Predicted points joined by lines and by the clamped spline."""
    solved = plans.solved(EXAMPLE)
    points, spline = plans.points(solved), solved.guess
    lines = points.resampled(len(spline))
    shown = [(lines, LINES), (spline, SPLINE)]
    try:
        dense = plans.dense_points(solved.scenario)
        shown.append((dense, DENSE | {"label": f"{len(dense)} predicted points"}))
    except Skipped as reason:
        logger.warning("interpolation: without a curve: %s", reason)
    figure, axes = page(5.2, 2, 2)
    for ax, title in zip(axes, (f"(a) path, {EXAMPLE}", "(b) the frame of (a)"), strict=False):
        curves(ax, title, "x [m]", "y [m]")
        for trajectory, look in shown:
            draw_path(ax, trajectory, **look)
        draw_path(ax, points, **POINTS | {"label": f"{len(points)} predicted points"})
        ax.set_aspect("equal", adjustable="datalim")
    _zoom(axes, spline, lines)
    curves(axes[2], "(c) turn of the path", "t [s]", "[rad/m]")
    curves(axes[3], "(d) acceleration of the interpolated speed", "t [s]", "[m/s²]")
    for trajectory, look in shown:
        axes[2].plot(trajectory.t, turns(trajectory), **look)
        axes[3].plot(trajectory.t, np.gradient(trajectory.column(State.V), trajectory.t), **look)
    share_legend(figure, axes, 4)
    return figure


def turns(trajectory: Trajectory) -> np.ndarray:
    """Turn of a path at its knots (N,) [rad/m]; not a number at the ends, where it stands, and at cusps."""
    steps = np.diff(trajectory.poses[:, :2], axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    turn = np.diff(np.arctan2(steps[:, 1], steps[:, 0]))
    turn = (turn + np.pi) % (2 * np.pi) - np.pi
    mean = (lengths[:-1] + lengths[1:]) / 2
    known = (np.minimum(lengths[:-1], lengths[1:]) > SHORTEST) & (np.abs(turn) < CUSP)
    return np.pad(np.where(known, turn, np.nan) / mean, 1, constant_values=np.nan)


def _zoom(axes: list[Axes], spline: Trajectory, lines: Trajectory) -> None:
    """Enlarge, in the second axes, the part where lines and spline differ most."""
    away = np.linalg.norm(spline.poses[:, :2] - lines.poses[:, :2], axis=1)
    x, y = spline.poses[int(np.argmax(away)), :2]
    left, low = x - ZOOM / 2, y - ZOOM / 2
    axes[1].set_aspect("equal", adjustable="box")
    axes[1].set(xlim=(left, left + ZOOM), ylim=(low, low + ZOOM))
    axes[0].add_patch(Rectangle((left, low), ZOOM, ZOOM, fill=False, ec=style.FRAME, lw=0.9, zorder=7))
