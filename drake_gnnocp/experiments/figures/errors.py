"""How the error of the prediction grows along the trajectory: on one map, and over all bundled scenarios."""

from __future__ import annotations

import logging

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from drake_gnnocp.experiments.benchmark.disparity import N_COMPARED
from drake_gnnocp.experiments.figures.maps import EXAMPLE
from drake_gnnocp.experiments.figures.plans import Plans, Skipped, Solved
from drake_gnnocp.experiments.figures.sheet import (
    GUESS_LINE,
    PAGE,
    PLAN_LINE,
    curves,
    draw_path,
    new_sheet,
    share_legend,
)
from drake_gnnocp.pictures import style
from drake_gnnocp.scenario import bundled_scenarios
from drake_gnnocp.vehicle import State

logger = logging.getLogger(__name__)

SHARES = np.linspace(0.0, 1.0, N_COMPARED)  # of the duration
JOINED = 4  # every how many points are joined
BAND = (5.0, 95.0)  # percentiles


def error_along_figure(plans: Plans) -> Figure:
    """Prediction and optimum joined knot by knot, and the distance of the knots over the duration."""
    example = plans.solved(EXAMPLE)
    solved = _all_verified(plans)
    figure = new_sheet(PAGE, 2.9)
    axes = list(figure.subplots(1, 2, width_ratios=[1, 1.5]))
    curves(axes[0], f"(a) {example.title}", "x [m]", "y [m]")
    draw_joined(axes[0], example)
    curves(axes[1], "(b) distance of prediction and optimum", "share of the duration", "distance [m]")
    draw_errors(axes[1], example, solved)
    share_legend(figure, axes, 5)
    return figure


def _all_verified(plans: Plans) -> list[Solved]:
    """The verified plans of all bundled scenarios; the others have no optimum to compare with."""
    solved, names = [], bundled_scenarios()
    for name in names:
        try:
            found = plans.solved(name)
        except Skipped:
            continue
        if found.verified:
            solved.append(found)
    if len(solved) < len(names):
        logger.warning("error_along: without %d of %d scenarios: not verified", len(names) - len(solved), len(names))
    return solved


def draw_joined(ax: Axes, solved: Solved) -> Axes:
    """Both paths, and lines between their knots of the same time."""
    draw_path(ax, solved.optimum, **PLAN_LINE)
    draw_path(ax, solved.guess, **GUESS_LINE)
    guess, optimum = solved.compared
    for i in range(0, N_COMPARED, JOINED):
        pair = np.stack([guess.poses[i], optimum.poses[i]])
        ax.plot(pair[:, State.X], pair[:, State.Y], color=style.FRAME, linewidth=0.7, zorder=3)
    ax.set_aspect("equal", adjustable="datalim")
    return ax


def draw_errors(ax: Axes, example: Solved, solved: list[Solved]) -> Axes:
    """The distance along one trajectory, and its median and band over many."""
    if solved:
        errors = np.stack([distances(each) for each in solved])
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
