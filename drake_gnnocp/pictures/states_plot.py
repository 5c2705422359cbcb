"""States and inputs of a plan over time, with the limits of the vehicle."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from drake_gnnocp.pictures import style
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import Input, State, Vehicle

PANELS: tuple[tuple[State | Input, str, str | None], ...] = (  # what, its label, the vehicle's limit of its size
    (State.V, "speed\nv [m/s]", "v_max"),
    (State.PHI, "steering\nφ [rad]", "phi_max"),
    (Input.A, "acceleration\na [m/s²]", "a_max"),
    (Input.W, "steering rate\nw [rad/s]", "w_max"),
    (State.THETA, "heading\nθ [rad]", None),
)
HEADROOM = 0.15  # of the limit, how much of the forbidden side is shown
FIGURE_SIZE = (7.2, 8.6)  # inch
PLAN_LINE: dict[str, Any] = {"color": style.PLAN, "linewidth": 1.6, "label": "optimised", "zorder": 3.0}
GUESS_LINE: dict[str, Any] = style.GUESS_LINE | {"label": "initial guess", "zorder": 2.5}


def draw_states(
    axes: Sequence[Axes], trajectory: Trajectory | None, vehicle: Vehicle, guess: Trajectory | None = None
) -> Sequence[Axes]:
    """Draw v, phi, a, w and theta over time, one axes each, top to bottom.

    Dotted lines are the vehicle's limits; what is beyond them is shaded. The guess is dashed.

    Args:
        axes: five axes.
        trajectory: the optimised plan, None where nothing was found.
        vehicle: whose limits are drawn.
        guess: what the solver started from.

    Returns:
        axes
    """
    shown = [(curve, look) for curve, look in ((guess, GUESS_LINE), (trajectory, PLAN_LINE)) if curve is not None]
    for ax, (quantity, label, limit) in zip(axes, PANELS, strict=True):
        style.dress(ax)
        for curve, look in shown:
            ax.plot(curve.t, curve.column(quantity), **look)
        if limit is not None:
            _draw_limits(ax, getattr(vehicle, limit), [curve.column(quantity) for curve, _ in shown])
        ax.set_ylabel(label, fontsize=style.LABEL_SIZE)
        ax.margins(x=0.01)
    axes[-1].set_xlabel("time t [s]", fontsize=style.LABEL_SIZE)
    axes[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.01), borderaxespad=0.0, ncols=3, frameon=False, fontsize=9)
    return axes


def states_figure(
    trajectory: Trajectory | None, vehicle: Vehicle, guess: Trajectory | None = None, title: str | None = None
) -> Figure:
    """The states of a plan over time as a figure of its own, for a notebook or a file."""
    figure = style.new_figure(*FIGURE_SIZE)
    axes = list(figure.subplots(len(PANELS), 1, sharex=True, gridspec_kw={"hspace": 0.1}))
    draw_states(axes, trajectory, vehicle, guess)
    figure.align_ylabels(axes)
    if title:
        axes[0].set_title(title, fontsize=style.TITLE_SIZE, pad=22, parse_math=False)  # points: above the legend
    return figure


def save_states_picture(
    path: Path | str, trajectory: Trajectory | None, vehicle: Vehicle, guess: Trajectory | None, title: str | None
) -> None:
    """Write the states of a plan over time as a picture (PNG, or what the suffix says)."""
    style.save_figure(states_figure(trajectory, vehicle, guess, title), path)


def _draw_limits(ax: Axes, limit: float, curves: list[np.ndarray]) -> None:
    """Lines at +-limit and shade beyond; a curve that violates them stays inside the picture."""
    largest = max((float(np.nanmax(np.abs(curve))) for curve in curves), default=0.0)
    top = (1 + HEADROOM) * max(limit, largest if np.isfinite(largest) else 0.0)
    for sign in (-1, 1):
        label = "limit" if sign > 0 else None
        ax.axhline(sign * limit, color=style.LIMIT, linewidth=0.9, linestyle=":", label=label, zorder=2)
        ax.axhspan(*sorted((sign * limit, sign * top)), color=style.LIMIT, alpha=0.07, linewidth=0, zorder=1)
    ax.set_ylim(-top, top)
