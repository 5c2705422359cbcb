"""The runs of a benchmark: one tidy table, a row a run, kept in a CSV file to which each run is appended as it ends.

All benchmarks share the columns, which are the fields of `Run`; a file holds those that its benchmark fills.
"""

from __future__ import annotations

import io
import json
import math
import os
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from threading import Lock

import pandas as pd

from drake_gnnocp.files import write_atomically

Key = tuple[str, str, str, str, int]  # of a run: scenario, kind, guess, method, repeat
KEY = ["scenario", "kind", "guess", "method", "repeat"]


@dataclass(frozen=True)
class Run:
    """One method on one scenario; of times and iterations those of all attempts count."""

    scenario: str
    kind: str  # where it is from: "library", "file", the kind of map it was drawn on, or the seed of random tasks
    guess: str  # the kind of guess that the method was given; empty where the method makes its own
    method: str
    repeat: int  # from 0
    guess_s: float = 0.0  # s, making guesses
    build_s: float = 0.0  # s, building programs, all solves
    solve_s: float = 0.0  # s, in the solvers, with the SQP steps before the first solve
    total_s: float = 0.0  # s, the whole call: the three above and the verifications
    convex_steps: int = 0  # SQP steps before the first solve
    first_iterations: int = 0  # of the first solve
    iterations: int = 0  # of all solves
    rounds: int = 0  # solves
    rows: int = 0  # scalar constraints of the first solve
    cost: float = math.nan  # J of the paper, NaN where nothing was solved, as are the other numbers that are missing
    converged: bool = False  # the solver's word for the last solve
    verified: bool = False  # the independent check's
    fallback: bool = False  # the plan came from another guess than the one that the method asks for first
    clearance_m: float = math.nan  # m, footprint to the nearest polygon
    duration_s: float = math.nan  # s, of the plan
    gear_changes: float = math.nan  # of the plan
    disparity_position: float = math.nan  # m, of the guess and the optimum, summed over the knots
    disparity_theta: float = math.nan  # rad
    disparity_v: float = math.nan  # m/s
    disparity_phi: float = math.nan  # rad
    guess_blocked: float = math.nan  # share of the knots at which the guess touches an obstacle
    guess_gap_m: float = math.nan  # m, mean defect of the kinematic model in the guess, from knot to knot
    optima: int = 0  # known local optima of the task
    position_error_m: float = math.nan  # m, of the guess to the nearest of them, mean over the knots
    status: str = ""  # "verified", "unverified", "failed" or "crashed"; or the solver's last word
    reason: str = ""  # why attempts were given up, or what the check found

    @property
    def key(self) -> Key:
        """What makes it this run and no other."""
        return self.scenario, self.kind, self.guess, self.method, self.repeat


_WORK = "build_s solve_s total_s convex_steps first_iterations iterations rounds"
_OFF = "disparity_position disparity_theta disparity_v disparity_phi guess_blocked guess_gap_m"
# the columns of the files: of planning, of solving, and of guesses that are only measured
PLANNED = f"scenario kind method repeat guess_s {_WORK} cost verified fallback clearance_m duration_s".split()
PLANNED += f"gear_changes {_OFF} status reason".split()
SOLVED = f"kind scenario guess method {_WORK} rows cost clearance_m converged verified status reason".split()
GUESSED = "scenario kind method optima position_error_m guess_blocked guess_gap_m".split()
TYPES = {field.name: str(field.type) for field in fields(Run)}
NOT_RUNS = "is not a file of runs of this version; choose another --out or remove it"


class RunsError(ValueError):
    """A file or a folder that does not hold such runs; the message is one line."""


class RunFile:
    """The runs in a file; those that are added are appended at once.

    Args:
        path: of the CSV file, which may be missing; a last line that a kill cut off is dropped from it.
        columns: that it has; the others have their defaults.

    Raises:
        RunsError: the header is another one, or a row is not that of a run.
        OSError: the file cannot be read.
    """

    def __init__(self, path: Path, columns: Sequence[str]) -> None:
        self._path, self._columns, self._lock = path, list(columns), Lock()
        self._runs = {run.key: run for run in self._read()}

    def __contains__(self, key: Key) -> bool:
        return key in self._runs

    def __getitem__(self, key: Key) -> Run:
        return self._runs[key]

    @property
    def table(self) -> pd.DataFrame:
        """All runs in the file, the older ones too."""
        return table_of(self._runs.values())

    def table_of(self, keys: Iterable[Key]) -> pd.DataFrame:
        """Those of some runs that are there: not those that earlier calls left behind."""
        return table_of(self._runs[key] for key in keys if key in self._runs)

    def add(self, run: Run) -> None:
        """Append a run, after the header where the file is new, in one write."""
        with self._lock:
            new = not self._path.exists() or self._path.stat().st_size == 0
            text = table_of([run]).to_csv(columns=self._columns, header=new, index=False, na_rep="nan")
            with self._path.open("ab", buffering=0) as file:
                file.write(text.encode())
                os.fsync(file.fileno())
            self._runs[run.key] = run

    def _read(self) -> list[Run]:
        text = self._path.read_bytes().decode("utf-8", errors="replace") if self._path.exists() else ""
        header, complete = ",".join(self._columns) + "\n", text[: text.rfind("\n") + 1]
        if not complete.startswith(header) and not header.startswith(text):  # the latter is a header that was cut off
            raise RunsError(f"{self._path}: {NOT_RUNS}")
        if complete != text:
            os.truncate(self._path, len(complete.encode()))
        if not complete:
            return []
        types = {name: TYPES[name] for name in self._columns}
        missing = {name: ["nan"] for name, kind in types.items() if kind == "float"}
        options = {"index_col": False, "keep_default_na": False, "na_values": missing}
        try:
            rows = pd.read_csv(io.StringIO(complete), dtype=types, **options)
        except ValueError as error:
            raise RunsError(f"{self._path}: {' '.join(str(error).split())}") from None
        defaults = {"guess": "", "repeat": 0}
        return [Run(**{**defaults, **row}) for row in rows.to_dict("records")]


def table_of(runs: Iterable[Run]) -> pd.DataFrame:
    """Runs as a table: a row each, the fields of `Run` as columns."""
    return pd.DataFrame([asdict(run) for run in runs], columns=list(TYPES)).astype(TYPES)


def check_settings(path: Path, settings: dict[str, object]) -> None:
    """Add settings to those of a folder.

    Raises:
        RunsError: one is different there.
    """
    found: dict[str, object] = {}
    if path.exists():
        try:
            found = dict(json.loads(path.read_text(encoding="utf-8")))
        except ValueError:
            raise RunsError(f"{path}: not the settings of a benchmark; choose another --out or remove it") from None
    for key, value in settings.items():
        if found.get(key, value) != value:
            raise RunsError(f"{path}: the runs here were made with other settings ({key}); choose another --out")
    write_atomically(path, json.dumps({**found, **settings}, indent=1) + "\n")
