"""The curves as one page: a row a parameter, beside each other iterations, time and the share of verified plans."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from drake_gnnocp.experiments.benchmark.methods import GNN, GNN_DIRECT, HYBRID_ASTAR
from drake_gnnocp.experiments.figures.sheet import PAGE, curves, new_sheet, share_legend
from drake_gnnocp.experiments.reports.parameters import Parameter
from drake_gnnocp.pictures import style

ROW, LEGEND = 1.55, 0.5  # inch, heights of a row of panels and of the legend
SERIES: dict[str, tuple[str, dict[str, Any]]] = {  # name and look; hollow markers show what is below them
    GNN: ("GNN", {"color": style.PLAN, "marker": "o", "markersize": 3}),
    GNN_DIRECT: ("GNN, no SQP steps", {"color": style.START, "marker": "^", "markersize": 5.5}),
    HYBRID_ASTAR: ("Hybrid A*", {"color": style.GUESS, "marker": "s", "markersize": 5.5}),
}
QUARTILES = ("median", "p25", "p75")
LOWEST = 90.0  # %, at which an axis of shares begins where none is lower
BAND = 0.15  # opacity of the band between the quartiles


def analysis_figure(curves_of: Sequence[tuple[Parameter, pd.DataFrame]]) -> Figure:
    """All parameters below each other."""
    figure = new_sheet(PAGE, ROW * len(curves_of) + LEGEND)
    axes = figure.subplots(len(curves_of), 3, squeeze=False)
    for (iterations, time, verified), (parameter, rows) in zip(axes, curves_of, strict=True):
        for ax, label in ((iterations, "iterations"), (time, "total time [s]"), (verified, "verified [%]")):
            curves(ax, "", parameter.label, label)
            mark_values(ax, parameter, rows)
        draw_curve(iterations, rows, "iterations", "Ipopt's iterations")
        draw_curve(iterations, rows, "convex_steps", "SQP steps", "--", band=False)
        draw_curve(time, rows, "total_s", "")
        draw_verified(verified, rows)
        for ax in (iterations, time):
            ax.set_ylim(bottom=0.0)
    share_legend(figure, axes.flat, 3)
    return figure


def values_of(rows: pd.DataFrame) -> list[float]:
    """The values of a parameter in order: they stand at equal distances, whatever their size."""
    return sorted(float(value) for value in rows.value.unique())


def mark_values(ax: Axes, parameter: Parameter, rows: pd.DataFrame) -> Axes:
    """Ticks at the values, and a dotted line at the default."""
    values = values_of(rows)
    ax.set_xticks(range(len(values)), [f"{value:g}" for value in values])
    ax.set_xlim(-0.3, len(values) - 0.7)
    if parameter.default in values:
        at = values.index(parameter.default)
        ax.axvline(at, color=style.LIMIT, linewidth=0.9, linestyle=":", label="default", zorder=1)
    return ax


def draw_curve(ax: Axes, rows: pd.DataFrame, column: str, label: str, line: str = "-", band: bool = True) -> Axes:
    """Medians of a column over the values, a curve for every series, with a band between the quartiles if wanted."""
    values = values_of(rows)
    for series, (name, look) in SERIES.items():
        found = rows[rows.guess == series].sort_values("value")
        if found.empty or (column == "convex_steps" and series == GNN_DIRECT):  # there are none
            continue
        x = [values.index(float(value)) for value in found.value]
        middle, low, high = (found[f"{column}_{of}"].to_numpy() for of in QUARTILES)
        text = f"{name}, {label}" if label and series != GNN_DIRECT else name if label else None
        ax.plot(x, middle, linestyle=line, linewidth=1.2, markerfacecolor="none", label=text, **look)
        if band:
            ax.fill_between(x, low, high, color=look["color"], alpha=BAND, linewidth=0)
    return ax


def draw_verified(ax: Axes, rows: pd.DataFrame) -> Axes:
    """Share of the tasks with a verified plan, which has no spread, a curve for every series."""
    percent = 100 * rows.verified_share
    draw_curve(ax, rows.assign(**{f"percent_{of}": percent for of in QUARTILES}), "percent", "", band=False)
    lowest = float(percent.min())
    ax.set_ylim(max(0.0, min(lowest - 3.0, LOWEST)), 102.0)
    return ax
