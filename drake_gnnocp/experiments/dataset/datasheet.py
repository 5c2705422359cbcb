"""The datasheet of a dataset: how it was made, what is in it, and a picture."""

from __future__ import annotations

import platform
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from drake_gnnocp.experiments.dataset.label import LEARNED, OUTCOMES, PLAN, SEARCH_SECONDS, SOLVE_SECONDS
from drake_gnnocp.experiments.dataset.records import SPLITS, MapRecord
from drake_gnnocp.experiments.tasks.draw import PAPER_MAPS, WIDE_MAPS
from drake_gnnocp.experiments.tasks.place import KINDS
from drake_gnnocp.experiments.text import markdown_table
from drake_gnnocp.files import write_atomically
from drake_gnnocp.pictures import style

FIGURE_SIZE = (7.2, 5.6)  # inch
BINS = 40
WHOLE = ("gear changes", "obstacles on the map")  # columns of whole numbers
COLUMNS = ("duration [s]", "start to goal [m]", "length of the path [m]", "gear changes", "cost J", WHOLE[1])

Numbers = dict[str, np.ndarray]  # by column, a number for every kept trajectory: (S,) each

TEXT = """\
# Verified trajectories on random maps

![distributions](datasheet.png)

## How it was made

`python -m drake_gnnocp.dataset` draws maps and pairs of start and goal from one seed (`settings.json`): two of
three of the first {paper_maps} maps are open ones with rectangles and irregular polygons on 40 m x 40 m, as in
the paper; the third, and every map from there to number {last_wide}, is a car park or a yard, half of these
with a car of other size and limits. The maps after them are tight places for cars, trucks and robots, among
parked cars, walls and lines.

Every task is searched by Hybrid A*, and where the path changes gear a second time with dear changes. The path
of fewest changes is given a minimum-effort timing with {slack:g} times the duration of its speed plan,
optimised on {knots} knots (where that fails, as tight paths are), and kept if the independent dense check has
verified the plan. Time limits are {search_seconds:g} s for a search and {solve_seconds:g} s for the solver, so
which tasks fail depends a little on the machine ({machine}). Labels of maps up to number {last_wide} are older:
of the first path found, optimised for the paper's cost.
{improvement}
## What is in it

{maps} maps, {tasks} tasks, **{kept} verified trajectories**, {megabytes:.1f} MB. Maps, never samples, are split: of ten
consecutive maps eight are for training, one for validation, one for the test.

{outcomes}
{distributions}
Format: see `drake_gnnocp/experiments/dataset/records.py`; `load_dataset` in `generate.py` beside it reads it. States
and inputs are float32. Mirrored and reversed in time, every trajectory is again a solution: training uses both.
"""
IMPROVEMENT = """
Then `--improve` solved tasks again from a network's hypotheses: {labels} labels on {maps} maps, numbers {first} to
{last}, are of cheaper plans of the same duration, or of tasks that Hybrid A* had not solved.
"""


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
            float(np.hypot(*(task.goal - task.start)[:2])),  # as the crow flies
            trajectory.path_length,
            trajectory.gear_changes,
            label.cost,
            len(record.place.obstacles),
        )
        for record in records
        for task, label in zip(record.tasks, record.labels, strict=True)
        if (trajectory := label.trajectory) is not None
    ]
    return dict(zip(COLUMNS, np.array(rows, dtype=float).reshape(-1, len(COLUMNS)).T, strict=True))


def datasheet(records: Sequence[MapRecord], numbers: Numbers, size: int) -> str:
    """The datasheet as Markdown; size of all files [bytes]."""
    kinds = [kind for kind in KINDS if any(record.place.kind == kind for record in records)]
    groups = {kind: [record for record in records if record.place.kind == kind] for kind in kinds}
    for split in SPLITS:
        groups |= {f"{split}: {kind}": [record for record in groups[kind] if record.split == split] for kind in kinds}
    groups["**all**"] = list(records)
    percentiles = {name: np.percentile(values, [5, 50, 95]) for name, values in numbers.items() if len(values)}
    return TEXT.format(
        paper_maps=PAPER_MAPS,
        last_wide=WIDE_MAPS - 1,
        knots=PLAN.knots,
        slack=PLAN.slack,
        search_seconds=SEARCH_SECONDS,
        solve_seconds=SOLVE_SECONDS,
        machine=platform.machine(),
        improvement=_improvement(records),
        maps=len(records),
        tasks=sum(len(record.labels) for record in records),
        kept=sum(len(record.trajectories) for record in records),
        megabytes=size / 1e6,
        outcomes=markdown_table(("maps", "number", "tasks", *OUTCOMES), [_row(*group) for group in groups.items()]),
        distributions=markdown_table(
            ("of a kept trajectory", "5 %", "median", "95 %"),
            [(name, *(f"{value:.3g}" for value in values)) for name, values in percentiles.items()],
        ),
    )


def _improvement(records: Sequence[MapRecord]) -> str:
    improved = [record.index for record in records for label in record.labels if label.source == LEARNED]
    if not improved:
        return ""
    maps = len(set(improved))
    return IMPROVEMENT.format(labels=len(improved), maps=maps, first=min(improved), last=max(improved))


def _row(name: str, records: list[MapRecord]) -> tuple[str, ...]:
    counts = Counter(label.outcome for record in records for label in record.labels)
    tasks = counts.total()
    cells = [f"{counts[outcome]} ({counts[outcome] / max(tasks, 1):.1%})" for outcome in OUTCOMES]
    return name, str(len(records)), str(tasks), *cells


def draw_distributions(axes: Sequence[Axes], numbers: Numbers) -> Sequence[Axes]:
    """Histograms of what the datasheet's second table lists, on six axes."""
    for ax, (name, values) in zip(axes, numbers.items(), strict=True):
        style.dress(ax)
        top = float(np.percentile(values, 99)) if len(values) else 1.0
        bins = np.arange(-0.5, top + 1.5) if name in WHOLE else np.linspace(0.0, max(top, 1e-9), BINS)
        ax.hist(values.clip(max=top), bins=bins.tolist(), color=style.PLAN)
        ax.set_xlabel(name, fontsize=style.LABEL_SIZE)
    return axes
