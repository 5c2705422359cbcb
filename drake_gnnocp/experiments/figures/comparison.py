"""Guess against optimum: the states of one plan, and how far the guesses of three sources are from their optima."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from drake_gnnocp.experiments.benchmark.disparity import N_COMPARED, disparity
from drake_gnnocp.experiments.figures.maps import EXAMPLE, MAPS
from drake_gnnocp.experiments.figures.plans import SOURCES, Plans, Skipped, Solved
from drake_gnnocp.experiments.figures.sheet import (
    GUESS_LINE,
    PAGE,
    PLAN_LINE,
    SMALL,
    curves,
    draw_path,
    new_sheet,
    share_legend,
)
from drake_gnnocp.pictures import style
from drake_gnnocp.vehicle import State

logger = logging.getLogger(__name__)

STATES = (
    (State.THETA, "(b) heading", "θ [rad]", None),
    (State.V, "(c) speed", "v [m/s]", "v_max"),
    (State.PHI, "(d) steering angle", "φ [rad]", "phi_max"),
)
EVEN = 0.05  # of the limit, curves above the negative of which count as positive
PANELS = {  # titles of the fields of `Disparity`
    "position": "(a) position [m]",
    "theta": "(b) heading [rad]",
    "v": "(c) speed [m/s]",
    "phi": "(d) steering angle [rad]",
}
MISSING, UNVERIFIED = "x", "*"  # what is written above bars
BARS = {  # colour and hatch of every source
    "hybrid_astar": (style.SWEPT, "////"),
    "rrt_star": (style.OBSTACLE, "...."),
    "gnn": (style.GUESS, ""),
}


def states_figure(plans: Plans) -> Figure:
    """Path, heading, speed and steering of the network's guess and of the optimum."""
    solved = plans.solved(EXAMPLE)
    figure = new_sheet(PAGE, 5.0)
    axes = list(figure.subplots(2, 2).flat)
    curves(axes[0], f"(a) path, {solved.title}", "x [m]", "y [m]")
    draw_path(axes[0], solved.optimum, **PLAN_LINE)
    draw_path(axes[0], solved.guess, **GUESS_LINE)
    axes[0].set_aspect("equal", adjustable="datalim")
    for ax, (which, title, label, limit) in zip(axes[1:], STATES, strict=True):
        curves(ax, title, "t [s]", label)
        draw_state(ax, solved, which)
        if limit is not None:
            draw_limit(ax, getattr(solved.scenario.vehicle, limit))
    share_legend(figure, axes, 3)
    return figure


def draw_state(ax: Axes, solved: Solved, which: State) -> Axes:
    """One state over time, of the optimum and of the guess."""
    for trajectory, look in ((solved.optimum, PLAN_LINE), (solved.guess, GUESS_LINE)):
        ax.plot(trajectory.t, trajectory.column(which), **look)
    return ax


def draw_limit(ax: Axes, limit: float) -> Axes:
    """Lines at limit and, where the curves are negative as well, at -limit."""
    for at in (limit, -limit) if ax.dataLim.y0 < -EVEN * limit else (limit,):
        ax.axhline(at, color=style.LIMIT, linewidth=0.9, linestyle=":", label="limit", zorder=2)
    return ax


def disparity_figure(plans: Plans) -> Figure:
    """Differences of guess and optimum, summed over the knots, on the test maps."""
    plans.check("gnn")  # without the network there is nothing to compare
    solved = {(source, name): _solved_or_none(plans, name, source) for source in _available(plans) for name in MAPS}
    figure = new_sheet(PAGE, 4.4)
    axes = list(figure.subplots(2, 2).flat)
    for ax, (which, title) in zip(axes, PANELS.items(), strict=True):
        curves(ax, title, "", f"sum over {N_COMPARED} points")
        draw_bars(ax, solved, which)
    if any(each is not None and not each.verified for each in solved.values()):
        axes[0].plot([], [], " ", label=f"{UNVERIFIED} plan not verified")
    share_legend(figure, axes, 4)
    return figure


def _available(plans: Plans) -> list[str]:
    """The sources of guesses that can be had, with a line in the log for each that cannot."""
    found = []
    for source in SOURCES:
        try:
            plans.check(source)
            found.append(source)
        except Skipped as reason:
            logger.warning("disparity: without %s: %s", SOURCES[source], reason)
    return found


def _solved_or_none(plans: Plans, name: str, source: str) -> Solved | None:
    try:
        solved = plans.solved(name, source)
    except Skipped as reason:
        logger.warning("disparity: %s", reason)
        return None
    if not solved.verified:
        logger.warning("disparity: the plan of %s from %s is %s", name, SOURCES[source], solved.status)
    return solved


def draw_bars(ax: Axes, solved: dict[tuple[str, str], Solved | None], which: str) -> Axes:
    """Bars of a disparity by source and map, side by side for every map; a cross where there is no plan.

    Args:
        ax: axes to draw on.
        solved: plans by source and map, None where nothing was solved.
        which: field of `Disparity`.
    """
    sources, maps = (list(dict.fromkeys(key[i] for key in solved)) for i in (0, 1))
    width = 0.8 / len(sources)
    for i, source in enumerate(sources):
        color, hatch = BARS[source]
        look: dict[str, Any] = {"color": color, "hatch": hatch, "edgecolor": "white", "label": SOURCES[source]}
        x = np.arange(len(maps)) + (i - (len(sources) - 1) / 2) * width
        plans = [solved[source, name] for name in maps]
        heights = [0.0 if each is None else getattr(disparity(each.guess, each.optimum), which) for each in plans]
        ax.bar(x, heights, width, **look)
        for at, height, each in zip(x, heights, plans, strict=True):
            text = MISSING if each is None else f"{height:.0f}" + ("" if each.verified else UNVERIFIED)
            ax.annotate(text, (at, height), (0, 1.5), textcoords="offset points", fontsize=SMALL, ha="center")
    ax.set_xticks(range(len(maps)), maps)
    ax.grid(False, axis="x")
    ax.margins(y=0.12)
    return ax
