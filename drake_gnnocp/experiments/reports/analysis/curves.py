"""Curves over the values of a parameter, from its runs; all points of a curve are from the same tasks."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from drake_gnnocp.experiments.benchmark.runs import Run
from drake_gnnocp.experiments.reports.analysis.parameters import Parameter, Point
from drake_gnnocp.experiments.reports.tables.report import (
    SECONDS,
    WORK,
    CellRow,
    cell_spread,
    median,
    number,
    percentile,
)
from drake_gnnocp.experiments.reports.text import table

PERCENTILES = {"median": 50, "p25": 25, "p75": 75, "p95": 95}
NOTES = """\
One thread; all values of a parameter plan the same tasks, on maps that are in no training, one after the other in the
same process. Median / 95th percentile, failures included: iterations and convex steps over the tasks with a *solve*
(where no hypothesis is worth one, there is none), seconds over all. *Clearance* is the median over the verified plans,
*cost* the median ratio to that of the default where both are verified (where the parameter changes the cost itself,
there is none). *gnn_direct* gives the first hypothesis to Ipopt as it is. The default is in bold type.
"""


def curve_rows(parameter: Parameter, runs: Sequence[Run]) -> list[CellRow]:
    """A row a point: what the plans of the tasks took that all of the parameter's points have runs of.

    Args:
        parameter: with the points that can be had here.
        runs: of these and of others.

    Returns:
        No rows where there is no such task.
    """
    of_method: dict[str, dict[tuple[str, str], Run]] = {point.method.name: {} for point in parameter.points}
    for run in runs:
        if run.method in of_method:
            of_method[run.method][run.scenario, run.kind] = run
    tasks = set.intersection(*(set(each) for each in of_method.values())) if of_method else set()
    if not tasks:
        return []
    chosen = {name: [each[task] for task in sorted(tasks)] for name, each in of_method.items()}
    return [_row(parameter, point, chosen) for point in parameter.points]


def _row(parameter: Parameter, point: Point, chosen: dict[str, list[Run]]) -> CellRow:
    runs = chosen[point.method.name]
    verified, solved = [run for run in runs if run.verified], [run for run in runs if run.rounds]
    row: CellRow = {"parameter": parameter.name, "value": point.value, "guess": point.series}
    row["method"] = point.method.name
    row["tasks"], row["verified"] = len(runs), len(verified)
    row["verified_share"] = float(np.mean([run.verified for run in runs]))
    row["solved"] = len(solved)
    for name, value in WORK.items():
        row |= _percentiles(name, [value(run) for run in solved])
    for name, value in SECONDS.items():
        row |= _percentiles(f"{name}_s", [value(run) for run in runs])
    row["clearance_m_median"] = median(verified, lambda run: run.clearance_m)
    row["cost_ratio_median"] = math.nan if parameter.changes_cost else _cost_ratio(parameter, point, chosen)
    return row


def _percentiles(name: str, values: Sequence[float]) -> CellRow:
    return {f"{name}_{text}": percentile(values, p) for text, p in PERCENTILES.items()}


def _cost_ratio(parameter: Parameter, point: Point, chosen: dict[str, list[Run]]) -> float:
    """Median of J over that of the default value on the same curve."""
    usual = [
        each.method.name for each in parameter.points if each.value == parameter.default and each.series == point.series
    ]
    pairs = [pair for name in usual for pair in zip(chosen[point.method.name], chosen[name], strict=True)]
    return percentile([one.cost / other.cost for one, other in pairs if one.verified and other.verified], 50)


def summary(curves: dict[str, tuple[Parameter, list[CellRow]]], on: str) -> str:
    """All curves as Markdown tables; `on` is a line on the machine."""
    parts = ["# What the parameters are worth\n", NOTES, on]
    for parameter, rows in curves.values():
        parts.append(f"## `{parameter.name}`: {parameter.label}\n\n{rows[0]['tasks']} tasks.\n")
        parts.append(_table(parameter, rows))
    return "\n".join(parts)


def _table(parameter: Parameter, rows: Sequence[CellRow]) -> str:
    header = [parameter.name, "guess", "verified", "with a solve", "Ipopt's iterations", "convex steps"]
    header += [*(f"{name} s" for name in SECONDS), "clearance m", "cost"]
    lines = []
    for row in rows:
        value = number(row["value"], 2).rstrip("0").rstrip(".")
        usual = row["value"] == parameter.default
        spreads = [cell_spread(row, "iterations", 0), cell_spread(row, "convex_steps", 0)]
        spreads += [cell_spread(row, f"{name}_s", 2) for name in SECONDS]
        lines.append(
            [
                f"**{value}**" if usual else value,
                str(row["guess"]),
                f"{row['verified']} ({100 * float(row['verified_share']):.0f} %)",
                str(row["solved"]),
                *spreads,
                number(row["clearance_m_median"], 2),
                number(row["cost_ratio_median"], 2),
            ]
        )
    return table(header, lines)
