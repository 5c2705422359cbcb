"""What all reports share: percentiles and ratios of runs, and tables for readers (Markdown) and for programs (CSV)."""

from __future__ import annotations

import os
import platform
import re
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from drake_gnnocp.experiments.benchmark.paper_table import PAPER
from drake_gnnocp.experiments.benchmark.runs import KEY
from drake_gnnocp.files import write_atomically

CPU_INFO = Path("/proc/cpuinfo")  # Linux: elsewhere the machine's own word for its processor has to do
PACKAGES = ("drake", "torch", "ompl", "numpy")  # whose versions are named
SPREAD = {"median": 0.5, "p95": 0.95}
SHORT, LONG = r"<(\w+):(\d)>", r"{\1_median:.\2f} / {\1_p95:.\2f}"
SECONDS = ["planning_s", "optimisation_s", "total_s"]  # s, as the paper divides them
WORK = ["convex_steps", "first_iterations", "first_steps", "iterations"]
DISPARITY = {  # the paper's four bars: the columns of the runs and of the reports
    "disparity_position": "disparity_position_m",
    "disparity_theta": "disparity_theta_rad",
    "disparity_v": "disparity_v_m_per_s",
    "disparity_phi": "disparity_phi_rad",
}
DISPARITY_COLUMNS = """position m: {disparity_position_m:.2f} | theta rad: {disparity_theta_rad:.2f} |
    v m/s: {disparity_v_m_per_s:.2f} | phi rad: {disparity_phi_rad:.2f}"""
DISPARITY_NOTE = """\
Cumulated distance of the guess that the solver started from and the optimum it led to, over 120 equal steps of their
durations: the four bars of the paper. Medians over the plans that the method's own guess led to.
"""


@dataclass(frozen=True)
class Report:
    """What is written: Markdown, and rows for programs."""

    markdown: str
    rows: pd.DataFrame

    @property
    def csv(self) -> str:
        """All columns of the rows: 5 digits, empty where there is no number."""
        return self.rows.to_csv(index=False, float_format="%.5g")

    def save(self, folder: Path, name: str) -> None:
        """Write NAME.md and NAME.csv into a folder."""
        write_atomically(folder / f"{name}.csv", self.csv)
        write_atomically(folder / f"{name}.md", self.markdown)


class _NoNumber:
    """A number that is missing, a dash in whatever format."""

    def __format__(self, _: str) -> str:
        return "-"


def table(rows: pd.DataFrame, columns: str) -> str:
    """A Markdown table; a dash where there is no number.

    Args:
        rows: to be shown, in order; their index counts as columns.
        columns: HEADER: TEXT | HEADER: TEXT ..., texts as of `str.format`; besides, <NAME:2> is the median / 95th
            percentile of a quantity with 2 digits.
    """
    pairs_of = [column.strip().partition(": ") for column in re.sub(SHORT, LONG, columns).split("|")]
    lines = [[header for header, _, _ in pairs_of], ["---"] * len(pairs_of)]
    for row in rows.reset_index().to_dict("records"):
        cells: dict[Any, Any] = {name: cell if cell == cell else _NoNumber() for name, cell in row.items()}
        made = [text.format(**cells) for _, _, text in pairs_of]
        lines.append(["-" if cell == "- / -" else cell for cell in made])
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


def with_sums(runs: pd.DataFrame) -> pd.DataFrame:
    """Runs with the sums that are reported: of times, and of the steps to the end of the first solve."""
    optimisation = runs.build_s + runs.solve_s
    return runs.assign(
        planning_s=runs.guess_s,
        optimisation_s=optimisation,
        planned_s=runs.guess_s + optimisation,
        first_steps=runs.convex_steps + runs.first_iterations,
    )


def ordered(runs: pd.DataFrame, methods: Sequence[str]) -> pd.DataFrame:
    """Runs with the scenarios as they first appear, and the methods of each in the usual order."""
    places = {name: place for place, name in enumerate(runs.scenario.unique())}
    return runs.iloc[np.lexsort((runs.method.map(methods.index), runs.scenario.map(places)))]


def counts(runs: pd.DataFrame, by: list[str]) -> pd.DataFrame:
    """How many runs of each group were attempted, verified, and not by the guess that their method asks for first."""
    groups = runs.assign(own=runs.verified & ~runs.fallback, solved=runs.rounds > 0).groupby(by, sort=False)
    rows = groups.agg(
        attempted=("verified", "size"),
        verified=("verified", "sum"),
        verified_share=("verified", "mean"),
        solved=("solved", "sum"),
        fallback=("fallback", "sum"),
        own=("own", "sum"),
    )
    return rows.assign(verified_percent=100 * rows.verified_share, own_percent=100 * rows.own / rows.attempted)


def percentiles(rows: pd.DataFrame, by: list[str], names: Sequence[str], shares: dict[str, float]) -> pd.DataFrame:
    """NAME_SHARE, percentiles of some columns in each group: NaN where there is no number."""
    groups = rows.groupby(by, sort=False)[list(names)]
    parts = [groups.quantile(share).add_suffix(f"_{text}") for text, share in shares.items()]
    return pd.concat(parts, axis=1)[[f"{name}_{text}" for name in names for text in shares]]


def medians(rows: pd.DataFrame, by: list[str], names: Sequence[str]) -> pd.DataFrame:
    """Medians of some columns in each group, under their own names."""
    return rows.groupby(by, sort=False)[list(names)].median()


def own_medians(runs: pd.DataFrame, by: list[str], names: Sequence[str]) -> pd.DataFrame:
    """The same, and the paper's disparities, of the plans that the method's own guess led to."""
    own = runs[runs.verified & ~runs.fallback].rename(columns=DISPARITY)
    return medians(own, by, [*names, *DISPARITY.values()])


def pairs(runs: pd.DataFrame, others: pd.DataFrame, names: Sequence[str]) -> pd.DataFrame:
    """Runs beside others on the same scenarios in the same repeats, whose columns end in `_other`.

    NAME_ratio is the one's number over the other's, NaN where the other crashed before it had one.
    """
    found = runs.merge(others, on=[name for name in KEY if name != "method"], suffixes=("", "_other"))
    other = {name: found[f"{name}_other"] for name in names}
    return found.assign(**{f"{name}_ratio": found[name] / other[name].where(other[name] > 0) for name in names})


def paper_rows() -> pd.DataFrame:
    """The seconds that the paper prints, as rows of `scenario`, `kind` and `method`."""
    rows = [("library", name, method, *seconds) for name, row in PAPER.items() for method, seconds in row.items()]
    columns = ["kind", "scenario", "method", "planning_paper_s", "optimisation_paper_s", "total_paper_s"]
    return pd.DataFrame(rows, columns=columns)


def machine(*packages: str) -> str:
    """One line on the processor, its cores, Python and the versions of those packages that are installed."""
    versions = []
    for package in packages:
        try:
            versions.append(f"{package} {metadata.version(package)}")
        except metadata.PackageNotFoundError:
            continue
    python = f"Python {platform.python_version()}"
    return f"{', '.join([python, *versions])}; {_processor()}, {os.cpu_count()} cores.\n"


def _processor() -> str:
    """Model and architecture of the processor."""
    model = platform.processor()
    if CPU_INFO.exists():
        named = [line.partition(":")[2].strip() for line in CPU_INFO.read_text().splitlines() if "model name" in line]
        model = named[0] if named else model
    return " ".join(dict.fromkeys(filter(None, [model, platform.machine()])))
