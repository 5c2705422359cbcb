"""Guess against optimum: the states of one plan, the disparity of three sources, and the error along the trajectory."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from drake_gnnocp.experiments.benchmark.disparity import N_COMPARED, disparity
from drake_gnnocp.experiments.figures.maps import EXAMPLE, MAPS
from drake_gnnocp.experiments.figures.plans import SOURCES, Plans, Skipped, Solved
from drake_gnnocp.experiments.figures.sheet import GUESS_LINE, PLAN_LINE, SMALL, curves, draw_path, page, share_legend
from drake_gnnocp.pictures import style
from drake_gnnocp.scenario import bundled_scenarios
from drake_gnnocp.vehicle import State

logger = logging.getLogger(__name__)

STATES = (
    (State.THETA, "(b) heading", "θ [rad]", None),
    (State.V, "(c) speed", "v [m/s]", "v_max"),
    (State.PHI, "(d) steering angle", "φ [rad]", "phi_max"),
)
EVEN = 0.05  # of a limit: curves above the negative of that count as positive, and get no lower limit
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
SHARES = np.linspace(0.0, 1.0, N_COMPARED)  # of the duration
JOINED = 4  # every how many points are joined
BAND = (5.0, 95.0)  # percentiles


def states_figure(plans: Plans) -> Figure:
    """Path, heading, speed and steering of guess and optimum on map_a."""
    solved = plans.solved(EXAMPLE)
    figure, axes = page(5.0, 2, 2)
    curves(axes[0], f"(a) path, {solved.title}", "x [m]", "y [m]").set_aspect("equal", adjustable="datalim")
    draw_path(axes[0], solved.optimum, **PLAN_LINE)
    draw_path(axes[0], solved.guess, **GUESS_LINE)
    for ax, (state, title, label, limit) in zip(axes[1:], STATES, strict=True):
        curves(ax, title, "t [s]", label)
        ax.plot(solved.optimum.t, solved.optimum.column(state), **PLAN_LINE)
        ax.plot(solved.guess.t, solved.guess.column(state), **GUESS_LINE)
        if limit is not None:
            highest = getattr(solved.scenario.vehicle, limit)
            for at in (highest, -highest) if ax.dataLim.y0 < -EVEN * highest else (highest,):
                ax.axhline(at, color=style.LIMIT, linewidth=0.9, linestyle=":", label="limit", zorder=2)
    share_legend(figure, axes, 3)
    return figure


def disparity_figure(plans: Plans) -> Figure:
    """Cumulated difference of guess and optimum, for three sources of guesses."""
    plans.check("gnn")  # without the network there is nothing to compare
    solved = _solved_maps(plans)
    figure, axes = page(4.4, 2, 2)
    for ax, (field, title) in zip(axes, PANELS.items(), strict=True):
        curves(ax, title, "", f"sum over {N_COMPARED} points")
        draw_bars(ax, solved, field)
    if any(plan is not None and not plan.verified for plan in solved.values()):
        axes[0].plot([], [], " ", label=f"{UNVERIFIED} plan not verified")
    share_legend(figure, axes, 4)
    return figure


def _solved_maps(plans: Plans) -> dict[tuple[str, str], Solved | None]:
    """Plans of the test maps by source and map; the log says what is missing or not verified."""
    solved: dict[tuple[str, str], Solved | None] = {}
    for source, title in SOURCES.items():
        try:
            plans.check(source)
        except Skipped as reason:
            logger.warning("disparity: without %s: %s", title, reason)
            continue
        for name in MAPS:
            solved[source, name] = found = plans.solved_or_none(name, source)
            if found is None or not found.verified:
                status = "not solved" if found is None else found.status
                logger.warning("disparity: the plan of %s from %s is %s", name, title, status)
    return solved


def draw_bars(ax: Axes, solved: dict[tuple[str, str], Solved | None], field: str) -> Axes:
    """Bars of a disparity by source and map, side by side for every map; a cross where there is no plan.

    Args:
        ax: axes to draw on.
        solved: plans by source and map, None where nothing was solved.
        field: of `Disparity`.
    """
    sources, maps = (list(dict.fromkeys(key[i] for key in solved)) for i in (0, 1))
    width = 0.8 / len(sources)
    for i, source in enumerate(sources):
        color, hatch = BARS[source]
        look: dict[str, Any] = {"color": color, "hatch": hatch, "edgecolor": "white", "label": SOURCES[source]}
        x = np.arange(len(maps)) + (i - (len(sources) - 1) / 2) * width
        plans = [solved[source, name] for name in maps]
        heights = [0.0 if plan is None else getattr(disparity(plan.guess, plan.optimum), field) for plan in plans]
        ax.bar(x, heights, width, **look)
        for at, height, plan in zip(x, heights, plans, strict=True):
            text = MISSING if plan is None else f"{height:.0f}" + ("" if plan.verified else UNVERIFIED)
            ax.annotate(text, (at, height), (0, 1.5), textcoords="offset points", fontsize=SMALL, ha="center")
    ax.set_xticks(range(len(maps)), maps)
    ax.grid(False, axis="x")
    ax.margins(y=0.12)
    return ax


def error_along_figure(plans: Plans) -> Figure:
    """Distance of prediction and optimum along the trajectory."""
    example = plans.solved(EXAMPLE)
    solved = _all_verified(plans)
    figure, axes = page(2.9, 1, 2, width_ratios=[1, 1.5])
    draw_joined(curves(axes[0], f"(a) {example.title}", "x [m]", "y [m]"), example)
    curves(axes[1], "(b) distance of prediction and optimum", "share of the duration", "distance [m]")
    draw_errors(axes[1], example, solved)
    share_legend(figure, axes, 5)
    return figure


def _all_verified(plans: Plans) -> list[Solved]:
    """The verified plans of all bundled scenarios; the others have no optimum to compare with."""
    names = bundled_scenarios()
    found = [plans.solved_or_none(name) for name in names]
    solved = [plan for plan in found if plan is not None and plan.verified]
    if len(solved) < len(names):
        logger.warning("error_along: without %d of %d scenarios: not verified", len(names) - len(solved), len(names))
    return solved


def draw_joined(ax: Axes, solved: Solved) -> Axes:
    """Both paths, and lines between their knots of the same time."""
    draw_path(ax, solved.optimum, **PLAN_LINE)
    draw_path(ax, solved.guess, **GUESS_LINE)
    x, y = (np.stack([t.column(state)[::JOINED] for t in solved.compared]) for state in (State.X, State.Y))
    ax.plot(x, y, color=style.FRAME, linewidth=0.7, zorder=3)
    ax.set_aspect("equal", adjustable="datalim")
    return ax


def draw_errors(ax: Axes, example: Solved, solved: list[Solved]) -> Axes:
    """The distance along one trajectory, and its median and band over many."""
    if solved:
        errors = np.stack([distances(plan) for plan in solved])
        low, high = np.percentile(errors, BAND, axis=0)
        band = f"{BAND[0]:.0f} to {BAND[1]:.0f} %"
        ax.fill_between(SHARES, low, high, color=style.SWEPT, alpha=0.3, linewidth=0, label=band)
        label = f"median of {len(solved)} of {len(bundled_scenarios())} scenarios"
        ax.plot(SHARES, np.median(errors, axis=0), color=style.LIMIT, linewidth=1.3, label=label)
    look = GUESS_LINE | {"label": example.scenario.name, "linestyle": "-."}
    ax.plot(SHARES, distances(example), **look)
    ax.set_ylim(bottom=0.0)
    ax.margins(x=0.01)
    return ax


def distances(solved: Solved) -> np.ndarray:
    """Distance of guess and optimum at N_COMPARED equal steps of their durations: (N_COMPARED,) [m]."""
    guess, optimum = solved.compared
    return np.linalg.norm(guess.poses[:, : State.THETA] - optimum.poses[:, : State.THETA], axis=1)
