"""One look for all pictures: a palette that colour-blind readers can tell apart, thin frames, white paper.

The colours are those of Okabe and Ito (2008); in grey print they keep different lightness, and no two curves differ by
colour alone (the guess is dashed). Figures are made with matplotlib's object interface: no pyplot, no backend, no
global state.
"""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

# Okabe and Ito's colours by their role
PLAN = "#0072B2"  # blue
GUESS = "#D55E00"  # vermillion
START = "#009E73"  # bluish green
GOAL = "#CC79A7"  # reddish purple
FAINT_GOAL = "#EBCFDE"  # a third of it: goals that are not reached
SWEPT = "#56B4E9"  # sky blue: footprints along the plan
LIMIT = "#000000"
FAULT = "#C00000"  # dark red, beside the palette: what is wrong, and where it is blocked
OBSTACLE = "#9A9A9A"
OBSTACLE_EDGE = "#4D4D4D"
FRAME = "#666666"
GUESS_LINE: dict[str, Any] = {"color": GUESS, "linewidth": 1.1, "linestyle": "--"}  # of curves

TITLE_SIZE, LABEL_SIZE, TICK_SIZE = 11.0, 9.5, 8.5  # points
DPI = 160  # a 7 inch picture is 1120 pixels wide
COLOURS = 200  # of the palette of small pictures


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
    with beside(path) as temporary:
        write_figure(figure, temporary, path.suffix[1:] or "png")


@contextmanager
def beside(path: Path) -> Iterator[Path]:
    """A temporary file that takes the place of a file once it is written."""
    temporary = path.with_name(f".{path.name}.tmp{os.getpid()}")
    try:
        yield temporary
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def write_figure(figure: Figure, target: Path | BinaryIO, kind: str) -> None:
    """Write a figure as `kind` ("png", "pdf", ...) into a file; the same figure gives the same bytes."""
    metadata = {"CreationDate": None} if kind == "pdf" else None
    with rc_context({"pdf.fonttype": 42}):  # TrueType: publishers refuse the default
        figure.savefig(target, format=kind, dpi=DPI, bbox_inches="tight", pad_inches=0.08, metadata=metadata)


def small_picture(picture: Path | BinaryIO, width: int) -> bytes:
    """A picture as PNG of at most `width` pixels and COLOURS colours, small enough to stand in a notebook."""
    with Image.open(picture) as opened:
        opaque = opened.convert("RGB")
    if opaque.width > width:
        opaque = opaque.resize((width, round(opaque.height * width / opaque.width)), Image.Resampling.LANCZOS)
    buffer = io.BytesIO()
    # octrees keep colours that are rare, as that of a thin line: the usual median cut mixes them with others
    few = opaque.quantize(COLOURS, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    few.save(buffer, "png", optimize=True)
    return buffer.getvalue()
