"""One look for all pictures: a palette that colour-blind readers can tell apart, thin frames, white paper.

The colours are those of Okabe and Ito (2008); in grey print they keep different lightness, and no two curves differ by
colour alone (the guess is dashed). Figures are made with matplotlib's object interface: no pyplot, no backend, no
global state.
"""

from __future__ import annotations

import os
from pathlib import Path

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

# Okabe and Ito's colours by their role
PLAN = "#0072B2"  # blue
GUESS = "#D55E00"  # vermillion
START = "#009E73"  # bluish green
GOAL = "#CC79A7"  # reddish purple
SWEPT = "#56B4E9"  # sky blue: footprints along the plan
LIMIT = "#000000"
OBSTACLE = "#9A9A9A"
OBSTACLE_EDGE = "#4D4D4D"
FRAME = "#666666"

TITLE_SIZE, LABEL_SIZE, TICK_SIZE = 11.0, 9.5, 8.5  # points
DPI = 160  # a 7 inch picture is 1120 pixels wide


def new_figure(width: float, height: float) -> Figure:
    """An empty white figure of about width x height [inch]: `save_figure` fits the paper to what is drawn."""
    return Figure(figsize=(width, height), facecolor="white")


def dress(ax: Axes) -> Axes:
    """Give an axes the common look: no box on the right and top, faint grid, small ticks."""
    ax.set_facecolor("white")
    ax.set_axisbelow(True)
    ax.grid(True, color="#E3E3E3", linewidth=0.6)
    ax.tick_params(labelsize=TICK_SIZE, color=FRAME, length=3)
    for side, spine in ax.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set_color(FRAME)
    return ax


def save_figure(figure: Figure, path: Path | str) -> None:
    """Write a figure in the format of its suffix, beside its place first: a killed run leaves no half picture."""
    path = Path(path)
    temporary = path.with_name(f".{path.name}.tmp{os.getpid()}")
    try:
        kind = path.suffix[1:] or "png"
        metadata = {"CreationDate": None} if kind == "pdf" else None  # the same picture is the same file
        with rc_context({"pdf.fonttype": 42}):  # TrueType: publishers refuse the default
            figure.savefig(temporary, format=kind, dpi=DPI, bbox_inches="tight", pad_inches=0.08, metadata=metadata)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
