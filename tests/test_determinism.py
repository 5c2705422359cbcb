"""The same plan every time: whatever the clock says and however busy the machine is, unless the budget ended it."""

from __future__ import annotations

import itertools
import json
import multiprocessing
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drake_gnnocp import Plan, Scenario, plan
from drake_gnnocp.budget import Budget
from drake_gnnocp.command_line import NOT_VERIFIED, main
from drake_gnnocp.planner import PlanOptions
from drake_gnnocp.scenario import bundled_scenarios

LONG = 1e6  # s, of a clock that only moves when it is looked at
BUDGETS = (10.0, 60.0, 300.0)  # s
QUICKEST = ("angled_in", "dead_end_turn", "empty_field", "map_d", "perpendicular_in")  # where time is minimised
FIELD = Scenario("field", np.zeros(3), np.array([9.0, 3.0, 0.5]))


def written(result: Plan, folder: Path) -> bytes:
    """The bytes of trajectory.csv."""
    result.save(folder)
    return (folder / "trajectory.csv").read_bytes()


@pytest.mark.parametrize(("guess", "horizon"), [("auto", "guess"), ("hybrid_astar", "guess"), ("auto", "free")])
def test_a_plan_does_not_depend_on_when_the_clock_is_looked_at(
    guess: str, horizon: str, gate: Scenario, tmp_path: Path
) -> None:
    scenario = gate if horizon == "guess" else FIELD

    def planned(seconds: float, per_look: float) -> tuple[Plan, int]:
        looks = itertools.count()
        budget = Budget(seconds, lambda: next(looks) * per_look)
        return plan(scenario, guess, horizon, budget, PlanOptions(knots=40)), next(looks)

    at_leisure, looks = planned(LONG, 0.0)
    assert at_leisure.verified and not at_leisure.budget_ended
    expected = written(at_leisure, tmp_path)
    just_in_time = planned(LONG, LONG / (looks + 1))[0]
    assert not just_in_time.budget_ended and written(just_in_time, tmp_path) == expected
    for share in (0.2, 0.5, 0.8):
        late = planned(share * LONG, LONG / looks)[0]
        assert late.budget_ended or written(late, tmp_path) == expected
    assert planned(0.5 * LONG, LONG / looks)[0].budget_ended


def burn() -> None:
    """Keep a core busy as long as the test runs."""
    parent = multiprocessing.parent_process()
    while parent and parent.is_alive():
        sum(range(1_000_000))


@contextmanager
def burners(n: int) -> Iterator[None]:
    """So many processes burn a core each meanwhile."""
    context = multiprocessing.get_context("spawn")
    processes = [context.Process(target=burn, daemon=True) for _ in range(n)]
    for process in processes:
        process.start()
    try:
        yield
    finally:
        for process in processes:
            process.kill()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "horizon"), [*((name, "guess") for name in bundled_scenarios()), *((name, "free") for name in QUICKEST)]
)
def test_a_bundled_scenario_has_one_plan(name: str, horizon: str, tmp_path: Path) -> None:
    unhurried = plan(name, horizon=horizon, max_seconds=1e5)
    assert unhurried.verified and not unhurried.budget_ended
    expected = written(unhurried, tmp_path)
    for n in (0, 2):
        with burners(n):
            results = [plan(name, horizon=horizon, max_seconds=seconds) for seconds in BUDGETS]
        assert all(result.budget_ended or written(result, tmp_path) == expected for result in results)
        assert not results[-1].budget_ended


# --- what counts ---


@pytest.mark.parametrize("by_command", [False, True])
def test_the_time_that_reading_the_scenario_takes_counts(
    by_command: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now, read = [0.0], Scenario.load

    def slowly(name: str, **options: Any) -> Scenario:
        now[0] += 100.0
        return read(name, **options)

    monkeypatch.setattr(Scenario, "load", slowly)
    monkeypatch.setattr(Budget, "of", lambda seconds: Budget(seconds, lambda: now[0]))
    if by_command:
        assert main(["empty_field", "--no-pictures", "--out", str(tmp_path)]) == NOT_VERIFIED
    else:
        plan("empty_field").save(tmp_path)
    result = json.loads((tmp_path / "result.json").read_text())
    assert result["status"] == "failed" and result["budget_ended"] and result["total_seconds"] >= 100.0
    assert result["attempts"][0]["reason"] == "the budget of 60 s ended before a hypothesis was chosen"
