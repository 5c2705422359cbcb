"""The methods on tasks of maps that no network was trained on.

What share they solve, and how they compare task by task: ratios are the method's number over that of the network (gnn)
on the same task, in the same process.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drake_gnnocp.experiments.benchmark.methods import GNN
from drake_gnnocp.experiments.benchmark.runs import Run
from drake_gnnocp.experiments.benchmark.summary import grouped, ratios
from drake_gnnocp.experiments.reports.tables.report import (
    DISPARITY,
    DISPARITY_NOTE,
    SECONDS,
    WORK,
    CellRow,
    Report,
    Value,
    cell_spread,
    median,
    number,
    percentile,
    quotients,
    report,
)
from drake_gnnocp.experiments.reports.text import table

TITLE = "# The methods on {n} tasks of maps that are in no training\n"
NOTE = """\
Median / 95th percentile, failures included: iterations and convex steps over the tasks with a *solve* (where no
hypothesis is worth one, there is none), *both* their sum, seconds over all; cost J and clearance over the verified
plans. *Planning* of the network includes the convex steps of hypotheses that were passed over. The methods ending in
*direct* give their first guess to Ipopt as it is, without convex steps, and make one attempt: what the guess is worth
to Ipopt alone.
"""
RATIO_NOTE = """\
The method over gnn, task by task: median (5th to 95th percentile). Of all tasks first, then of those that both solved.
"""


def cost(run: Run) -> float:
    """J of the paper."""
    return run.cost


def unseen_report(runs: Sequence[Run], on: str) -> Report:
    """The comparison of runs on unseen tasks.

    Args:
        runs: of several methods.
        on: a line on the machine.
    """
    rows = [_row(method, group, runs) for method, group in grouped(runs, lambda run: run.method)]
    n = len({run.scenario for run in runs})
    sections = [TITLE.format(n=n), NOTE, on, _work_table(rows), "## Ratios to gnn\n", RATIO_NOTE, _ratio_table(rows)]
    return report([*sections, "## Guess and optimum\n", DISPARITY_NOTE, _disparity_table(rows)], rows)


def _row(method: str, group: Sequence[Run], runs: Sequence[Run]) -> CellRow:
    own = [run for run in group if run.verified and not run.fallback]
    solved = [run for run in group if run.rounds]
    row: CellRow = {"method": method, "attempted": len(group), "verified": sum(run.verified for run in group)}
    row["verified_share"] = float(np.mean([run.verified for run in group]))
    row["solved"] = len(solved)
    for name, value in WORK.items():
        row |= _spread_cells(name, [value(run) for run in solved])
    for name, value in SECONDS.items():
        row |= _spread_cells(f"{name}_s", [value(run) for run in group])
    row["cost_median"] = median(own, cost)
    row["clearance_m_median"] = median(own, lambda run: run.clearance_m)
    pairs = ratios(runs, method, GNN)
    both = [(a, b) for a, b in pairs if a.verified and b.verified]
    for kept, chosen in (("all", pairs), ("both", both)):
        row[f"{kept}_pairs"] = len(chosen)
        for name, value in SECONDS.items():
            row |= _ratio_cells(f"{kept}_{name}", chosen, value)
    row |= _ratio_cells("both_cost", both, cost)
    row["compared"] = len(own)
    return row | {name: median(own, value) for name, value in DISPARITY.items()}


def _spread_cells(name: str, values: Sequence[float]) -> CellRow:
    return {f"{name}_median": percentile(values, 50), f"{name}_p95": percentile(values, 95)}


def _ratio_cells(name: str, pairs: Sequence[tuple[Run, Run]], value: Value) -> CellRow:
    found = quotients(pairs, value)
    return {f"{name}_ratio_{text}": percentile(found, p) for text, p in (("median", 50), ("p5", 5), ("p95", 95))}


def _work_table(rows: Sequence[CellRow]) -> str:
    header = ["method", "attempted", "verified", "with a solve", "convex steps"]
    header += [
        "first solve, iterations",
        "both",
        "all iterations",
        *(f"{name} s" for name in SECONDS),
        "cost J",
        "clearance m",
    ]
    lines = []
    for row in rows:
        share = f"{row['verified']} ({100 * float(row['verified_share']):.1f} %)"
        work = [cell_spread(row, name, 0) for name in WORK] + [cell_spread(row, f"{name}_s", 2) for name in SECONDS]
        quality = [number(row["cost_median"], 2), number(row["clearance_m_median"], 2)]
        lines.append([str(row["method"]), str(row["attempted"]), share, str(row["solved"]), *work, *quality])
    return table(header, lines)


def _ratio_table(rows: Sequence[CellRow]) -> str:
    header = ["method", "tasks", *SECONDS, "solved by both", *SECONDS, "cost J"]
    lines = []
    for row in rows:
        cells = [str(row["method"])]
        for kept, names in (("all", [*SECONDS]), ("both", [*SECONDS, "cost"])):
            cells += [str(row[f"{kept}_pairs"]), *(_ratio(row, f"{kept}_{name}") for name in names)]
        lines.append(cells)
    return table(header, lines)


def _disparity_table(rows: Sequence[CellRow]) -> str:
    header = ["method", "n", "position m", "theta rad", "v m/s", "phi rad"]
    names = ("method", "compared")
    lines = [[*(str(row[name]) for name in names), *(number(row[name], 2) for name in DISPARITY)] for row in rows]
    return table(header, lines)


def _ratio(row: CellRow, name: str) -> str:
    middle, low, high = (number(row[f"{name}_ratio_{text}"], 2) for text in ("median", "p5", "p95"))
    return f"{middle} ({low} to {high})"
