"""Compare methods of planning from the command line: `python -m drake_gnnocp.benchmark [SCENARIO ...]`.

Every number of the summary is computed from the runs of the folder, failures counted.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import pandas as pd

from drake_gnnocp.console import OneLineParser, count, positive, reported
from drake_gnnocp.drake_log import log_to_stderr
from drake_gnnocp.experiments.benchmark.methods import (
    AUTO,
    GNN,
    GNN_PAPER,
    HYBRID_ASTAR,
    PLANNERS,
    RRT_STAR,
    check_methods,
)
from drake_gnnocp.experiments.benchmark.planning import Settings, planning_engine, planning_jobs
from drake_gnnocp.experiments.benchmark.tasks import (
    DATASET,
    NAMED,
    TEST_MAPS,
    TIGHT_TEST_MAPS,
    Task,
    drawn_tasks,
    named_tasks,
    tight_tasks,
)
from drake_gnnocp.experiments.options import add_budget, add_out, measuring_parser
from drake_gnnocp.experiments.reports import report
from drake_gnnocp.files import locked, write_atomically

DEFAULTS = Settings()
NOTES = """\
One thread a process. *Guess*, *build* and *solve* sum up all attempts of a plan; *total* is the wall time of the whole
call, with the verifications between the solves. *Verified* is the independent dense check; *fallback* is a plan that
came from another guess than the one its method asks for first. Failures are in all numbers except costs and changes of
gear (a mean).
"""
GUESS_NOTE = """\
Cumulated over the knots, the guess that the solver started from against its optimum; the share of its
knots at which it touches an obstacle; its mean error of the kinematic model from knot to knot. Medians over
the n verified plans without fallback.
"""
NAMED_COLUMNS = """scenario: {scenario} | method: {method} |
    planning s: {planning_s:.3f} | paper: {planning_paper_s:.3f} |
    optimisation s: {optimisation_s:.3f} | paper: {optimisation_paper_s:.3f} |
    total s: {total_s:.3f} | paper: {total_paper_s:.3f} | verified: {verified}/{attempted} | fallback: {fallback} |
    first solve, iterations: {first_iterations:.0f} | all iterations: {iterations:.0f} |
    cost J: {cost:.2f} | clearance m: {clearance_m:.2f}"""
SET_COLUMNS = """maps: {maps} | method: {method} | attempted: {attempted} |
    verified: {verified} ({verified_percent:.0f} %) | without fallback: {own} ({own_percent:.0f} %) |
    guess s: <guess_s:2> | build s: <build_s:2> | solve s: <solve_s:2> | total s: <total_s:2> |
    guess + build + solve s: <planned_s:2> | SQP steps: <convex_steps:0> |
    first solve, iterations: <first_iterations:0> | all iterations: <iterations:0> | cost J: {cost:.2f} |
    changes of gear: {gear_changes:.2f}"""
SPREAD_OF = ["guess_s", "build_s", "solve_s", "total_s", "planned_s", "convex_steps", "first_iterations", "iterations"]
RATIOS = [(method, other) for method in (GNN, AUTO, GNN_PAPER) for other in (HYBRID_ASTAR, RRT_STAR)]
RATIO_COLUMNS = """maps: {maps} | methods: {method} / {method_other} | n: {n} |
    guess + build + solve: {planned_s_ratio:.2f} | total: {total_s_ratio:.2f} | iterations: {iterations_ratio:.2f} |
    both verified: {both} | guess + build + solve: {both_planned_s_ratio:.2f} | total: {both_total_s_ratio:.2f} |
    cost: {both_cost_ratio:.2f}"""
GUESS_COLUMNS = f"""scenario: {{scenario}} | method: {{method}} | n: {{own}} | {report.DISPARITY_COLUMNS} |
    knots blocked: {{guess_blocked:.2f}} | gap m: {{guess_gap_m:.2f}}"""


def _parser() -> OneLineParser:
    parser = measuring_parser(
        "benchmark",
        "Plan scenarios with several methods, one thread each, and compare: runs.csv has a row a run, summary.md the "
        "tables. What is there is not run again; choose another --out when the code has changed.",
    )
    add = parser.add_argument
    add("scenarios", nargs="*", metavar="SCENARIO", help="a bundled name, a .json or a TPCAP .csv file")
    most = len(TEST_MAPS) * DATASET.pairs
    tasks = f"and the first N of {most} random tasks on {len(TEST_MAPS)} maps that are in no training (default: 0)"
    add("--tasks", type=count, default=0, metavar="N", help=tasks)
    most = len(TIGHT_TEST_MAPS) * DATASET.tight_pairs
    tight = f"and the first N of {most} in tight places, with cars, robots and trucks (default: 0)"
    add("--tight", type=count, default=0, metavar="N", help=tight)
    names = f"some of {', '.join(PLANNERS)} (default: all)"
    add("--methods", nargs="+", choices=PLANNERS, default=list(PLANNERS), metavar="METHOD", help=names)
    add("--repeat", type=positive, default=1, metavar="N", help="times that each is run (default: %(default)s)")
    add("--jobs", type=positive, default=1, metavar="N", help="processes; more than 1 blur timings (default: 1)")
    add_budget(parser, DEFAULTS.max_seconds, "budget of one plan")
    add("--seed", type=count, default=DEFAULTS.seed, metavar="N", help="seed of RRT* (default: %(default)s)")
    add("--weights", type=Path, metavar="FILE", help="weights of gnn, gnn_direct and auto (default: the package's)")
    add_out(parser, "benchmark")
    return parser


def main(argv: list[str] | None = None) -> int:
    """Parse the arguments, run what is missing and write the summary; returns the exit code."""
    given = _parser().parse_args(argv)
    log_to_stderr()
    settings, methods = Settings(given.max_seconds, given.seed, given.weights), list(dict.fromkeys(given.methods))
    tasks = drawn_tasks(given.tasks) + tight_tasks(given.tight)
    texts = run(given.scenarios, tasks, methods, given.repeat, given.jobs, settings, given.out)
    return reported(texts, given.out)


def run(
    scenarios: list[str],
    drawn: list[Task],
    names: Sequence[str],
    repeats: int,
    jobs: int,
    settings: Settings,
    folder: Path,
) -> Iterator[str]:
    """Run methods on named scenarios and drawn tasks, in `jobs` processes; yields the summary."""
    if not scenarios and not drawn:
        raise ValueError("SCENARIO, --tasks or --tight: nothing to plan; try map_a map_b map_c map_d --tasks 20")
    methods, tasks = settings.methods(names), named_tasks(scenarios)
    check_methods(methods)
    with locked(folder):
        engine = planning_engine(folder, methods, settings)
        engine.run(planning_jobs(tasks + drawn, methods, repeats, settings), jobs)
        summary = summarise(engine.file.table)
        write_atomically(folder / "summary.md", summary)
    yield summary


def summarise(runs: pd.DataFrame) -> str:
    """The summary as Markdown."""
    runs = report.with_sums(report.ordered(runs, PLANNERS))
    named = runs.kind.isin(NAMED)
    parts = ["# Benchmark of the methods\n", NOTES, report.machine(*report.PACKAGES)]
    if named.any():
        parts.append(f"## Scenarios\n\nMedians over the repeats.\n\n{_named_table(runs[named])}")
    if not named.all():
        drawn = runs[~named]
        sets = {"all": drawn, **dict(iter(drawn.groupby("kind", sort=False)))}
        rows, ratios = (
            pd.concat([make(of).assign(maps=name) for name, of in sets.items()]) for make in (_set, _ratios)
        )
        heading = "## Random tasks on test maps\n\nMedian / 95th percentile over all attempted.\n\n"
        parts.append(heading + report.table(rows, SET_COLUMNS))
        if len(ratios):
            about = "Medians; of all runs first, then of those that are verified with both methods."
            parts.append(f"### Ratios, run by run\n\n{about}\n\n{report.table(ratios, RATIO_COLUMNS)}")
    parts.append(f"## The guesses\n\n{GUESS_NOTE}\n{_guess_table(runs, named)}")
    return "\n".join(parts).rstrip() + "\n"


def _named_table(runs: pd.DataFrame) -> str:
    by = ["scenario", "kind", "method"]
    over_all = report.medians(runs, by, [*report.SECONDS, "first_iterations", "iterations"])
    over_verified = report.medians(runs[runs.verified], by, ["cost", "clearance_m"])
    rows = report.counts(runs, by).join([over_all, over_verified]).reset_index()
    return report.table(rows.merge(report.paper_rows(), how="left", on=by), NAMED_COLUMNS)


def _set(runs: pd.DataFrame) -> pd.DataFrame:
    by = ["method"]
    spreads = report.percentiles(runs, by, SPREAD_OF, report.SPREAD)
    verified = runs[runs.verified].groupby(by)
    return report.counts(runs, by).join([spreads, verified[["cost"]].median(), verified[["gear_changes"]].mean()])


def _ratios(runs: pd.DataFrame) -> pd.DataFrame:
    """Medians of the ratios of every two methods of RATIOS that ran on the same tasks."""
    by = ["method", "method_other"]
    found = report.pairs(runs, runs, ["planned_s", "total_s", "iterations", "cost"])
    # where one of them never got as far as a solve, the iterations have no ratio
    found.iterations_ratio = found.iterations_ratio.where(found.iterations > 0)
    both = found[found.verified & found.verified_other]
    over_all = report.medians(found, by, ["planned_s_ratio", "total_s_ratio", "iterations_ratio"])
    over_both = report.medians(both, by, ["planned_s_ratio", "total_s_ratio", "cost_ratio"]).add_prefix("both_")
    rows = found.groupby(by).agg(n=("kind", "size")).join([over_all, over_both])
    rows["both"] = both.groupby(by).size().reindex(rows.index, fill_value=0)
    return rows.reindex([pair for pair in RATIOS if pair in rows.index])


def _guess_table(runs: pd.DataFrame, named: pd.Series) -> str:
    """Disparities, of named scenarios one by one, of random tasks together."""
    by = ["scenario", "kind", "method"]
    together = runs[~named].assign(scenario="random tasks", kind="")
    shown = pd.concat([runs[named], together])
    own = report.own_medians(shown, by, ["guess_blocked", "guess_gap_m"])
    return report.table(report.counts(shown, by).join(own), GUESS_COLUMNS)
