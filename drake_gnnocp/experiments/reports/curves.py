"""Curves over the values of a parameter, from its runs; all points of a curve are from the same tasks."""

from __future__ import annotations

import math

import pandas as pd

from drake_gnnocp.experiments.reports import report
from drake_gnnocp.experiments.reports.parameters import Parameter
from drake_gnnocp.experiments.reports.report import SECONDS, WORK

SHARES = {"median": 0.5, "p25": 0.25, "p75": 0.75, "p95": 0.95}
NOTES = """\
One thread; all values of a parameter plan the same tasks, on maps that are in no training, one after the other in the
same process. Median / 95th percentile, failures included: iterations and SQP steps over the tasks with a *solve*
(where no hypothesis is worth one, there is none), seconds over all. *Clearance* is the median over the verified plans,
*cost* the median ratio to that of the default where both are verified (where the parameter changes the cost itself,
there is none). *gnn_direct* gives the first hypothesis to Ipopt as it is. The default is in bold type.
"""
COLUMNS = """{name}: {{shown}} | guess: {{guess}} | verified: {{verified}} ({{verified_percent:.0f}} %) |
    with a solve: {{solved}} | Ipopt's iterations: <iterations:0> | SQP steps: <convex_steps:0> |
    planning s: <planning_s:2> | optimisation s: <optimisation_s:2> | total s: <total_s:2> |
    clearance m: {{clearance_m_median:.2f}} | cost: {{cost_ratio_median:.2f}}"""


def curve_rows(parameter: Parameter, runs: pd.DataFrame) -> pd.DataFrame:
    """A row a point: what the plans of the tasks took that all of the parameter's points have runs of.

    Args:
        parameter: with the points that can be had here.
        runs: of these and of others.

    Returns:
        No rows where there is no such task.
    """
    listed = [(parameter.name, point.value, point.series, point.method.name) for point in parameter.points]
    points = pd.DataFrame(listed, columns=["parameter", "value", "guess", "method"])
    runs = report.with_sums(runs[runs.method.isin(points.method)])
    methods_of_task = runs.groupby(["scenario", "kind"]).method.transform("nunique")
    runs = runs[methods_of_task == points.method.nunique()]
    if runs.empty:
        return points.iloc[:0]
    by, verified = ["method"], runs[runs.verified]
    parts = [
        report.percentiles(runs[runs.rounds > 0], by, WORK, SHARES),
        report.percentiles(runs, by, SECONDS, SHARES),
        report.medians(verified, by, ["clearance_m"]).add_suffix("_median"),
    ]
    counts = report.counts(runs, by).rename(columns={"attempted": "tasks"})
    rows = points.join(counts[["tasks", "verified", "verified_share", "solved"]].join(parts), on="method")
    ratios = math.nan if parameter.changes_cost else _cost_ratios(parameter, points, verified)
    return rows.assign(cost_ratio_median=ratios)


def _cost_ratios(parameter: Parameter, points: pd.DataFrame, verified: pd.DataFrame) -> list[float]:
    """For every point the median of J over that of the default value on the same curve."""
    usual = points[points.value == parameter.default].set_index("guess").method
    ratios = []
    for point in points.itertuples():
        of_default = verified[verified.method == usual.get(point.guess)]
        found = report.pairs(verified[verified.method == point.method], of_default, ["cost"])
        ratios.append(found.cost_ratio.median())
    return ratios


def summary(curves: dict[str, tuple[Parameter, pd.DataFrame]], on: str) -> str:
    """All curves as Markdown tables; `on` is a line on the machine."""
    parts = ["# What the parameters are worth\n", NOTES, on]
    for parameter, rows in curves.values():
        values = [f"{value:.2f}".rstrip("0").rstrip(".") for value in rows.value]
        marks = ["**" if value == parameter.default else "" for value in rows.value]
        shown = [f"{mark}{value}{mark}" for value, mark in zip(values, marks, strict=True)]
        parts.append(f"## `{parameter.name}`: {parameter.label}\n\n{rows.tasks.iloc[0]} tasks.\n")
        rows = rows.assign(shown=shown, verified_percent=100 * rows.verified_share)
        parts.append(report.table(rows, COLUMNS.format(name=parameter.name)))
    return "\n".join(parts)
