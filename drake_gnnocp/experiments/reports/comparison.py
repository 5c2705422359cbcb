"""The paper's table "Performance Comparison" on its four maps, and the same methods on tasks of unseen maps.

The paper's seconds are of another machine and of maps that are only like ours, so what is compared are ratios to
GNN-OCP: of runs that were made one after the other by the same process, and of the paper's numbers of the same map.
"""

from __future__ import annotations

import pandas as pd

from drake_gnnocp.experiments.benchmark.methods import GNN, PLANNERS
from drake_gnnocp.experiments.benchmark.paper_table import PAPER
from drake_gnnocp.experiments.reports import report
from drake_gnnocp.experiments.reports.report import DISPARITY, DISPARITY_COLUMNS, SECONDS, WORK, Report

MAPS = tuple(PAPER)
PARTS = [name.removesuffix("_s") for name in SECONDS]
RANGE = {"median": 0.5, "p5": 0.05, "p95": 0.95}

MAP_TITLE = "# The paper's performance comparison\n"
MAP_NOTE = """\
Medians over the repeats, failures included. *Planning* makes the guess (the network's includes the SQP steps of
hypotheses that were passed over); *optimisation* builds and solves the programs of all attempts; *total* adds the
verifications. *Paper*: what it prints, from its own machine and maps: compare the ratios. *Verified* is the independent
dense check, which the paper does not have.
"""
MAP_RATIO_NOTE = """\
The method's time over that of GNN-OCP in the same repeat; beside it the same of the paper's numbers.
"""
MAP_NAMES = "map: {scenario} | method: {method}"
MAP_SECONDS = " | ".join(f"{part} s: {{{part}_s:.3f}} | paper: {{{part}_paper_s:.3f}}" for part in PARTS)
MAP_COLUMNS = f"""{MAP_NAMES} | {MAP_SECONDS} | verified: {{verified}}/{{runs}} | SQP steps: {{convex_steps:.0f}} |
    iterations: {{iterations:.0f}} | cost J: {{cost:.2f}}"""
MAP_RATIOS = " | ".join(f"{part}: {{{part}_ratio:.2f}} | paper: {{{part}_paper_ratio:.2f}}" for part in PARTS)

UNSEEN_TITLE = "# The methods on {n} tasks of maps that are in no training\n"
UNSEEN_NOTE = """\
Median / 95th percentile, failures included: iterations and SQP steps over the tasks with a *solve* (where no
hypothesis is worth one, there is none), *both* their sum, seconds over all; cost J and clearance over the verified
plans. *Planning* of the network includes the SQP steps of hypotheses that were passed over. The methods ending in
*direct* give their first guess to Ipopt as it is, without SQP steps, and make one attempt: what the guess is worth
to Ipopt alone.
"""
UNSEEN_RATIO_NOTE = """\
The method over gnn, task by task: median (5th to 95th percentile). Of all tasks first, then of those that both solved.
"""
UNSEEN_COLUMNS = """method: {method} | attempted: {attempted} | verified: {verified} ({verified_percent:.1f} %) |
    with a solve: {solved} | SQP steps: <convex_steps:0> | first solve, iterations: <first_iterations:0> |
    both: <first_steps:0> | all iterations: <iterations:0> | planning s: <planning_s:2> |
    optimisation s: <optimisation_s:2> | total s: <total_s:2> | cost J: {cost_median:.2f} |
    clearance m: {clearance_m_median:.2f}"""
RATIO = "{{{0}_ratio_median:.2f}} ({{{0}_ratio_p5:.2f}} to {{{0}_ratio_p95:.2f}})"
RATIOS_OF = {
    kept: " | ".join(f"{part}: {RATIO.format(f'{kept}_{part}')}" for part in PARTS) for kept in ("all", "both")
}
UNSEEN_RATIOS = f"""method: {{method}} | tasks: {{all_pairs}} | {RATIOS_OF["all"]} |
    solved by both: {{both_pairs}} | {RATIOS_OF["both"]} | cost J: {RATIO.format("both_cost")}"""


