"""Runs of the benchmark, the rows of a CSV file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from drake_gnnocp.experiments.benchmark.row_files import RunsError, append_row, read_rows

__all__ = ["Run", "RunsError", "append_run", "read_runs"]


@dataclass(frozen=True)
class Run:
    """One method on one task from one guess."""

    group: str  # where the task is from: "random, seed 0" or "library"
    task: str
    guess: str  # kind of guess
    method: str
    build_s: float  # s, building programs, all rounds
    solve_s: float  # s, in the solvers, all rounds
    wall_s: float  # s, the whole call, with the verifications that drive the refinement
    convex_steps: int  # quadratic programs before the first solve, their time is part of solve_s
    first_iterations: int  # of the first solve
    iterations: int  # of all solves
    rounds: int  # solves
    rows: int  # scalar constraints of the first solve
    cost: float  # J of the paper
    clearance_m: float  # m, footprint to the nearest polygon
    converged: bool  # the solver's word for the last solve
    verified: bool  # the independent check's
    status: str  # the solver's last word
    faults: str  # what the check found

    @property
    def key(self) -> tuple[str, str, str, str]:
        """What makes it this run and no other."""
        return self.group, self.task, self.guess, self.method

    @property
    def seconds(self) -> float:
        """Build and solve [s]."""
        return self.build_s + self.solve_s


def read_runs(path: Path) -> list[Run]:
    """See `read_rows`."""
    return read_rows(path, Run)


def append_run(path: Path, run: Run) -> None:
    """See `append_row`."""
    append_row(path, run)
