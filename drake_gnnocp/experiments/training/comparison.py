"""Trainings compared by the plans they led to: what each idea gave, as a table."""

from __future__ import annotations

import csv
from pathlib import Path

COLUMNS = {
    "epoch": "epochs",
    "validation_position": "position error of the best hypothesis, m",
    "plan_verified": "verified",
    "plan_first": "from the first hypothesis",
    "plan_iterations": "Ipopt iterations, median",
    "plan_badness": "work",
}
SHARES = ("plan_verified", "plan_first")


def comparison(folder: Path) -> str:
    """A Markdown table with a row for every training in a folder, of its last check by planning.

    Args:
        folder: holds a folder for each training, with its `curves.csv`.

    Raises:
        FileNotFoundError: there is no training.
    """
    lines = ["| training | " + " | ".join(COLUMNS.values()) + " |", "|---" * (1 + len(COLUMNS)) + "|"]
    for path in sorted(folder.glob("*/curves.csv")):
        with path.open(encoding="utf-8") as file:
            checked = [row for row in csv.DictReader(file) if row.get("plan_verified")]
        if checked:
            cells = [_cell(name, float(checked[-1][name])) for name in COLUMNS]
            lines.append("| " + " | ".join((path.parent.name, *cells)) + " |")
    if len(lines) == 2:
        raise FileNotFoundError(2, "no training with a check by planning here", str(folder))
    return "\n".join(lines) + "\n"


def _cell(name: str, value: float) -> str:
    return f"{value:.0%}" if name in SHARES else f"{value:.3g}"
