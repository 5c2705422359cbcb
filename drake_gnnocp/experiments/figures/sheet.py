"""Sheets for print: figures as wide as a column or a page, whose smallest letters are 7 points there."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from drake_gnnocp.pictures import style
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import State

COLUMN, PAGE = 3.5, 7.2  # inch, widths of one column and of both
TITLE, TEXT, SMALL = 8.5, 8.0, 7.0  # points
PLAN_LINE: dict[str, Any] = {"color": style.PLAN, "linewidth": 1.5, "label": "optimum", "zorder": 5}
GUESS_LINE: dict[str, Any] = style.GUESS_LINE | {"label": "GNN guess", "zorder": 6}
WHITE: dict[str, Any] = {"facecolor": "white", "edgecolor": "none"}  # behind letters


def new_sheet(width: float, height: float) -> Figure:
    """An empty figure of width x height [inch] that finds room for its labels and legends by itself."""
    figure = style.new_figure(width, height)
    figure.set_layout_engine("constrained")
    return figure


def page(height: float, rows: int, columns: int, **look: Any) -> tuple[Figure, list[Axes]]:
    """A sheet as wide as a page with its axes, row by row; `look` is that of matplotlib's `subplots`."""
    figure = new_sheet(PAGE, height)
    return figure, list(figure.subplots(rows, columns, **look).flat)


def small(ax: Axes, title: str | None = None, x: str | None = None, y: str | None = None) -> Axes:
    """Title and labels in the sizes of a sheet; those not given stay as they are."""
    ax.set_title(ax.get_title() if title is None else title, fontsize=TITLE)
    ax.set_xlabel(ax.get_xlabel() if x is None else x, fontsize=TEXT)
    ax.set_ylabel(ax.get_ylabel() if y is None else y, fontsize=TEXT)
    ax.tick_params(labelsize=SMALL)
    return ax


def curves(ax: Axes, title: str, x: str, y: str) -> Axes:
    """An axes for curves, in the common look and in the sizes of a sheet."""
    return small(style.dress(ax), title, x, y)


def draw_path(ax: Axes, trajectory: Trajectory, **look: Any) -> Axes:
    """The path of the rear axle's middle as one line."""
    ax.plot(trajectory.column(State.X), trajectory.column(State.Y), **look)
    return ax


def draw_line(ax: Axes, a: np.ndarray, b: np.ndarray, **look: Any) -> Axes:
    """A straight line between two points (2,)."""
    ax.plot(*np.transpose([a, b]), **look)
    return ax


def draw_text(ax: Axes, at: np.ndarray, text: str, **look: Any) -> Axes:
    """Text at a point (2,)."""
    ax.text(at[0], at[1], text, **look)
    return ax


def draw_arrow(ax: Axes, tail: Sequence[float] | np.ndarray, head: Sequence[float] | np.ndarray, **look: Any) -> Axes:
    """A straight arrow between two points (2,); its look is that of matplotlib's `arrowprops`."""
    props = {"arrowstyle": "-|>,head_width=0.18,head_length=0.4", "shrinkA": 0, "shrinkB": 0} | look
    ax.annotate("", (head[0], head[1]), (tail[0], tail[1]), arrowprops=props, annotation_clip=False)
    return ax


def share_legend(figure: Figure, axes: Iterable[Axes], columns: int) -> None:
    """One legend below all axes, of everything that is labelled in any of them, in place of their own."""
    labelled: dict[str, Any] = {}
    for ax in axes:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            labelled.setdefault(label, handle)
        if (legend := ax.get_legend()) is not None:
            legend.remove()
    if labelled:
        look: dict[str, Any] = {"ncols": columns, "frameon": False, "fontsize": TEXT}
        figure.legend(list(labelled.values()), list(labelled), loc="outside lower center", **look)
