"""Many scenarios, planned side by side in processes or on a cluster, each into a folder of its own.

A scenario is one task, and a folder with its result is a finished one: `batch.json` in it says with which options it
was planned. A batch that is stopped goes on; it plans again what has other options or another scenario by now. A
process that dies takes no other task with it: those at work then are tried again alone, which finds the one that kills.
"""

from __future__ import annotations

import csv
import io
import json
import logging
import math
import shutil
import sys
from collections import deque
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait
from contextlib import closing, suppress
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from tqdm import tqdm

from drake_gnnocp.drake_log import log_to_stderr
from drake_gnnocp.files import first_line, locked, write_atomically
from drake_gnnocp.scenario import Scenario, bundled_scenarios
from drake_gnnocp.scenario_files import SUFFIXES
from drake_gnnocp.workers import workers

MARK, SUMMARY = "batch.json", "summary.csv"  # in the folder of every scenario, and above them
VERIFIED, BAD_INPUT = "verified", "bad input"  # statuses
FAILED, UNWRITTEN = "error", "not written"  # of what was not planned to its end, and of what could not be written
DIED = "its process ended: killed, or out of memory"

PlanInto = Callable[[Scenario, Path, Mapping[str, Any]], None]  # plans, and writes all files, MARK with its content


@dataclass(frozen=True)
class Row:
    """What became of one scenario."""

    name: str
    status: str  # of result.json, or one of the above
    seconds: float | None = None  # s
    cost: float | None = None  # J
    clearance: float | None = None  # m, None as well where there are no obstacles
    guess: str = ""
    folder: str = ""  # empty where nothing was written
    reason: str = ""  # why it is not verified, or not written as asked for

    @property
    def is_as_asked(self) -> bool:
        """Whether there is a verified plan, written as asked for."""
        return self.status == VERIFIED and not self.reason


@dataclass(frozen=True)
class Task:
    """One scenario and where its plan goes."""

    scenario: Scenario
    folder: Path


@dataclass(frozen=True)
class Batch:
    """How scenarios are planned."""

    out: Path  # folder above those of the plans
    plan_into: PlanInto  # called in the workers, hence a function of a module, or a partial one
    options: Mapping[str, Any]  # all that plans depend on beside their scenarios, as JSON
    jobs: int = 1  # processes
    dask: str | None = None  # address of a cluster instead
    again: bool = False  # whether finished ones are planned again

    def run(self, sources: Iterable[str], load: Callable[[str], Scenario]) -> tuple[list[Row], bool]:
        """Plan scenarios, and write SUMMARY.

        Args:
            sources: scenarios as `load` takes them.
            load: raises a ValueError of one line where a source is none.

        Returns:
            A row for every source, in their order; and whether Ctrl-C ended it, which leaves out rows.

        Raises:
            ValueError: another batch works in the folder, or there is no such cluster.
            OSError: the folder cannot be written.
        """
        with locked(self.out):
            loaded = [_loaded(source, load) for source in sources]
            tasks = iter(self._tasks([item for item in loaded if isinstance(item, Scenario)]))
            rows: list[Row | Task] = [item if isinstance(item, Row) else next(tasks) for item in loaded]
            interrupted = False
            try:
                self._fill(rows)
            except KeyboardInterrupt:
                interrupted = True
            made = [row for row in rows if isinstance(row, Row)]
            write_atomically(self.out / SUMMARY, summary(made))
        return made, interrupted

    def _tasks(self, scenarios: Iterable[Scenario]) -> list[Task]:
        """A task for every scenario, in a folder of its name, or with a number after it where that is taken."""
        tasks: list[Task] = []
        taken = {SUMMARY, ".lock"}
        for scenario in scenarios:
            name, number = scenario.name, 1
            while name in taken:
                number += 1
                name = f"{scenario.name}_{number}"
            if name != scenario.name:
                print(f"{scenario.name}: the name is taken; this one is written to {self.out / name}", file=sys.stderr)
            taken.add(name)
            tasks.append(Task(scenario, self.out / name))
        return tasks

    def _fill(self, rows: list[Row | Task]) -> None:
        """Put rows into the places of their tasks, as they come."""
        waiting: dict[Path, int] = {}
        for i, task in enumerate(rows):
            if isinstance(task, Task):
                done = None if self.again else self._row(task)
                if done is None:
                    waiting[task.folder] = i
                else:
                    rows[i] = done
        tasks = [task for task in rows if isinstance(task, Task)]
        if not tasks:
            return
        job = partial(_planned, self.plan_into, self.options)
        try:
            bar = tqdm(total=len(rows), initial=len(rows) - len(tasks), unit="plan", disable=None)
            with bar, closing(outcomes(tasks, job, self.jobs, self.dask)) as coming:
                for task, failure in coming:
                    missing = f"{task.folder}: its files are not there: does the cluster see this folder?"
                    rows[waiting.pop(task.folder)] = failure or self._row(task) or _failure(task, missing)
                    bar.update()
        finally:
            for folder in waiting:
                _swept(folder)

    def _row(self, task: Task) -> Row | None:
        """What the folder of a task holds, where it was made of the same scenario with the same options."""
        try:
            mark, result, scenario = (
                json.loads((task.folder / name).read_text(encoding="utf-8"))
                for name in (MARK, "result.json", "scenario.json")
            )
            same = mark["options"] == _plain(self.options) and scenario == _plain(task.scenario.to_dict())
            if not same or not all((task.folder / name).is_file() for name in mark["files"]):
                return None
            check, attempts = result["verification"] or {}, result["attempts"]
            reason = mark["note"] or (result["no_path"] or {}).get("text", "")
            if not reason and result["status"] != VERIFIED:
                reason = attempts[-1]["reason"]
            cost = result["cost"] and result["cost"]["J"]
            numbers = (result["total_seconds"], cost, check.get("min_clearance_m"))
            return Row(task.folder.name, result["status"], *numbers, result["guess"], str(task.folder), reason)
        except (OSError, ValueError, KeyError, TypeError, AttributeError, IndexError):  # none there, or damaged
            return None


