"""A table for readers (Markdown) and for programs (CSV), both from the same rows."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drake_gnnocp.experiments.benchmark.runs import Run
from drake_gnnocp.experiments.reports.text import csv_text
from drake_gnnocp.files import write_atomically

Cell = str | int | float
CellRow = dict[str, Cell]  # by column, NaN where there is no number; all rows of a table have the same columns
Value = Callable[[Run], float]

SECONDS: dict[str, Value] = {  # s, as the paper divides them
    "planning": lambda run: run.guess_s,
    "optimisation": lambda run: run.opt_s,
    "total": lambda run: run.total_s,
}
WORK: dict[str, Value] = {
    "convex_steps": lambda run: run.convex_steps,
    "first_iterations": lambda run: run.first_iterations,
    "first_steps": lambda run: run.convex_steps + run.first_iterations,
    "iterations": lambda run: run.iterations,
}
DISPARITY: dict[str, Value] = {  # the paper's four bars
    "disparity_position_m": lambda run: run.disparity_position,
    "disparity_theta_rad": lambda run: run.disparity_theta,
    "disparity_v_m_per_s": lambda run: run.disparity_v,
    "disparity_phi_rad": lambda run: run.disparity_phi,
}
DISPARITY_NOTE = """\
Cumulated distance of the guess that the solver started from and the optimum it led to, over 120 equal steps of their
durations: the four bars of the paper. Medians over the plans that the method's own guess led to.
"""


@dataclass(frozen=True)
class Report:
    """What is written."""

    markdown: str
    csv: str

    def save(self, folder: Path, name: str) -> None:
        """Write NAME.md and NAME.csv into a folder."""
        write_atomically(folder / f"{name}.csv", self.csv)
        write_atomically(folder / f"{name}.md", self.markdown)


def report(sections: Sequence[str], rows: Sequence[CellRow]) -> Report:
    """Sections of Markdown in order, and all columns of the rows as CSV: 5 digits, empty where there is no number."""
    cells = [[f"{cell:.5g}" if isinstance(cell, float) else cell for cell in row.values()] for row in rows]
    header = list(rows[0]) if rows else []
    return Report("\n".join(sections), csv_text(header, [["" if c == "nan" else c for c in line] for line in cells]))


def number(cell: Cell, digits: int) -> str:
    """A cell for readers, a dash where there is no number."""
    return "-" if isinstance(cell, float) and math.isnan(cell) else f"{cell:.{digits}f}"


def cell_spread(row: CellRow, name: str, digits: int) -> str:
    """Median / 95th percentile of a quantity for readers."""
    return f"{number(row[f'{name}_median'], digits)} / {number(row[f'{name}_p95'], digits)}"


def percentile(values: Sequence[float], which: float) -> float:
    """A percentile, NaN of nothing."""
    return float(np.percentile(values, which)) if len(values) else math.nan


def median(runs: Sequence[Run], value: Value) -> float:
    """The median over runs, NaN of none."""
    return percentile([value(run) for run in runs], 50)


def quotients(pairs: Sequence[tuple[Run, Run]], value: Value) -> list[float]:
    """Value of the first over that of the second, but where a run crashed before it had one."""
    return [value(one) / value(other) for one, other in pairs if value(other) > 0]
