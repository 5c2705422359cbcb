"""The triangle-area method: triangles of P and the edges of ABCD cover ABCD, and more where P is outside."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from drake_gnnocp.experiments.figures.plans import Plans
from drake_gnnocp.experiments.figures.sheet import COLUMN, SMALL, TEXT, TITLE, draw_line, draw_text, new_sheet
from drake_gnnocp.ocp.triangle_areas import excess_area
from drake_gnnocp.pictures import style
from drake_gnnocp.polygons import signed_area

ABCD = np.array([[0.0, 0.0], [3.2, -0.4], [3.8, 2.2], [0.6, 2.6]])  # m, counter-clockwise
OUTSIDE, INSIDE = np.array([5.3, 1.6]), np.array([1.9, 1.2])  # m
COLORS = (style.PLAN, style.GUESS, style.START, style.GOAL)  # of the triangles PAB, PBC, PCD, PDA
HATCHES = ("", "////", "", "\\\\\\\\")
ROOM = ((-0.5, 5.9), (-0.95, 3.15))  # m, shown of x and of y


def triangle_area_figure(plans: Plans) -> Figure:
    """The triangle-area method, P outside and inside."""
    figure = new_sheet(COLUMN, 1.95)
    axes = figure.subplots(1, 2)
    for ax, letter, point, where in zip(axes, "ab", (OUTSIDE, INSIDE), ("outside", "inside"), strict=True):
        draw_triangles(ax, point, ABCD)
        ax.set_title(f"({letter}) P {where}", fontsize=TITLE)
    return figure


def draw_triangles(ax: Axes, point: np.ndarray, ring: np.ndarray) -> Axes:
    """Draw the triangles of a point (2,) and the edges of a convex ring (M, 2) [m], with the sum of their areas."""
    for a, b, color, hatch in zip(ring, np.roll(ring, -1, axis=0), COLORS, HATCHES, strict=True):
        ax.add_patch(Polygon([point, a, b], facecolor=color, alpha=0.25, edgecolor=color, hatch=hatch, lw=0.5))
        draw_line(ax, point, a, color=style.OBSTACLE_EDGE, lw=0.8, ls="--")
    ax.add_patch(Polygon(ring, fill=False, edgecolor=style.LIMIT, lw=1.4))
    centre = ring.mean(axis=0)
    for name, corner in zip("ABCD", ring, strict=True):
        at = corner + 0.3 * (corner - centre) / np.linalg.norm(corner - centre)
        draw_text(ax, at, name, fontsize=TEXT, ha="center", va="center")
    ax.plot(*point, "o", color=style.LIMIT, markersize=4)
    ax.text(point[0], point[1] + 0.15, "P", fontsize=TEXT, fontweight="bold", ha="center", va="bottom")
    ax.text(0.5, -0.02, _areas(point, ring), transform=ax.transAxes, fontsize=SMALL, ha="center", va="top")
    ax.set(xlim=ROOM[0], ylim=ROOM[1], aspect="equal")
    ax.axis("off")
    return ax


def _areas(point: np.ndarray, ring: np.ndarray) -> str:
    """The areas in words, as the constraint computes them."""
    area, excess = signed_area(ring), float(excess_area(point[None], ring[None])[0][0])
    triangles = f"$\\Sigma S_{{\\triangle}}$ = {area + excess:.2f} m² {'>' if excess else '='} $S_{{ABCD}}$"
    return f"{triangles}\n$S_{{ABCD}}$ = {area:.2f} m²\nexcess {abs(excess):.2f} m²"
