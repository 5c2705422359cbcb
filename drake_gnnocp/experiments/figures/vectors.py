"""Vectorisation: a scene, its vectors in the start's frame, their subgraphs, and the global graph."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from drake_gnnocp.experiments.figures.plans import Plans
from drake_gnnocp.experiments.figures.sheet import (
    SMALL,
    TEXT,
    WHITE,
    curves,
    draw_arrow,
    draw_line,
    draw_text,
    page,
    share_legend,
    small,
)
from drake_gnnocp.pictures import draw_map, style
from drake_gnnocp.scenario import Scenario

COLORS = (style.PLAN, style.GUESS, style.OBSTACLE_EDGE)  # of the obstacles' subgraphs
ARROW: dict[str, Any] = {"arrowstyle": "-|>,head_width=0.2,head_length=0.45", "lw": 1.3}
HEADING = 3.0  # m, length of the vectors of start and goal


def small_scene() -> Scenario:
    """Three obstacles between start and goal."""
    obstacles = (
        [[8.0, 0.5], [12.0, 1.5], [11.0, 5.5], [7.0, 4.5]],
        [[3.5, 9.0], [8.5, 9.5], [6.0, 14.0]],
        [[15.0, 4.0], [18.0, 3.5], [19.5, 6.0], [17.0, 8.5], [14.5, 7.0]],
    )
    rings = tuple(np.array(ring) for ring in obstacles)
    return Scenario("small scene", np.array([2.0, 3.5, 0.25]), np.array([18.0, 12.0, 0.9]), rings)


def vectorisation_figure(plans: Plans) -> Figure:
    """A scene as vectors, subgraphs and the global graph."""
    scenario = small_scene()
    groups, states = _vectors(scenario)
    figure, axes = page(5.0, 2, 2)
    small(draw_map(axes[0], scenario, title="(a) scene"))
    draw_vectors(axes[1], groups, states)
    draw_subgraphs(axes[2], groups, states)
    draw_global_graph(axes[3], groups, states)
    titles = ("(b) vectors, seen from the start", "(c) subgraphs", "(d) global graph")
    box = np.concatenate([*groups, states]).reshape(-1, 2)
    for ax, title in zip(axes[1:], titles, strict=True):
        (left, low), (right, high) = box.min(axis=0) - 2.5, box.max(axis=0) + 2.5
        curves(ax, title, "x [m]", "y [m]").set(xlim=(left, right), ylim=(low, high), aspect="equal")
    share_legend(figure, axes, 6)
    return figure


def draw_vectors(ax: Axes, groups: list[np.ndarray], states: np.ndarray) -> Axes:
    """Vectors of obstacles (E_j, 4) and of start and goal (2, 4), tail and head [m], as arrows."""
    for j, (group, color) in enumerate(zip(groups, COLORS, strict=True), start=1):
        for edge in group:
            draw_arrow(ax, edge[:2], edge[2:], color=color, **ARROW)
        draw_text(ax, group[:, :2].mean(axis=0), f"$v^o_{j}$", color=color, fontsize=TEXT, ha="center", va="center")
    for edge, color, name in zip(states, (style.START, style.GOAL), ("$v^s$", "$v^f$"), strict=True):
        draw_arrow(ax, edge[:2], edge[2:], color=color, **ARROW)
        ax.plot(*edge[:2], "o", color=color, markersize=3.5)
        ax.annotate(name, edge[:2], (-5, -10), textcoords="offset points", color=color, fontsize=TEXT, ha="center")
    return ax


def draw_subgraphs(ax: Axes, groups: list[np.ndarray], states: np.ndarray) -> Axes:
    """A node a vector; the vectors of an obstacle are all connected, and so are start and goal."""
    for group, color in zip(groups, COLORS, strict=True):
        _draw_graph(ax, (group[:, :2] + group[:, 2:]) / 2, color)
    ends = states[:, :2]
    ax.plot(*ends.T, color=style.FRAME, lw=0.9, ls="--")
    for end, color in zip(ends, (style.START, style.GOAL), strict=True):
        ax.plot(*end, "s", color=color, markersize=5)
    return ax


def draw_global_graph(ax: Axes, groups: list[np.ndarray], states: np.ndarray) -> Axes:
    """A node a subgraph, all connected."""
    middles = np.array([*(group[:, :2].mean(axis=0) for group in groups), states[:, :2].mean(axis=0)])
    _draw_graph(ax, middles, style.FRAME)
    names = [*(f"obstacle {j}" for j in range(1, len(groups) + 1)), "start, goal"]
    for middle, color, name in zip(middles, (*COLORS, style.START), names, strict=True):
        ax.plot(*middle, "o", color=color, markersize=9, zorder=4)
        look: dict[str, Any] = {"fontsize": SMALL, "ha": "center", "bbox": WHITE | {"pad": 0.5, "alpha": 0.85}}
        ax.annotate(name, middle, (0, -14), textcoords="offset points", zorder=5, **look)
    return ax


def _draw_graph(ax: Axes, nodes: np.ndarray, color: str) -> None:
    for a, b in combinations(nodes, 2):
        draw_line(ax, a, b, color=color, lw=0.9, zorder=2)
    ax.plot(*nodes.T, "o", color=color, markersize=4, zorder=3)


def _vectors(scenario: Scenario) -> tuple[list[np.ndarray], np.ndarray]:
    """What the network is given: vectors of every obstacle (E_j, 4) and of start and goal (2, 4), from the start."""
    from drake_gnnocp.learning.scene import scene_of

    scene = scene_of(scenario)
    edges, mask, goal = scene.edges[0], scene.mask[0], scene.goal[0]
    x, y, theta = goal
    end = [x, y, x + HEADING * np.cos(theta), y + HEADING * np.sin(theta)]
    return [group[here] for group, here in zip(edges, mask, strict=True)], np.array([[0.0, 0.0, HEADING, 0.0], end])
