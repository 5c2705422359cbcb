"""The datasheet of a dataset: how it was made, what is in it, and a picture."""

from __future__ import annotations

import platform
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from drake_gnnocp.experiments.dataset.label import LEARNED, OUTCOMES, LabelOptions
from drake_gnnocp.experiments.dataset.records import SPLITS, MapRecord
from drake_gnnocp.experiments.tasks.draw import PAPER_MAPS
from drake_gnnocp.experiments.tasks.place import KINDS
from drake_gnnocp.files import write_atomically
from drake_gnnocp.pictures import style
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import State

FIGURE_SIZE = (7.2, 5.6)  # inch
BINS = 40
REST = 1e-3  # m/s, slower is standing


@dataclass(frozen=True)
class Numbers:
    """One number a kept trajectory: (S,) each."""

    durations: np.ndarray  # s
    distances: np.ndarray  # m, start to goal as the crow flies
    lengths: np.ndarray  # m, of the path
    gear_changes: np.ndarray
    costs: np.ndarray  # J
    obstacles: np.ndarray  # on the map


def write_datasheet(records: Sequence[MapRecord], folder: Path) -> None:
    """Write `datasheet.md` and `datasheet.png` into the dataset's folder."""
    numbers = numbers_of(records)
    size = sum(path.stat().st_size for path in folder.glob("*/*.npz"))
    write_atomically(folder / "datasheet.md", datasheet(records, numbers, size))
    figure = style.new_figure(*FIGURE_SIZE)
    draw_distributions(list(figure.subplots(2, 3, gridspec_kw={"hspace": 0.45, "wspace": 0.3}).flat), numbers)
    style.save_figure(figure, folder / "datasheet.png")


def numbers_of(records: Sequence[MapRecord]) -> Numbers:
    """What the distributions are drawn of."""
    rows = [
        (
            trajectory.duration,
            float(np.hypot(*(task.goal - task.start)[:2])),
            trajectory.path_length,
            _gear_changes(trajectory),
            label.cost,
            len(record.place.obstacles),
        )
        for record in records
        for task, label in zip(record.tasks, record.labels, strict=True)
        if (trajectory := label.trajectory) is not None
    ]
    return Numbers(*np.array(rows, dtype=float).reshape(-1, 6).T)


def _gear_changes(trajectory: Trajectory) -> int:
    v = trajectory.column(State.V)
    return int(np.count_nonzero(np.diff(np.sign(v[np.abs(v) > REST]))))


def datasheet(records: Sequence[MapRecord], numbers: Numbers, size: int) -> str:
    """The datasheet as Markdown; size of all files [bytes]."""
    options = LabelOptions()
    attempted = sum(len(record.labels) for record in records)
    lines = [
        "# Verified trajectories on random maps",
        "",
        "![distributions](datasheet.png)",
        "",
        "## How it was made",
        "",
        "`python -m drake_gnnocp.dataset` draws maps and pairs of start and goal from one seed (`settings.json`): two",
        f"of three of the first {PAPER_MAPS} maps are open ones with rectangles and irregular polygons on 40 m x 40 m,",
        "as in the paper; the third, and every map after them, is a car park or a yard, half of these with a car of",
        f"other size and limits. Every task is searched by Hybrid A*, timed gently with {options.slack:g} times the",
        "duration of its speed plan, optimised on 120 knots, kept if the independent dense check has verified the",
        f"plan. Time limits are {options.search_seconds:g} s for the search and {options.solve_seconds:g} s for the",
        f"solver, so which tasks fail depends a little on the machine ({platform.machine()}).",
        "",
        *_improvement(records),
        "## What is in it",
        "",
        f"{len(records)} maps, {attempted} tasks, **{len(numbers.costs)} verified trajectories**, {size / 1e6:.1f} MB.",
        "Maps, never samples, are split: of ten consecutive maps eight are for training, one for validation, one for",
        "the test.",
        "",
        "| maps | " + " | ".join(("number", "tasks", *OUTCOMES)) + " |",
        "|---" * (3 + len(OUTCOMES)) + "|",
        *(_row(kind, [r for r in records if r.place.kind == kind]) for kind in KINDS),
        *(
            _row(f"{split}: {kind}", [r for r in records if (r.split, r.place.kind) == (split, kind)])
            for split in SPLITS
            for kind in KINDS
        ),
        _row("**all**", list(records)),
        "",
        "| of a kept trajectory | 5 % | median | 95 % |",
        "|---|---|---|---|",
        *(
            f"| {name} | " + " | ".join(f"{value:.3g}" for value in np.percentile(values, [5, 50, 95])) + " |"
            for name, values in _columns(numbers)
            if len(values)
        ),
        "",
        "Format: see `drake_gnnocp/dataset/records.py`; `drake_gnnocp.dataset.generate.load_dataset` reads it.",
        "States and inputs are float32. Mirrored and reversed in time, every trajectory is again a solution: training",
        "uses both.",
        "",
    ]
    return "\n".join(lines)


def _improvement(records: Sequence[MapRecord]) -> list[str]:
    learned = [record for record in records if any(label.source == LEARNED for label in record.labels)]
    if not learned:
        return []
    n = sum(label.source == LEARNED for record in learned for label in record.labels)
    return [
        f"Then `--improve` solved tasks again from a network's hypotheses: {n} labels on {len(learned)} maps, numbers",
        f"{learned[0].index} to {learned[-1].index}, are of cheaper plans of the same duration, or of tasks that",
        "Hybrid A* had not solved.",
        "",
    ]


def _row(name: str, records: list[MapRecord]) -> str:
    counts = Counter(label.outcome for record in records for label in record.labels)
    tasks = sum(counts.values())
    cells = [f"{counts[outcome]} ({counts[outcome] / max(tasks, 1):.1%})" for outcome in OUTCOMES]
    return "| " + " | ".join((name, str(len(records)), str(tasks), *cells)) + " |"


def _columns(numbers: Numbers) -> list[tuple[str, np.ndarray]]:
    return [
        ("duration [s]", numbers.durations),
        ("start to goal [m]", numbers.distances),
        ("length of the path [m]", numbers.lengths),
        ("gear changes", numbers.gear_changes),
        ("cost J", numbers.costs),
        ("obstacles on the map", numbers.obstacles),
    ]


def draw_distributions(axes: Sequence[Axes], numbers: Numbers) -> Sequence[Axes]:
    """Histograms of what the datasheet's second table lists, on six axes."""
    for ax, (name, values) in zip(axes, _columns(numbers), strict=True):
        style.dress(ax)
        top = float(np.percentile(values, 99)) if len(values) else 1.0
        whole = name in ("gear changes", "obstacles on the map")
        bins = np.arange(-0.5, top + 1.5) if whole else np.linspace(0.0, max(top, 1e-9), BINS)
        ax.hist(values.clip(max=top), bins=bins.tolist(), color=style.PLAN)
        ax.set_xlabel(name, fontsize=style.LABEL_SIZE)
    return axes
