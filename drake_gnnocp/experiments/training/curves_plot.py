"""The curves of a training: losses over epochs, and the plans it led to."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from drake_gnnocp.pictures import style

Rows = Sequence[dict[str, float]]
FIGURE_SIZE = (7.2, 7.6)  # inch
PANELS: tuple[tuple[str, tuple[tuple[str, str, str, str], ...]], ...] = (  # label, curves: column, name, colour, line
    (
        "loss",
        (
            ("train_loss", "training maps", style.PLAN, "-"),
            ("validation_loss", "validation maps", style.GUESS, "--"),
        ),
    ),
    (
        "mean position error [m]",
        (
            ("train_position", "training maps", style.PLAN, "-"),
            ("validation_position", "validation maps", style.GUESS, "--"),
        ),
    ),
    ("plans on validation maps", (("plan_iterations", "iterations of the first solve, median", style.START, "-"),)),
)


def draw_curves(ax: Axes, rows: Rows, curves: Sequence[tuple[str, str, str, str]]) -> Axes:
    """Draw columns of the curves over the epochs; epochs without a value are left out."""
    style.dress(ax)
    for column, name, colour, line in curves:
        known = [(row["epoch"], row[column]) for row in rows if column in row]
        if known:
            marker = "o" if len(known) < len(rows) else None
            ax.plot(*zip(*known, strict=True), color=colour, linestyle=line, marker=marker, markersize=3, label=name)
    if ax.lines:
        ax.legend(frameon=False, fontsize=9)
    return ax


def curves_figure(rows: Rows) -> Figure:
    """The curves of a training as a figure of its own, for a notebook or a file: a panel for what there is."""
    known = {name for row in rows for name in row}
    panels = [panel for panel in PANELS if any(column in known for column, *_ in panel[1])]
    figure = style.new_figure(FIGURE_SIZE[0], FIGURE_SIZE[1] * len(panels) / len(PANELS))
    axes = list(figure.subplots(len(panels), 1, sharex=True, gridspec_kw={"hspace": 0.12}, squeeze=False)[:, 0])
    for ax, (label, curves) in zip(axes, panels, strict=True):
        draw_curves(ax, rows, curves)
        ax.set_ylabel(label, fontsize=style.LABEL_SIZE)
        ax.set_ylim(bottom=0.0)
    axes[-1].set_xlabel("epoch", fontsize=style.LABEL_SIZE)
    return figure


def save_curves_picture(rows: Rows, path: Path | str) -> None:
    """Write the curves of a training as a picture (PNG, or what the suffix says)."""
    style.save_figure(curves_figure(rows), path)
