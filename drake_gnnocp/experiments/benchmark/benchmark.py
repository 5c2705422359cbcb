"""The benchmark: which runs there are, each in a worker process, and what is done already.

A task's methods run one after the other in the same process, so that a machine that is busy for a while slows all.
"""

from __future__ import annotations

import json
import logging
from collections import deque
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from threading import Lock

from tqdm import tqdm

from drake_gnnocp.experiments.benchmark.methods import Method, Settings, run_method, warm_up
from drake_gnnocp.experiments.benchmark.row_files import RunsError, append_row, read_rows
from drake_gnnocp.experiments.benchmark.runs import Run, crashed_run
from drake_gnnocp.experiments.benchmark.tasks import Task
from drake_gnnocp.experiments.ocp_benchmark.worker import Worker, WorkerDied
from drake_gnnocp.files import write_atomically

logger = logging.getLogger(__name__)

GRACE = 60.0  # s, on top of twice the budget: what stops by itself has stopped by then


class Benchmark:
    """The runs of a folder.

    Args:
        folder: existing one that holds everything.
        methods: to run on every task.
        repeats: times that each is run.
        settings: common to all runs of the folder.

    Raises:
        RunsError: the folder holds something else, or runs with other settings.
        OSError: the folder, or a file of weights, cannot be read or written.
    """

    def __init__(self, folder: Path, methods: Sequence[Method], repeats: int, settings: Settings) -> None:
        check_settings(folder / "settings.json", settings.to_dict(methods))
        self._path = folder / "runs.csv"
        self._methods, self._repeats, self._settings = methods, repeats, settings
        self._runs = {run.key: run for run in read_rows(self._path, Run)}
        self._lock = Lock()

    @property
    def runs(self) -> list[Run]:
        """All runs in the folder, the older ones too."""
        return list(self._runs.values())

    def runs_of(self, tasks: Sequence[Task]) -> list[Run]:
        """The runs of some tasks that were asked for: not those that earlier calls with other methods left behind."""
        wanted = [(task, method, n) for task in tasks for method, n in self._wanted()]
        return [self._runs[key] for task, method, n in wanted if (key := (*task.key, method.name, n)) in self._runs]

    def run(self, tasks: Sequence[Task], jobs: int = 1) -> None:
        """Make the runs of tasks that are not there yet, in `jobs` processes at a time.

        Raises:
            OSError: the folder cannot be written.
        """
        waiting = deque((task, missing) for task in tasks if (missing := self._missing(task)))
        total = sum(len(missing) for _, missing in waiting)
        with tqdm(total=total, unit="run") as bar, ThreadPoolExecutor(jobs) as threads:
            try:
                for each in [threads.submit(self._work, waiting, bar) for _ in range(min(jobs, len(waiting)))]:
                    each.result()
            finally:  # where this was interrupted, the others end after the task they are at
                waiting.clear()

    def _missing(self, task: Task) -> list[tuple[Method, int]]:
        return [(method, n) for method, n in self._wanted() if (*task.key, method.name, n) not in self._runs]

    def _wanted(self) -> list[tuple[Method, int]]:
        return [(method, repeat) for repeat in range(self._repeats) for method in self._methods]

    def _work(self, waiting: deque[tuple[Task, list[tuple[Method, int]]]], bar: tqdm) -> None:
        with Worker(partial(warm_up, self._methods)) as worker:
            while waiting:
                try:
                    task, missing = waiting.popleft()
                except IndexError:  # another thread took the last one
                    return
                for method, repeat in missing:
                    run = self._in_worker(worker, task, method, repeat)
                    with self._lock:
                        append_row(self._path, run)
                        self._runs[run.key] = run
                        bar.update()

    def _in_worker(self, worker: Worker, task: Task, method: Method, repeat: int) -> Run:
        limit = self._settings.max_seconds
        try:
            run: Run = worker.call(run_method, task, method, repeat, limit, timeout=GRACE + 2 * limit)
        except WorkerDied as error:
            key = (*task.key, method.name, repeat)
            logger.warning("%s: %s", key, error)
            return crashed_run(key, limit, str(error))
        return run


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
