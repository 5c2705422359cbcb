"""The Markdown summary of a folder of runs: every number is computed from its rows, failures counted."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from drake_gnnocp.experiments.benchmark.methods import AUTO, GNN, GNN_PAPER, HYBRID_ASTAR, METHODS, RRT_STAR
from drake_gnnocp.experiments.benchmark.paper_table import PAPER
from drake_gnnocp.experiments.benchmark.runs import Run
from drake_gnnocp.experiments.benchmark.tasks import LIBRARY, NAMED
from drake_gnnocp.experiments.reports.text import machine, spread, table

NOTES = """\
One thread a process. *Guess*, *build* and *solve* sum up all attempts of a plan; *total* is the wall time of the whole
call, with the verifications between the solves. *Verified* is the independent dense check; *fallback* is a plan that
came from another guess than the one its method asks for first. Failures are in all numbers except costs.
"""
PACKAGES = ("drake", "torch", "ompl", "numpy")  # whose versions are named
RATIOS = tuple((method, other) for method in (GNN, AUTO, GNN_PAPER) for other in (HYBRID_ASTAR, RRT_STAR))
DISPARITIES: tuple[tuple[str, Callable[[Run], float]], ...] = (
    ("position m", lambda run: run.disparity_position),
    ("theta rad", lambda run: run.disparity_theta),
    ("v m/s", lambda run: run.disparity_v),
    ("phi rad", lambda run: run.disparity_phi),
    ("knots blocked", lambda run: run.guess_blocked),
    ("gap m", lambda run: run.guess_gap_m),
)


def summarise(runs: Sequence[Run]) -> str:
    """The summary as Markdown."""
    parts = ["# Benchmark of the methods\n", NOTES, machine(*PACKAGES)]
    named, drawn = [r for r in runs if r.kind in NAMED], [r for r in runs if r.kind not in NAMED]
    if named:
        parts.append(f"## Scenarios\n\nMedians over the repeats.\n\n{_named_table(named)}")
    if drawn:
        sets = [("all", drawn), *((kind, list(group)) for kind, group in grouped(drawn, lambda run: run.kind))]
        heading = "## Random tasks on test maps\n\nMedian / 95th percentile over all attempted.\n\n"
        parts.append(heading + _set_table(sets))
        if compared := _ratio_table(sets):
            about = "Medians; of all runs first, then of those that are verified with both methods."
            parts.append(f"### Ratios, run by run\n\n{about}\n\n{compared}")
    parts.append(_disparities(named, drawn))
    return "\n".join(parts).rstrip() + "\n"


def ratios(runs: Sequence[Run], method: str, other: str) -> list[tuple[Run, Run]]:
    """The runs of two methods on the same scenarios in the same repeats."""
    of_other = {(run.scenario, run.kind, run.repeat): run for run in runs if run.method == other}
    pairs = [(run, of_other.get((run.scenario, run.kind, run.repeat))) for run in runs if run.method == method]
    return [(run, partner) for run, partner in pairs if partner is not None]


def _named_table(runs: Sequence[Run]) -> str:
    header = ["scenario", "method", "planning s", "paper", "optimisation s", "paper", "total s", "paper"]
    header += ["verified", "fallback", "first solve, iterations", "all iterations", "cost J", "clearance m"]
    rows = []
    for (scenario, kind, method), group in grouped(runs, lambda run: (run.scenario, run.kind, run.method)):
        printed = PAPER.get(scenario, {}).get(method) if kind == LIBRARY else None
        paper = [f"{seconds:.3f}" for seconds in printed] if printed else ["-"] * 3
        ours = [_median(group, value, 3) for value in (_guess, _opt, _total)]
        rows.append(
            [
                *(scenario, method),
                *(cell for pair in zip(ours, paper, strict=True) for cell in pair),
                f"{sum(run.verified for run in group)}/{len(group)}",
                f"{sum(run.fallback for run in group)}",
                _median(group, lambda run: run.first_iterations, 0),
                _median(group, lambda run: run.iterations, 0),
                _median([run for run in group if run.verified], lambda run: run.cost, 2),
                _median([run for run in group if run.verified], lambda run: run.clearance_m, 2),
            ]
        )
    return table(header, rows)


def _set_table(sets: Sequence[tuple[str, Sequence[Run]]]) -> str:
    header = ["maps", "method", "attempted", "verified", "without fallback", "guess s", "build s", "solve s", "total s"]
    header += ["guess + build + solve s", "convex steps", "first solve, iterations", "all iterations", "cost J"]
    rows = []
    for name, of_set in sets:
        for method, group in grouped(of_set, lambda run: run.method):
            verified = [run for run in group if run.verified]
            rows.append(
                [
                    *(name, method, str(len(group)), _share(len(verified), len(group))),
                    _share(sum(not run.fallback for run in verified), len(group)),
                    *(_spread(group, value, 2) for value in (_guess, lambda r: r.build_s, lambda r: r.solve_s, _total)),
                    _spread(group, _planning, 2),
                    _spread(group, lambda run: run.convex_steps, 0),
                    _spread(group, lambda run: run.first_iterations, 0),
                    _spread(group, lambda run: run.iterations, 0),
                    _median(verified, lambda run: run.cost, 2),
                ]
            )
    return table(header, rows)


def _ratio_table(sets: Sequence[tuple[str, Sequence[Run]]]) -> str:
    header = ["maps", "methods", "n", "guess + build + solve", "total", "iterations"]
    header += ["both verified", "guess + build + solve", "total", "cost"]
    rows = []
    for name, of_set in sets:
        for method, other in RATIOS:
            pairs = ratios(of_set, method, other)
            if not pairs:
                continue
            both = [(a, b) for a, b in pairs if a.verified and b.verified]
            # where one of them never got as far as a solve, the iterations have no ratio
            solved = [(a, b) for a, b in pairs if a.iterations and b.iterations]
            numbers = [
                _median_ratio(pairs, _planning),
                _median_ratio(pairs, _total),
                _median_ratio(solved, lambda run: run.iterations),
                *(str(len(both)), _median_ratio(both, _planning), _median_ratio(both, _total)),
                _median_ratio(both, lambda run: run.cost),
            ]
            rows.append([name, f"{method} / {other}", str(len(pairs)), *numbers])
    return table(header, rows) if rows else ""


def _disparities(named: Sequence[Run], drawn: Sequence[Run]) -> str:
    """The table of disparities: named scenarios one by one, random tasks together."""
    header = ["scenario", "method", "n", *(name for name, _ in DISPARITIES)]
    groups = [*grouped(named, lambda run: (run.scenario, run.kind, run.method))]
    groups += [(("random tasks", "", method), group) for method, group in grouped(drawn, lambda run: run.method)]
    rows = []
    for (name, _, method), group in groups:
        counted = [run for run in group if run.verified and not run.fallback]
        rows.append([name, method, str(len(counted)), *(_median(counted, value, 2) for _, value in DISPARITIES)])
    text = "Cumulated over the knots, the guess that the solver started from against its optimum; the share of its\n"
    text += (
        "knots at which it touches an obstacle; its mean error of the kinematic model from knot to knot. Medians over\n"
    )
    text += "the n verified plans without fallback.\n"
    return f"## The guesses\n\n{text}\n{table(header, rows)}"


def grouped(runs: Sequence[Run], key: Callable[[Run], Any]) -> list[tuple[Any, list[Run]]]:
    """Keys with their runs: scenarios as they first appear, the methods of each in the usual order."""
    first: dict[str, int] = {}
    for i, run in enumerate(runs):
        first.setdefault(run.scenario, i)
    groups: dict[Any, list[Run]] = {}
    for run in sorted(runs, key=lambda run: (first[run.scenario], METHODS.index(run.method))):
        groups.setdefault(key(run), []).append(run)
    return list(groups.items())


def _guess(run: Run) -> float:
    return run.guess_s


def _planning(run: Run) -> float:
    return run.guess_s + run.opt_s


def _opt(run: Run) -> float:
    return run.opt_s


def _total(run: Run) -> float:
    return run.total_s


def _share(n: int, of: int) -> str:
    return f"{n} ({100 * n / of:.0f} %)"


def _median(runs: Sequence[Run], value: Callable[[Run], float], digits: int) -> str:
    return f"{np.median([value(run) for run in runs]):.{digits}f}" if runs else "-"


def _median_ratio(pairs: Sequence[tuple[Run, Run]], value: Callable[[Run], float]) -> str:
    return f"{np.median([value(a) / value(b) for a, b in pairs]):.2f}" if pairs else "-"


def _spread(runs: Sequence[Run], value: Callable[[Run], float], digits: int) -> str:
    return spread([value(run) for run in runs], digits)
