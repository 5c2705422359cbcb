"""The curves of a training: losses over epochs and the plans it led to, as a file, a picture and a table."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from drake_gnnocp.experiments.text import markdown_table
from drake_gnnocp.files import write_atomically
from drake_gnnocp.pictures import style

Rows = Sequence[dict[str, float]]  # one an epoch
FIGURE_SIZE = (7.2, 7.6)  # inch
SPLITS = (("train", "training maps", style.PLAN, "-"), ("validation", "validation maps", style.GUESS, "--"))
PLANS = ("plan_iterations", "iterations of the first solve, median", style.START, "-")
PANELS = (  # label, and the curves in it: column, name, colour, line
    ("loss", [(f"{split}_loss", *look) for split, *look in SPLITS]),
    ("mean position error [m]", [(f"{split}_position", *look) for split, *look in SPLITS]),
    ("plans on validation maps", [PLANS]),
)
COMPARED = {  # columns of the table of trainings
    "epoch": "epochs",
    "validation_position": "position error of the best hypothesis, m",
    "plan_verified": "verified",
    "plan_first": "from the first hypothesis",
    "plan_iterations": "Ipopt iterations, median",
    "plan_badness": "work",
}
SHARES = ("plan_verified", "plan_first")


def write_curves(path: Path, rows: Rows) -> None:
    """Write a CSV with a row for every epoch; columns that an epoch has no value for are empty."""
    columns = list(dict.fromkeys(name for row in rows for name in row))
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: f"{value:.6g}" for name, value in row.items()} for row in rows)
    write_atomically(path, text.getvalue())


def draw_curves(ax: Axes, rows: Rows, curves: Sequence[Sequence[str]]) -> Axes:
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
    panels = [(label, curves) for label, curves in PANELS if any(column in known for column, *_ in curves)]
    figure = style.new_figure(FIGURE_SIZE[0], FIGURE_SIZE[1] * len(panels) / len(PANELS))
    axes = list(figure.subplots(len(panels), 1, sharex=True, gridspec_kw={"hspace": 0.12}, squeeze=False)[:, 0])
    for ax, (label, curves) in zip(axes, panels, strict=True):
        draw_curves(ax, rows, curves)
        ax.set_ylabel(label, fontsize=style.LABEL_SIZE)
        ax.set_ylim(bottom=0.0)
    axes[-1].set_xlabel("epoch", fontsize=style.LABEL_SIZE)
    return figure


def comparison(folder: Path) -> str:
    """A Markdown table with a row for every training in a folder, of its last check by planning.

    Args:
        folder: holds a folder for each training, with its `curves.csv`.

    Raises:
        FileNotFoundError: there is no training.
    """
    rows = []
    for path in sorted(folder.glob("*/curves.csv")):
        with path.open(encoding="utf-8") as file:
            checked = [row for row in csv.DictReader(file) if row.get("plan_verified")]
        if checked:
            values = {name: float(checked[-1][name]) for name in COMPARED}
            cells = [f"{value:.0%}" if name in SHARES else f"{value:.3g}" for name, value in values.items()]
            rows.append([path.parent.name, *cells])
    if not rows:
        raise FileNotFoundError(2, "no training with a check by planning here", str(folder))
    return markdown_table(["training", *COMPARED.values()], rows)
