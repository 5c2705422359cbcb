"""Benchmark the optimal control problem from the command line: `python -m drake_gnnocp.ocp_benchmark`.

Every number of the summary is computed from the runs of the folder, failures counted.
"""

from __future__ import annotations

import argparse
import importlib.util
from collections.abc import Iterator, Sequence
from pathlib import Path

import pandas as pd

from drake_gnnocp.console import OneLineParser, count, reported, seconds
from drake_gnnocp.experiments.benchmark.guesses import BAD_GUESSES, SEARCHED
from drake_gnnocp.experiments.benchmark.methods import CASADI, DRAKE, SOLVERS, STOP_NOTE
from drake_gnnocp.experiments.benchmark.solving import NO_METHOD, Settings, solving_engine, solving_jobs
from drake_gnnocp.experiments.benchmark.tasks import Task, named_tasks, random_tasks
from drake_gnnocp.experiments.options import TIMING_EPILOG, add_budget, add_out, measuring_parser
from drake_gnnocp.experiments.reports import report
from drake_gnnocp.files import locked, write_atomically
from drake_gnnocp.scenario import bundled_scenarios

DEFAULTS, USUAL = Settings(), [DRAKE, *CASADI]
PACKAGES = ("drake", "casadi", "numpy")  # whose versions are named
PEER = "casadi (fastest of mx, sx, fatrop)"
NOTES = f"""\
One thread; the methods of a task run one after the other, from the same guess and under the same limit. Seconds and
iterations are median / 95th percentile over all attempted tasks, failures included; rows and cost J are medians.
`build + solve` is the sum over all rounds; `whole call` adds the verifications between them. *Verified* is the
independent dense check for all methods.

- `drake`: SQP steps (their time is in `solve s`), then Ipopt, refined until verified. {STOP_NOTE}
- `{PEER}`: CasADi, exact Hessian, MUMPS, the Ipopt settings that were best for it (adaptive
  barrier, kkt-error globalisation), the first of these rules to stop, the same pairs; one solve, not refined. Task by
  task the fastest of `casadi_mx` (mapped graph), `casadi_sx` (expanded) and `casadi_fatrop` (stage by stage, fatrop in
  the place of Ipopt), of those that converged.
- `casadi_plain`: `casadi_mx` with Ipopt's default options.
"""
COUNTS = """attempted: {attempted} | converged: {converged} | verified: {verified} ({verified_percent:.0f} %) |
    SQP steps: <convex_steps:0> | first solve, iterations: <first_iterations:0> | all iterations: <iterations:0> |
    rounds, mean: {rounds_mean:.2f}"""
METHOD_COLUMNS = f"""method: {{method}} | {COUNTS} | rows: {{rows:.0f}} | build s: <build_s:2> | solve s: <solve_s:2> |
    build + solve s: <optimisation_s:2> | whole call s: <total_s:2> | total s: {{optimisation_sum:.1f}} |
    cost J: {{cost:.3f}}"""
BAD_COLUMNS = f"guess: {{guess}} | {COUNTS} | build + solve s: <optimisation_s:2>"
SPREAD_OF = ["convex_steps", "first_iterations", "iterations", "build_s", "solve_s", "optimisation_s", "total_s"]
RATIO_COLUMNS = """tasks: {tasks} | n: {n} | time ratio, median: {time_median:.2f} | 95th percentile: {time_p95:.2f} |
    ratio of 95th percentiles: {of_tails:.2f} | cost ratio, median: {cost_median:.3f}"""


def _parser() -> OneLineParser:
    parser = measuring_parser(
        "ocp_benchmark",
        "Solve random tasks (40 m x 40 m, 10 obstacles) from the guesses of Hybrid A*, with this package "
        "and with CasADi, in one thread, and compare. Writes runs.csv and summary.md. What is there is not run again, "
        "and guesses once searched are kept in guesses/: choose another --out when the code has changed.",
        TIMING_EPILOG.replace("plans", "tasks"),
    )
    add = parser.add_argument
    add("--tasks", type=count, default=100, metavar="N", help="number of random tasks (default: %(default)s)")
    add("--seed", type=count, default=0, metavar="N", help="seed of the random tasks (default: %(default)s)")
    add("--library", action="store_true", help="run the bundled scenarios instead of random tasks")
    methods = f"some of {', '.join(SOLVERS)} (default: {' '.join(USUAL)})"
    add("--methods", nargs="+", choices=SOLVERS, default=USUAL, metavar="METHOD", help=methods)
    add("--perturb", action="store_true", help="start ours from bad guesses as well, and from its own optimum")
    add_budget(parser, DEFAULTS.max_seconds, "limit of one method on one task")
    limit = "wall-clock limit of Hybrid A* on one task in seconds (default: %(default)g)"
    add("--search-seconds", type=seconds, default=DEFAULTS.search_seconds, metavar="S", help=limit)
    add("--knots", type=_knots, default=DEFAULTS.n_knots, metavar="N", help="knots of a plan (default: %(default)s)")
    add_out(parser, "ocp_benchmark")
    return parser


