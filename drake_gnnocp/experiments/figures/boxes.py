"""Boxes and arrows of diagrams, placed in inches on a sheet."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

from drake_gnnocp.experiments.figures.sheet import SMALL, TEXT, WHITE, draw_arrow
from drake_gnnocp.pictures import style

LINE = 0.125  # inch, from one line of small text to the next
Point = tuple[float, float]


@dataclass(frozen=True)
class Box:
    """A rectangle with a title and lines of text below it."""

    x: float  # inch, left
    y: float  # inch, bottom
    width: float  # inch
    height: float  # inch
    title: str
    lines: tuple[str, ...] = ()
    color: str = style.FRAME
    dashed: bool = False  # a way out, not the usual way

    def at(self, across: float, up: float) -> Point:
        """A point by its shares of width and height: (0, 0.5) is the middle of the left side."""
        return self.x + across * self.width, self.y + up * self.height

    left = property(lambda box: box.at(0.0, 0.5))  # the middles of the sides
    right = property(lambda box: box.at(1.0, 0.5))
    top = property(lambda box: box.at(0.5, 1.0))
    bottom = property(lambda box: box.at(0.5, 0.0))


def diagram(width: float, height: float) -> tuple[Figure, Axes]:
    """A figure of width x height with one invisible axes in inches."""
    figure = style.new_figure(width, height)
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    ax.set(xlim=(0.0, width), ylim=(0.0, height))
    ax.axis("off")
    return figure, ax


def draw_box(ax: Axes, box: Box) -> Axes:
    """Draw a box with its text, centred."""
    fill, line = (*to_rgb(box.color), 0.12), "--" if box.dashed else "-"
    ax.add_patch(_rounded(box.x, box.y, box.width, box.height, facecolor=fill, edgecolor=box.color, lw=1.1, ls=line))
    x, middle = box.at(0.5, 0.5)
    first = middle + LINE * len(box.lines) / 2
    ax.text(x, first, box.title, ha="center", va="center", fontsize=TEXT, fontweight="bold")
    for i, line in enumerate(box.lines, start=1):
        ax.text(x, first - 0.02 - LINE * i, line, ha="center", va="center", fontsize=SMALL)
    return ax


def draw_frame(ax: Axes, x: float, y: float, width: float, height: float, title: str) -> Axes:
    """A thin frame around boxes that belong together, titled at its upper left."""
    ax.add_patch(_rounded(x, y, width, height, fill=False, edgecolor=style.OBSTACLE, lw=0.8))
    ax.text(x + 0.08, y + height - 0.05, title, ha="left", va="top", fontsize=TEXT, color=style.OBSTACLE_EDGE)
    return ax


def draw_way(ax: Axes, *points: Point, color: str = "#333333", dashed: bool = False) -> Axes:
    """An arrow along straight pieces, to the last of the points."""
    line = "--" if dashed else "-"
    ax.plot(*zip(*points[:-1], strict=True), color=color, linewidth=1.1, linestyle=line, solid_capstyle="butt")
    return draw_arrow(ax, points[-2], points[-1], color=color, lw=1.1, ls=line)


def draw_note(ax: Axes, x: float, y: float, text: str, color: str = "#333333", align: str = "center") -> Axes:
    """Small text beside an arrow, on white."""
    ax.text(x, y, text, ha=align, va="center", fontsize=SMALL, color=color, bbox=WHITE | {"pad": 1.0})
    return ax


def _rounded(x: float, y: float, width: float, height: float, **look: Any) -> FancyBboxPatch:
    return FancyBboxPatch((x, y), width, height, boxstyle="round,pad=0,rounding_size=0.05", **look)
