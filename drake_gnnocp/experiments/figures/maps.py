"""Plans on maps: the four test maps, one plan step by step, and an overview."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from drake_gnnocp.experiments.figures.plans import Plans
from drake_gnnocp.experiments.figures.sheet import GUESS_LINE, PLAN_LINE, draw_path, page, share_legend, small
from drake_gnnocp.pictures import draw_map, style

MAPS = ("map_a", "map_b", "map_c", "map_d")
EXAMPLE = MAPS[0]
TICK = 1.1  # m, length of the headings' ticks


def test_maps_figure(plans: Plans) -> Figure:
    """Plans from the network's guess on map_a to map_d."""
    solved = [plans.solved(name) for name in MAPS]
    figure, axes = page(7.3, 2, 2)
    for ax, letter, plan in zip(axes, "abcd", solved, strict=True):
        small(draw_map(ax, plan.scenario, plan.optimum, title=f"({letter}) {plan.title}"))
    share_legend(figure, axes, 6)
    return figure


def process_figure(plans: Plans) -> Figure:
    """Predicted points, knots, optimum and both on map_a."""
    solved = plans.solved(EXAMPLE)
    points, guess, optimum = plans.points(solved), solved.guess, solved.optimum
    titles = (
        f"(a) {len(points)} predicted points",
        f"(b) interpolated to {len(guess)} knots",
        f"(c) optimised, {solved.status}",
        "(d) guess and optimum",
    )
    figure, axes = page(7.3, 2, 2)
    for ax, title, plan in zip(axes, titles, (None, None, optimum, None), strict=True):
        small(draw_map(ax, solved.scenario, plan, title=title))
    for ax, knots, label, size in ((axes[0], points, "predicted points", 4.5), (axes[1], guess, "knots", 2.5)):
        draw_path(ax, knots, color=style.GUESS, lw=0, marker="o", ms=size, mew=0, label=label, zorder=5)
    x, y, theta = points.poses.T
    ticks = np.stack([x, x + TICK * np.cos(theta)]), np.stack([y, y + TICK * np.sin(theta)])
    axes[0].plot(*ticks, color=style.GUESS, linewidth=0.6, zorder=4)
    draw_path(axes[3], guess, **GUESS_LINE)
    draw_path(axes[3], optimum, **PLAN_LINE | {"label": "optimised path"})
    share_legend(figure, axes, 4)
    return figure


def overview_figure(plans: Plans) -> Figure:
    """Scenario, guess and plan side by side."""
    solved = plans.solved(EXAMPLE)
    figure, axes = page(2.95, 1, 3, sharey=True)
    small(draw_map(axes[0], solved.scenario, title="scenario"))
    small(draw_map(axes[1], solved.scenario, guess=solved.guess, title="learned guess"), y="")
    title = f"{solved.status} plan, {solved.optimum.duration:.0f} s"
    small(draw_map(axes[2], solved.scenario, solved.optimum, solved.guess, title=title), y="")
    share_legend(figure, axes, 6)
    return figure
