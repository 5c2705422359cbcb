"""The Markdown summary of a folder of runs: every number is computed from its rows, failures counted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from drake_gnnocp.experiments.ocp_benchmark.benchmark import NO_METHOD
from drake_gnnocp.experiments.ocp_benchmark.guesses import BAD_GUESSES, HYBRID_ASTAR
from drake_gnnocp.experiments.ocp_benchmark.methods import CASADI, DRAKE, METHODS
from drake_gnnocp.experiments.ocp_benchmark.runs import Run
from drake_gnnocp.experiments.reports.text import machine, spread, table
from drake_gnnocp.ocp.ipopt import IpoptOptions
from drake_gnnocp.ocp.refine import RefineOptions

PACKAGES = ("drake", "casadi", "numpy")  # whose versions are named
OURS, FINISH = IpoptOptions(), RefineOptions().finish
PEER = "casadi (faster of mx, sx)"
NOTES = f"""\
One thread; the methods of a task run one after the other, from the same guess and under the same limit. Seconds and
iterations are median / 95th percentile over all attempted tasks, failures included; rows and cost J are medians.
`build + solve` is the sum over all rounds; `whole call` adds the verifications between them. *Verified* is the
independent dense check for all methods.

- `drake`: convex steps (their time is in `solve s`), then Ipopt, refined until verified. Stopped by progress: cost
  within {OURS.objective_change:.1%} and constraints within {OURS.feasibility:g} m for {OURS.settled_iterations}
  iterations; where the convex steps have settled, cost within {FINISH.objective_change:.1%} in one iteration.
- `{PEER}`: CasADi, exact Hessian, MUMPS, the Ipopt settings that were best for it (adaptive
  barrier, kkt-error globalisation), the first of these rules to stop, the same pairs; one solve, not refined. Task by
  task the faster of `casadi_mx` (mapped graph) and `casadi_sx` (expanded), of those that converged.
- `casadi_plain`: `casadi_mx` with Ipopt's default options.
- `tutorial`: Drake with unscaled variables, a Python callback a constraint, dense gradients, Ipopt's default options.
"""


def summarise(runs: Sequence[Run]) -> str:
    """The summary as Markdown."""
    parts = ["# Benchmark of the optimal control problem\n", f"{NOTES}\n{machine(*PACKAGES)}\n"]
    for group in dict.fromkeys(run.group for run in runs):
        of_group = [run for run in runs if run.group == group]
        parts.append(f"## Tasks: {group}\n\n{_of_group(of_group)}")
    return "\n".join(parts).rstrip() + "\n"


def with_peer(runs: Sequence[Run]) -> list[Run]:
    """The runs from the guess of Hybrid A*, and for every task the peer's best one as a method of its own."""
    best: dict[str, Run] = {}
    for run in runs:
        if run.method in CASADI:
            other = best.get(run.task, run)
            best[run.task] = min(other, run, key=lambda each: (not each.converged, each.seconds))
    return [*runs, *(replace(run, method=PEER) for run in best.values())]


def ratios(runs: Sequence[Run], method: str, other: str) -> list[tuple[Run, Run]]:
    """The runs of two methods on the tasks that both attempted."""
    of_other = {run.task: run for run in runs if run.method == other}
    return [(run, of_other[run.task]) for run in runs if run.method == method and run.task in of_other]


def _of_group(runs: Sequence[Run]) -> str:
    guesses = [run for run in runs if run.method == NO_METHOD]
    left_out = [run for run in guesses if not run.converged]
    text = f"{len(guesses)} tasks; Hybrid A* found no guess in {len(left_out)}, which are left out"
    text += f" ({', '.join(run.task for run in left_out)}).\n\n" if left_out else ".\n\n"
    searched = with_peer([run for run in runs if run.guess == HYBRID_ASTAR and run.method != NO_METHOD])
    if searched:
        text += _method_table(searched) + "\n"
    if pairs := ratios(searched, DRAKE, PEER):
        text += f"### drake against {PEER}\n\n{_ratio_table(pairs)}\n"
    bad = [run for run in runs if run.guess in BAD_GUESSES]
    if bad:
        text += "### drake from bad guesses, made from its own verified plans\n\n" + _bad_guess_table(bad) + "\n"
    return text


def _method_table(runs: Sequence[Run]) -> str:
    header = ["method", "attempted", "converged", "verified", "convex steps", "first solve, iterations"]
    header += [
        "all iterations",
        "rounds, mean",
        "rows",
        "build s",
        "solve s",
        "build + solve s",
        "whole call s",
        "total s",
        "cost J",
    ]
    rows = []
    for method in (DRAKE, PEER, *METHODS[1:]):
        of_method = [run for run in runs if run.method == method]
        if of_method:
            rows.append([method, *_counts(of_method), *_iterations(of_method), *_costs(of_method)])
    return table(header, rows)


def _counts(runs: Sequence[Run]) -> list[str]:
    n, verified = len(runs), sum(run.verified for run in runs)
    return [str(n), str(sum(run.converged for run in runs)), f"{verified} ({100 * verified / n:.0f} %)"]


def _iterations(runs: Sequence[Run]) -> list[str]:
    return [
        _spread(runs, lambda run: run.convex_steps, 0),
        _spread(runs, lambda run: run.first_iterations, 0),
        _spread(runs, lambda run: run.iterations, 0),
        f"{np.mean([run.rounds for run in runs]):.2f}",
    ]


def _costs(runs: Sequence[Run]) -> list[str]:
    columns = [lambda run: run.build_s, lambda run: run.solve_s, lambda run: run.seconds, lambda run: run.wall_s]
    return [
        f"{np.median([run.rows for run in runs]):.0f}",
        *(_spread(runs, column, 2) for column in columns),
        f"{sum(run.seconds for run in runs):.1f}",
        f"{np.nanmedian([run.cost for run in runs]):.3f}" if any(run.cost == run.cost for run in runs) else "-",
    ]


def _ratio_table(pairs: Sequence[tuple[Run, Run]]) -> str:
    header = ["tasks", "n", "time ratio, median", "95th percentile", "ratio of 95th percentiles", "cost ratio, median"]
    rows = []
    both = [(first, second) for first, second in pairs if first.verified and second.verified]
    for name, chosen in (("attempted by both", pairs), ("verified by both", both)):
        if not chosen:
            rows.append([name, "0", *["-"] * 4])
            continue
        first, second = (np.array([[run.seconds, run.cost] for run in runs]) for runs in zip(*chosen, strict=True))
        time_ratio, cost_ratio = first.T / second.T
        of_tails = np.percentile(first[:, 0], 95) / np.percentile(second[:, 0], 95)
        numbers = [np.median(time_ratio), np.percentile(time_ratio, 95), of_tails]
        # costs compare where both plans are plans
        cost = f"{np.median(cost_ratio):.3f}" if chosen is both else "-"
        rows.append([name, str(len(chosen)), *(f"{number:.2f}" for number in numbers), cost])
    return table(header, rows)


def _bad_guess_table(runs: Sequence[Run]) -> str:
    header = ["guess", "attempted", "converged", "verified", "convex steps", "first solve, iterations"]
    header += ["all iterations", "rounds, mean", "build + solve s"]
    rows = []
    for kind in BAD_GUESSES:
        of_kind = [run for run in runs if run.guess == kind]
        if of_kind:
            seconds = _spread(of_kind, lambda run: run.seconds, 2)
            rows.append([kind, *_counts(of_kind), *_iterations(of_kind), seconds])
    return table(header, rows)


def _spread(runs: Sequence[Run], value: Callable[[Run], float], digits: int) -> str:
    return spread([value(run) for run in runs], digits)
