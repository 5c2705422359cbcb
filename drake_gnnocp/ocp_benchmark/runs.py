"""Runs of the benchmark and the CSV file that holds them: one row a run, appended as it ends."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

HEADER_MISMATCH = "is not a file of runs of this version; choose another --out or remove it"


class RunsError(ValueError):
    """A file that does not hold runs; the message is one line."""


@dataclass(frozen=True)
class Run:
    """One method on one task from one guess."""

    group: str  # where the task is from: "random, seed 0" or "library"
    task: str
    guess: str  # kind of guess
    method: str
    build_s: float  # s, building programs, all rounds
    solve_s: float  # s, in the solver, all rounds
    wall_s: float  # s, the whole call, with the verifications that drive the refinement
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


NAMES = [field.name for field in fields(Run)]
PARSERS: dict[str, Callable[[str], object]] = {"str": str, "int": int, "float": float, "bool": "True".__eq__}


def read_runs(path: Path) -> list[Run]:
    """All complete rows; none where there is no file. A last line that a kill cut off is dropped from the file.

    Raises:
        RunsError: the header is another one, or a row is not that of a run.
        OSError: the file cannot be read.
    """
    if not path.exists():
        return []
    text = path.read_bytes().decode("utf-8", errors="replace")
    complete = text[: text.rfind("\n") + 1]
    if complete != text:
        os.truncate(path, len(complete.encode()))
    lines = list(csv.reader(io.StringIO(complete)))
    if lines and lines[0] != NAMES:
        raise RunsError(f"{path}: {HEADER_MISMATCH}")
    return [_run(path, number, cells) for number, cells in enumerate(lines[1:], start=2)]


def append_run(path: Path, run: Run) -> None:
    """Append a row, after the header where the file is new, in one write."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    if not path.exists() or path.stat().st_size == 0:
        writer.writerow(NAMES)
    writer.writerow(asdict(run).values())
    with path.open("ab", buffering=0) as file:
        file.write(text.getvalue().encode())
        os.fsync(file.fileno())


def _run(path: Path, number: int, cells: list[str]) -> Run:
    if len(cells) != len(NAMES):
        raise RunsError(f"{path}: line {number}: has {len(cells)} cells, not {len(NAMES)}")
    values: dict[str, Any] = {}
    for field, cell in zip(fields(Run), cells, strict=True):
        try:
            values[field.name] = PARSERS[str(field.type)](cell)
        except ValueError:
            raise RunsError(f"{path}: line {number}: {field.name}: {cell!r} is not a number") from None
    return Run(**values)
