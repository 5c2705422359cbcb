"""Where the time of plans goes, stage by stage, and whether they keep a budget: `python -m drake_gnnocp.stages`."""

from __future__ import annotations

import resource
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from drake_gnnocp.console import OneLineParser, count, reported
from drake_gnnocp.experiments.benchmark.methods import HYBRID_ASTAR
from drake_gnnocp.experiments.benchmark.tasks import Task, drawn_tasks, named_tasks, tight_tasks
from drake_gnnocp.experiments.options import add_budget, add_out, measuring_parser
from drake_gnnocp.experiments.reports import report
from drake_gnnocp.experiments.stopwatch import Stopwatch
from drake_gnnocp.experiments.text import markdown_table
from drake_gnnocp.files import write_atomically
from drake_gnnocp.planner.planner import plan

P = "drake_gnnocp."
STAGES = {
    "network: features, inference, ranking": (f"{P}learning.predict:_seen_from",),
    "search": (f"{P}search.hybrid_astar:search", f"{P}search.hybrid_astar:direct"),
    "formulation": (f"{P}ocp.formulation:formulate",),
    "SQP: rows, costs": (f"{P}ocp.step_program:StepProgram.iterate", f"{P}ocp.step_program:StepProgram.first_iterate"),
    "SQP: quadratic programs": (f"{P}ocp.step_program:StepProgram.solve",),
    "program": (f"{P}ocp.nlp:build",),
    "Ipopt": (f"{P}ocp.ipopt:solve",),
    "certificate": (f"{P}verification.check:verify",),
    "clearance that is missing": (f"{P}ocp.comfort:close_around", f"{P}ocp.comfort:with_more_clearance"),
}
REST, WARM_UP = "the rest", ("map_a", "parallel_in")
PERCENTILES = (50, 95, 99)


@dataclass(frozen=True)
class Timed:
    """One plan."""

    seconds: float  # s
    verified: bool
    own: bool  # without Hybrid A*
    stages: dict[str, float]  # s
    calls: dict[str, int]


def _parser() -> OneLineParser:
    parser = measuring_parser(
        "stages",
        "Plan tasks on test maps one after the other, and tell what each stage takes and whether the budget is kept. "
        "Writes stages.md.",
    )
    add = parser.add_argument
    add("scenarios", nargs="*", metavar="SCENARIO", help="instead of tasks on test maps: bundled names or files")
    add("--tasks", type=count, default=100, metavar="N", help="tasks on test maps (default: %(default)s)")
    add("--tight", action="store_true", help="take them from tight places")
    add_budget(parser, 60.0, "budget of one plan")
    add_out(parser, "stages")
    return parser


def main(argv: list[str] | None = None) -> int:
    """Parse the arguments, plan and write the tables; returns the exit code."""
    given = _parser().parse_args(argv)

    def texts() -> Iterator[str]:
        drawn = tight_tasks if given.tight else drawn_tasks
        tasks = named_tasks(given.scenarios) if given.scenarios else drawn(given.tasks)
        text = tables(timed_plans(tasks, given.max_seconds), given.max_seconds)
        given.out.mkdir(parents=True, exist_ok=True)
        write_atomically(given.out / "stages.md", text)
        yield text

    return reported(texts(), given.out)


def timed_plans(tasks: Sequence[Task], max_seconds: float) -> list[Timed]:
    """Plan tasks one after the other, each within a budget [s]."""
    for name in WARM_UP:
        plan(name)
    watch, found = Stopwatch(), []
    with watch.on(STAGES, P.rstrip(".")):
        for task in tasks:
            watch.reset()
            begin = time.perf_counter()
            made = plan(task.scenario, max_seconds=max_seconds)
            seconds = time.perf_counter() - begin
            own = made.guess_source != HYBRID_ASTAR
            found.append(Timed(seconds, made.verified, own, dict(watch.seconds), dict(watch.calls)))
    return found


def tables(plans: Sequence[Timed], max_seconds: float) -> str:
    """Stages, then totals, as Markdown."""
    total = np.array([one.seconds for one in plans])
    named = {stage: np.array([one.stages.get(stage, 0.0) for one in plans]) for stage in STAGES}
    named[REST] = total - sum(named.values())
    calls = {stage: np.mean([one.calls.get(stage, 0) for one in plans]) for stage in STAGES}
    header = ["stage", *(f"{p} % [ms]" for p in PERCENTILES), "share of the sum", "calls a plan"]
    rows = [
        [
            stage,
            *(f"{1e3 * np.percentile(seconds, p):.1f}" for p in PERCENTILES),
            f"{seconds.sum() / total.sum():.0%}",
            f"{calls[stage]:.1f}" if stage in calls else "",
        ]
        for stage, seconds in named.items()
    ]
    rows.append(["all", *(f"{1e3 * np.percentile(total, p):.1f}" for p in PERCENTILES), "100%", ""])
    verified, own = (np.mean([getattr(one, name) for one in plans]) for name in ("verified", "own"))
    over = 1e3 * (total - max_seconds)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    machine = report.machine("drake", "numpy", "piqp").strip()
    return (
        f"# Where the time goes\n\n{len(plans)} tasks, one after the other; {machine}\n\n"
        f"{markdown_table(header, rows)}\n"
        f"Verified {verified:.1%}, without Hybrid A* {own:.1%}. Budget {max_seconds:g} s: exceeded by more than 20 ms\n"
        f"in {np.mean(over > 20):.1%}, by {max(0.0, over.max()):.0f} ms at most. Memory at most {memory:.0f} MB.\n"
    )