def _knots(text: str) -> int:
    if (n := count(text)) < 4:
        raise argparse.ArgumentTypeError(f"must be at least 4, not {text!r}")
    return n


def main(argv: list[str] | None = None) -> int:
    """Parse the arguments, run what is missing and write the summary; returns the exit code."""
    given = _parser().parse_args(argv)
    methods, folder = list(dict.fromkeys(given.methods)), given.out
    settings = Settings(given.knots, given.max_seconds, given.search_seconds)

    def texts() -> Iterator[str]:
        check_casadi(methods)
        tasks = named_tasks(bundled_scenarios()) if given.library else random_tasks(given.seed, given.tasks)
        yield run(tasks, methods, given.perturb, settings, folder)

    return reported(texts(), folder)


def check_casadi(methods: Sequence[str]) -> None:
    """Raise a ValueError where a method needs CasADi and it is not there."""
    if any(method.startswith("casadi") for method in methods) and importlib.util.find_spec("casadi") is None:
        raise ValueError("--methods: casadi is not installed: pip install -e .[bench], or choose --methods drake")


def run(tasks: list[Task], methods: list[str], perturb: bool, settings: Settings, folder: Path) -> str:
    """Run methods on tasks; returns the summary, which is written."""
    with locked(folder):
        engine = solving_engine(folder, settings)
        engine.run([solving_jobs(task, methods, perturb, settings, folder) for task in tasks])
        summary = summarise(engine.file.table)
        write_atomically(folder / "summary.md", summary)
    return summary


def summarise(runs: pd.DataFrame) -> str:
    """The summary as Markdown."""
    parts = ["# Benchmark of the optimal control problem\n", f"{NOTES}\n{report.machine(*PACKAGES)}\n"]
    for kind, of_kind in report.with_sums(runs).groupby("kind", sort=False):
        parts.append(f"## Tasks: {kind}\n\n{_of_kind(of_kind)}")
    return "\n".join(parts).rstrip() + "\n"


def with_peer(runs: pd.DataFrame) -> pd.DataFrame:
    """The runs, and for every task the peer's best one as a method of its own."""
    best_first = {"by": ["converged", "optimisation_s"], "ascending": [False, True], "kind": "stable"}
    peers = runs[runs.method.isin(CASADI)].sort_values(**best_first)
    return pd.concat([runs, peers.drop_duplicates("scenario").assign(method=PEER)])


def _of_kind(runs: pd.DataFrame) -> str:
    guesses = runs[runs.method == NO_METHOD]
    left_out = guesses.scenario[~guesses.converged]
    text = f"{len(guesses)} tasks; Hybrid A* found no guess in {len(left_out)}, which are left out"
    text += f" ({', '.join(left_out)}).\n\n" if len(left_out) else ".\n\n"
    searched = with_peer(runs[(runs.guess == SEARCHED) & (runs.method != NO_METHOD)])
    if len(searched):
        text += report.table(_statistics(searched, "method", [DRAKE, PEER, *SOLVERS[1:]]), METHOD_COLUMNS) + "\n"
    ours, peers = searched[searched.method == DRAKE], searched[searched.method == PEER]
    compared = report.pairs(ours, peers, ["optimisation_s", "cost"])
    if len(compared):
        text += f"### drake against {PEER}\n\n{_ratio_table(compared)}\n"
    bad = runs[runs.guess.isin(BAD_GUESSES)]
    if len(bad):
        rows = report.table(_statistics(bad, "guess", BAD_GUESSES), BAD_COLUMNS)
        text += f"### drake from bad guesses, made from its own verified plans\n\n{rows}\n"
    return text


def _statistics(runs: pd.DataFrame, by: str, order: Sequence[str]) -> pd.DataFrame:
    rounds, sums = ("rounds", "mean"), ("optimisation_s", "sum")
    more = runs.groupby(by).agg(converged=("converged", "sum"), rounds_mean=rounds, optimisation_sum=sums)
    spreads = report.percentiles(runs, [by], SPREAD_OF, report.SPREAD)
    rows = report.counts(runs, [by]).join([more, spreads, report.medians(runs, [by], ["rows", "cost"])])
    return rows.reindex([name for name in order if name in rows.index])


def _ratio_table(compared: pd.DataFrame) -> str:
    both = compared[compared.verified & compared.verified_other]
    chosen = {"attempted by both": compared, "verified by both": both}
    rows = pd.DataFrame({"tasks": list(chosen), "n": [len(pairs) for pairs in chosen.values()]})
    ratios = [pairs.optimisation_s_ratio for pairs in chosen.values()]
    rows["time_median"], rows["time_p95"] = ([ratio.quantile(share) for ratio in ratios] for share in (0.5, 0.95))
    tails = [pairs[["optimisation_s", "optimisation_s_other"]].quantile(0.95) for pairs in chosen.values()]
    rows["of_tails"] = [tail.optimisation_s / tail.optimisation_s_other for tail in tails]
    rows["cost_median"] = [float("nan"), both.cost_ratio.median()]  # costs compare where both plans are plans
    return report.table(rows, RATIO_COLUMNS)