def sources_of(arguments: Iterable[str]) -> list[str]:
    """The scenarios that are meant: files and bundled names as they are, and all scenario files of folders, sorted."""
    return [source for argument in arguments for source in files_in(argument) or [argument]]


def files_in(argument: str) -> list[str]:
    """The scenario files in a folder, sorted; none where an argument is no folder, or means something else."""
    folder = Path(argument)
    if not argument or argument in bundled_scenarios() or folder.suffix.lower() in SUFFIXES or not folder.is_dir():
        return []
    return sorted(str(path) for path in folder.iterdir() if path.suffix.lower() in SUFFIXES)


def outcomes(
    tasks: Sequence[Task], job: Callable[[Task], Row | None], jobs: int, dask: str | None
) -> Generator[tuple[Task, Row | None], None, None]:
    """Do a job for every task, and give its outcome as soon as it is there.

    Args:
        tasks: what to do.
        job: called in the workers; gives nothing, or a row that says why it failed.
        jobs: processes.
        dask: address of a cluster, or None.
    """
    waiting, suspects = deque(tasks), deque[Task]()  # the latter were at work when a process died
    while waiting or suspects:
        alone = bool(suspects)
        source, width = suspects if alone else waiting, 1 if alone else len(waiting)
        width = min(width, jobs) if dask is None else width
        at_work: dict[Future[Row | None], Task] = {}
        try:
            with workers(width, dask) as pool:
                while source or at_work:
                    while source and len(at_work) < width:
                        at_work[pool.submit(job, source[0])] = source[0]
                        source.popleft()
                    for future in wait(at_work, return_when=FIRST_COMPLETED).done:
                        failure = _outcome(future, at_work[future])
                        yield at_work.pop(future), failure
        except BrokenExecutor:
            if alone:
                yield from ((task, _failure(task, DIED)) for task in at_work.values())
            else:
                suspects.extend(at_work.values())


def _outcome(future: Future[Row | None], task: Task) -> Row | None:
    try:
        return future.result()
    except BrokenExecutor:
        raise
    except Exception as error:  # of the cluster, as where its workers die
        return _failure(task, f"{type(error).__name__}: {first_line(error)}")


def _planned(plan_into: PlanInto, options: Mapping[str, Any], task: Task) -> Row | None:
    """Plan a task in a worker; returns a row where that failed."""
    log_to_stderr(logging.WARNING, logging.BASIC_FORMAT)
    _swept(task.folder)
    try:
        plan_into(task.scenario, task.folder, options)
    except OSError as error:
        return _failure(task, f"{error.filename or task.folder}: {error.strerror or error}", UNWRITTEN)
    except Exception as error:  # one task's fault must not end the others; it is told in its row
        return _failure(task, f"{type(error).__name__}: {first_line(error)}")
    return None


def _failure(task: Task, reason: str, status: str = FAILED) -> Row:
    return Row(task.folder.name, status, reason=reason)


def mark(options: Mapping[str, Any], files: Iterable[str], note: str) -> str:
    """The content of MARK: options, names of the files that belong together, why it is not as asked for, or nothing."""
    return json.dumps({"options": _plain(options), "files": sorted(files), "note": note}, indent=1) + "\n"


def _plain(value: Any) -> Any:
    """A value as it is read again from JSON."""
    return json.loads(json.dumps(value))


def _swept(folder: Path) -> None:
    """Remove what a process that died has left in a folder, and the folder where that was all."""
    for left in folder.glob(".tmp*"):
        shutil.rmtree(left, ignore_errors=True)
    with suppress(OSError):  # it is not there, or not empty
        folder.rmdir()


def _loaded(source: str, load: Callable[[str], Scenario]) -> Scenario | Row:
    try:
        return load(source)
    except ValueError as error:
        return Row(source, BAD_INPUT, reason=" ".join(str(error).split()).removeprefix(f"{source}: "))


def summary(rows: Iterable[Row]) -> str:
    """The content of SUMMARY."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["name", "status", "total_seconds", "cost", "min_clearance_m", "guess", "folder", "reason"])
    writer.writerows(asdict(row).values() for row in rows)
    return text.getvalue()


def table(rows: Sequence[Row]) -> list[str]:
    """Rows in columns, a line each, with a heading."""
    heading = ("name", "status", "seconds", "cost", "clearance", "guess", "")
    cells = [heading, *(_cells(row) for row in rows)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in cells]


def _cells(row: Row) -> tuple[str, ...]:
    seconds, cost = (f"{value:.2f}" if value is not None else "" for value in (row.seconds, row.cost))
    clearance = f"{row.clearance:.2f} m" if row.clearance is not None and math.isfinite(row.clearance) else ""
    return row.name, row.status, seconds, cost, clearance, row.guess, row.reason
