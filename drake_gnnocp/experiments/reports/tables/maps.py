"""The paper's table "Performance Comparison" on its four maps, with its own numbers beside ours.

Its seconds are of another machine and of maps that are only like ours, so what is compared are ratios to GNN-OCP: of
runs that were made one after the other by the same process, and of the paper's numbers of the same map.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from drake_gnnocp.experiments.benchmark.methods import GNN
from drake_gnnocp.experiments.benchmark.paper_table import PAPER
from drake_gnnocp.experiments.benchmark.runs import Run
from drake_gnnocp.experiments.benchmark.summary import grouped, ratios
from drake_gnnocp.experiments.reports.tables.report import (
    DISPARITY,
    DISPARITY_NOTE,
    SECONDS,
    WORK,
    CellRow,
    Report,
    median,
    number,
    percentile,
    quotients,
    report,
)
from drake_gnnocp.experiments.reports.text import table

MAPS = tuple(PAPER)
TITLE = "# The paper's performance comparison\n"
NOTE = """\
Medians over the repeats, failures included. *Planning* makes the guess (the network's includes the convex steps of
hypotheses that were passed over); *optimisation* builds and solves the programs of all attempts; *total* adds the
verifications. *Paper*: what it prints, from its own machine and maps: compare the ratios. *Verified* is the independent
dense check, which the paper does not have.
"""
RATIO_NOTE = "The method's time over that of GNN-OCP in the same repeat; beside it the same of the paper's numbers.\n"


def map_report(runs: Sequence[Run], on: str) -> Report:
    """The comparison of runs on bundled maps.

    Args:
        runs: of several methods.
        on: a line on the machine.
    """
    groups = grouped(runs, lambda run: (run.scenario, run.method))
    rows = [_row(scenario, method, group, runs) for (scenario, method), group in groups]
    sections = [TITLE, NOTE, on, _seconds_table(rows), "## Ratios to GNN-OCP\n", RATIO_NOTE, _ratio_table(rows)]
    sections += ["## Guess and optimum\n", DISPARITY_NOTE, _disparity_table(rows)]
    return report(sections, rows)


def _row(scenario: str, method: str, group: Sequence[Run], runs: Sequence[Run]) -> CellRow:
    printed = PAPER.get(scenario, {})
    pairs = ratios([run for run in runs if run.scenario == scenario], method, GNN)
    row: CellRow = {"scenario": scenario, "method": method, "runs": len(group)}
    row["verified"] = sum(run.verified for run in group)
    for i, (name, value) in enumerate(SECONDS.items()):
        row[f"{name}_s"] = median(group, value)
        row[f"{name}_paper_s"] = printed[method][i] if method in printed else math.nan
        row[f"{name}_ratio"] = percentile(quotients(pairs, value), 50)
        row[f"{name}_paper_ratio"] = printed[method][i] / printed[GNN][i] if method in printed else math.nan
    solved = [run for run in group if run.verified and not run.fallback]
    row |= {name: median(group, value) for name, value in WORK.items()}
    row["cost"] = median(solved, lambda run: run.cost)
    return row | {name: median(solved, value) for name, value in DISPARITY.items()}


def _seconds_table(rows: Sequence[CellRow]) -> str:
    header = ["map", "method", *(cell for name in SECONDS for cell in (f"{name} s", "paper"))]
    header += ["verified", "convex steps", "iterations", "cost J"]
    lines = []
    for row in rows:
        seconds = [number(row[f"{name}_{of}"], 3) for name in SECONDS for of in ("s", "paper_s")]
        work = [number(row["convex_steps"], 0), number(row["iterations"], 0), number(row["cost"], 2)]
        lines.append([*_names(row), *seconds, f"{row['verified']}/{row['runs']}", *work])
    return table(header, lines)


def _ratio_table(rows: Sequence[CellRow]) -> str:
    header = ["map", "method", *(cell for name in SECONDS for cell in (name, "paper"))]
    of = ("ratio", "paper_ratio")
    return table(
        header, [[*_names(row), *(number(row[f"{name}_{each}"], 2) for name in SECONDS for each in of)] for row in rows]
    )


def _disparity_table(rows: Sequence[CellRow]) -> str:
    header = ["map", "method", "position m", "theta rad", "v m/s", "phi rad"]
    return table(header, [[*_names(row), *(number(row[name], 2) for name in DISPARITY)] for row in rows])


def _names(row: CellRow) -> list[str]:
    return [str(row["scenario"]), str(row["method"])]