def map_report(runs: pd.DataFrame, on: str) -> Report:
    """The comparison of runs of several methods on bundled maps; `on` is a line on the machine."""
    runs, by = report.with_sums(report.ordered(runs, PLANNERS)), ["scenario", "kind", "method"]
    ratios = report.medians(_over_network(runs), by, [f"{part}_ratio" for part in PARTS])
    numbers = [report.medians(runs, by, [*SECONDS, *WORK]), report.own_medians(runs, by, ["cost"])]
    rows = report.counts(runs, by).rename(columns={"attempted": "runs"}).join([*numbers, ratios]).reset_index()
    rows = rows.merge(_paper(), how="left", on=by)
    of_part = [f"{part}_{of}" for part in PARTS for of in ("s", "paper_s", "ratio", "paper_ratio")]
    rows = rows[["scenario", "method", "runs", "verified", *of_part, *WORK, "cost", *DISPARITY.values()]]
    sections = [MAP_TITLE, MAP_NOTE, on, report.table(rows, MAP_COLUMNS), "## Ratios to GNN-OCP\n", MAP_RATIO_NOTE]
    sections.append(report.table(rows, f"{MAP_NAMES} | {MAP_RATIOS}"))
    return Report("\n".join([*sections, *_disparities(rows, MAP_NAMES)]), rows)


def unseen_report(runs: pd.DataFrame, on: str) -> Report:
    """The comparison of runs of several methods on unseen tasks; `on` is a line on the machine."""
    runs, by = report.with_sums(report.ordered(runs, PLANNERS)), ["method"]
    own = report.own_medians(runs, by, ["cost", "clearance_m"])
    own = own.rename(columns={"cost": "cost_median", "clearance_m": "clearance_m_median"})
    found = _over_network(runs)
    parts = [
        report.percentiles(runs[runs.rounds > 0], by, WORK, report.SPREAD),
        report.percentiles(runs, by, SECONDS, report.SPREAD),
        own[["cost_median", "clearance_m_median"]],
        _ratios("all", found, PARTS),
        _ratios("both", found[found.verified & found.verified_other], [*PARTS, "cost"]),
    ]
    rows = report.counts(runs, by).join(parts)
    rows = rows.assign(compared=rows.own).join(own[list(DISPARITY.values())])
    rows = rows.fillna({"all_pairs": 0, "both_pairs": 0}).astype({"all_pairs": int, "both_pairs": int})
    sections = [UNSEEN_TITLE.format(n=runs.scenario.nunique()), UNSEEN_NOTE, on, report.table(rows, UNSEEN_COLUMNS)]
    sections += ["## Ratios to gnn\n", UNSEEN_RATIO_NOTE, report.table(rows, UNSEEN_RATIOS)]
    markdown = "\n".join([*sections, *_disparities(rows, "method: {method} | n: {compared}")])
    shown_only = ["fallback", "own", "verified_percent", "own_percent"]
    return Report(markdown, rows.drop(columns=shown_only).reset_index())


def _disparities(rows: pd.DataFrame, names: str) -> list[str]:
    table = report.table(rows, f"{names} | {DISPARITY_COLUMNS}")
    return ["## Guess and optimum\n", report.DISPARITY_NOTE, table]


def _over_network(runs: pd.DataFrame) -> pd.DataFrame:
    """All runs beside those of the network, with the ratios of the seconds and of the cost."""
    found = report.pairs(runs, runs[runs.method == GNN], [*SECONDS, "cost"])
    return found.rename(columns={f"{part}_s_ratio": f"{part}_ratio" for part in PARTS})


def _ratios(kept: str, found: pd.DataFrame, names: list[str]) -> pd.DataFrame:
    """How many pairs there are of each method, and the percentiles of the ratios."""
    spreads = report.percentiles(found, ["method"], [f"{name}_ratio" for name in names], RANGE)
    return pd.concat([found.groupby("method").size().rename("pairs"), spreads], axis=1).add_prefix(f"{kept}_")


def _paper() -> pd.DataFrame:
    """The paper's seconds, and their ratios to those of its GNN-OCP on the same map."""
    rows = report.paper_rows()
    network = rows[rows.method == GNN].set_index("scenario")
    of_network = {part: rows.scenario.map(network[f"{part}_paper_s"]) for part in PARTS}
    return rows.assign(**{f"{part}_paper_ratio": rows[f"{part}_paper_s"] / of_network[part] for part in PARTS})
