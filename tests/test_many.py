"""Many plans in processes: those of one process, in the order of the scenarios, made while they are asked for.

`python tests/test_many.py 300` prints how many are made a second.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from itertools import islice

import numpy as np
import pytest

from drake_gnnocp import PlanOptions, Scenario, plan, plan_many
from drake_gnnocp.experiments.benchmark.tasks import drawn_tasks
from drake_gnnocp.planner.many import AHEAD
from drake_gnnocp.scenario import ScenarioError

NAMES = ("map_a", "empty_field", "narrow_gate", "map_a")


def test_plans_of_processes_are_those_of_one() -> None:
    made = list(plan_many(NAMES, jobs=2, horizon="guess", options=PlanOptions(knots=100)))
    assert [one.scenario.name for one in made] == list(NAMES)
    for one in made:
        alone = plan(one.scenario, options=PlanOptions(knots=100))
        assert one.verified and one.trajectory is not None and alone.trajectory is not None
        np.testing.assert_array_equal(one.trajectory.states, alone.trajectory.states)


def test_scenarios_are_read_on_while_plans_are_made() -> None:
    read = 0

    def endless() -> Iterator[Scenario]:
        nonlocal read
        while True:
            read += 1
            yield Scenario("field", np.zeros(3), np.array([12.0, 0.1 * read, 0.4]))

    with ThreadPoolExecutor(1) as executor:
        made = list(islice(plan_many(endless(), 1, executor), 3))
    assert [one.scenario.goal[1] for one in made] == pytest.approx([0.1, 0.2, 0.3])
    assert read <= 3 + AHEAD


def test_what_is_no_scenario_is_told_where_its_turn_comes() -> None:
    with ProcessPoolExecutor(1) as executor:
        coming = plan_many(["empty_field", "no_such", "empty_field"], 1, executor)
        assert next(coming).verified
        with pytest.raises(ScenarioError, match="no_such"):
            next(coming)


def test_jobs_are_checked_at_once() -> None:
    with pytest.raises(ValueError, match="jobs: must be positive"):
        plan_many(["map_a"], jobs=0)


def main(tasks: int) -> None:
    """Print how many plans of tasks on test maps two processes make a second, starting them included."""
    scenarios = [task.scenario for task in drawn_tasks(tasks)]
    begin = time.perf_counter()
    verified = sum(made.verified for made in plan_many(scenarios, jobs=2))
    print(f"{tasks} tasks, {verified} verified: {tasks / (time.perf_counter() - begin):.1f} plans a second")


if __name__ == "__main__":
    main(int(sys.argv[1]))
