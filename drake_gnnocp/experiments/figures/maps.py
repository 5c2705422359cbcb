"""Plans on maps: the four test maps, one plan step by step, and an overview."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from drake_gnnocp.experiments.figures.plans import Plans
from drake_gnnocp.experiments.figures.sheet import (
    GUESS_LINE,
    PAGE,
    PLAN_LINE,
    draw_path,
    new_sheet,
    share_legend,
    small,
)
from drake_gnnocp.pictures import draw_map, style
from drake_gnnocp.trajectory import Trajectory

MAPS = ("map_a", "map_b", "map_c", "map_d")
EXAMPLE = MAPS[0]
TICK = 1.1  # m, length of the headings' ticks


def test_maps_figure(plans: Plans) -> Figure:
    """The plans from the network's guess, with footprints."""
    solved = [plans.solved(name) for name in MAPS]
    figure = new_sheet(PAGE, 7.3)
    axes = list(figure.subplots(2, 2).flat)
    for ax, letter, each in zip(axes, "abcd", solved, strict=True):
        small(draw_map(ax, each.scenario, each.optimum, title=f"({letter}) {each.title}"))
    share_legend(figure, axes, 6)
    return figure


def process_figure(plans: Plans) -> Figure:
    """Predicted points, interpolated knots, the optimum, and guess against optimum."""
    solved = plans.solved(EXAMPLE)
    points, guess, optimum = plans.points(solved), solved.guess, solved.optimum
    figure = new_sheet(PAGE, 7.3)
    axes = list(figure.subplots(2, 2).flat)
    titles = (
        f"(a) {len(points)} predicted points",
        f"(b) interpolated to {len(guess)} knots",
        f"(c) optimised, {solved.status}",
        "(d) guess and optimum",
    )
    for ax, title, plan in zip(axes, titles, (None, None, optimum, None), strict=True):
        small(draw_map(ax, solved.scenario, plan, title=title))
    draw_points(axes[0], points, "predicted points", 4.5)
    draw_headings(axes[0], points)
    draw_points(axes[1], guess, "knots", 2.5)
    draw_path(axes[3], guess, **GUESS_LINE)
    draw_path(axes[3], optimum, **PLAN_LINE | {"label": "optimised path"})
    share_legend(figure, axes, 4)
    return figure


def draw_points(ax: Axes, trajectory: Trajectory, label: str, size: float) -> Axes:
    """The knots of a trajectory as dots of a size [points]."""
    return draw_path(ax, trajectory, color=style.GUESS, lw=0, marker="o", ms=size, mew=0, label=label, zorder=5)


def draw_headings(ax: Axes, trajectory: Trajectory) -> Axes:
    """Ticks in the direction of the headings."""
    x, y, theta = trajectory.poses.T
    tips = np.stack([x + TICK * np.cos(theta), y + TICK * np.sin(theta)])
    ax.plot(np.stack([x, tips[0]]), np.stack([y, tips[1]]), color=style.GUESS, linewidth=0.6, zorder=4)
    return ax


def overview_figure(plans: Plans) -> Figure:
    """Scenario, guess and plan side by side: for the top of a page."""
    solved = plans.solved(EXAMPLE)
    figure = new_sheet(PAGE, 2.95)
    axes = list(figure.subplots(1, 3, sharey=True))
    small(draw_map(axes[0], solved.scenario, title="scenario"))
    small(draw_map(axes[1], solved.scenario, guess=solved.guess, title="learned guess"))
    title = f"{solved.status} plan, {solved.optimum.duration:.0f} s"
    small(draw_map(axes[2], solved.scenario, solved.optimum, solved.guess, title=title))
    for ax in axes[1:]:
        ax.set_ylabel("")
    share_legend(figure, axes, 6)
    return figure
