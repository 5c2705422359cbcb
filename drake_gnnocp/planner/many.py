"""Many plans, side by side in processes that stay warm."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Executor, Future
from contextlib import nullcontext
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

from drake_gnnocp.planner.planner import plan
from drake_gnnocp.planner.result import Plan
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.workers import workers

AHEAD = 4  # scenarios a process that wait for it: none is idle while another takes long


def plan_many(
    scenarios: Iterable[Scenario | str | Path],
    jobs: int | None = None,
    executor: Executor | None = None,
    **options: Any,
) -> Iterator[Plan]:
    """Plan scenarios in several processes, with one thread each.

    Plans are the same as those of `plan` where no budget ends them. A process takes a second to start, so it is for
    dozens of scenarios and more; where they come a few at a time, an executor that is kept open saves that. A script
    calls it below `if __name__ == "__main__":`, since its processes import the script.

    Args:
        scenarios: what `plan` takes; an iterator is read on while plans are made, not all at once.
        jobs: processes; None: as many as the machine has cores.
        executor: to plan in instead of processes that are started and ended here, such as a `ProcessPoolExecutor`.
        options: what `plan` is given beside the scenario, the same for all.

    Yields:
        A plan for every scenario, in their order.

    Raises:
        ValueError: jobs is not positive; or what `plan` raises for a scenario, where its turn comes.
    """
    jobs = len(os.sched_getaffinity(0)) if jobs is None else jobs
    if jobs < 1:
        raise ValueError(f"jobs: must be positive, not {jobs}")
    return _planned(iter(scenarios), jobs, executor, partial(plan, **options))


def _planned(
    scenarios: Iterator[Scenario | str | Path], jobs: int, executor: Executor | None, plan_one: partial[Plan]
) -> Iterator[Plan]:
    with nullcontext(executor) if executor is not None else workers(jobs, None) as pool:
        coming: deque[Future[Plan]] = deque(pool.submit(plan_one, task) for task in islice(scenarios, AHEAD * jobs))
        try:
            while coming:
                made = coming.popleft().result()
                coming.extend(pool.submit(plan_one, task) for task in islice(scenarios, 1))
                yield made
        finally:
            for left in coming:
                left.cancel()
