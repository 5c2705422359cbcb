"""The engine of all benchmarks: which runs are missing, each made in a worker process and kept as it ends.

A task's runs are made one after the other in the same process, so that a machine that is busy for a while slows all.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

from tqdm import tqdm

from drake_gnnocp.experiments.benchmark.runs import Key, Run, RunFile
from drake_gnnocp.experiments.benchmark.worker import Worker, WorkerDied

logger = logging.getLogger(__name__)

GRACE = 60.0  # s, on top of twice the budget: what stops by itself has stopped by then


@dataclass(frozen=True)
class Job:
    """A run to be made."""

    key: Key
    make: Callable[[], Run]  # called in a worker process
    needs: tuple[Key, str] | None = None  # a run and the field of it without which this one is left out


@dataclass(frozen=True)
class Engine:
    """Makes the runs of a file that are missing."""

    file: RunFile
    warm_up: Callable[[], object]  # called first in every process
    seconds: float  # budget of one run, which counts as used up where its process died
    longest: float = 0.0  # s, budget of the longest run, where that is another

    def run(self, tasks: Sequence[Sequence[Job]], jobs: int = 1) -> None:
        """Make the missing runs of tasks, each of which is given by its runs in order, in `jobs` processes at a time.

        Raises:
            OSError: the file cannot be written.
        """
        waiting = deque(missing for task in tasks if (missing := [job for job in task if job.key not in self.file]))
        total = sum(map(len, waiting))
        with tqdm(total=total, unit="run") as bar, ThreadPoolExecutor(jobs) as threads:
            try:
                for future in [threads.submit(self._work, waiting, bar) for _ in range(min(jobs, len(waiting)))]:
                    future.result()
            finally:  # where this was interrupted, the others end after the task they are at
                waiting.clear()

    def _work(self, waiting: deque[list[Job]], bar: tqdm) -> None:
        with Worker(self.warm_up) as worker:
            while waiting:
                try:
                    task = waiting.popleft()
                except IndexError:  # another thread took the last one
                    return
                for job in task:
                    if job.needs is None or self._has(*job.needs):
                        self.file.add(self._made(worker, job))
                    with bar.get_lock():
                        bar.update()

    def _has(self, key: Key, field: str) -> bool:
        return key in self.file and bool(getattr(self.file[key], field))

    def _made(self, worker: Worker, job: Job) -> Run:
        try:
            run: Run = worker.call(job.make, timeout=GRACE + 2 * max(self.seconds, self.longest))
        except WorkerDied as error:
            logger.warning("%s: %s", job.key, error)
            return Run(*job.key, solve_s=self.seconds, total_s=self.seconds, status="crashed", reason=str(error))
        return run
