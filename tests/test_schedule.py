"""The schedule of attempts: which are made, with how much time, and what comes when one leads to no plan."""

from __future__ import annotations

import itertools
import logging
import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drake_gnnocp import Scenario, Trajectory, plan
from drake_gnnocp.budget import Budget
from drake_gnnocp.guesses import Guess, GuessSource, GuessUnavailable, Learned, NoGuess, learned
from drake_gnnocp.guesses.learned import bundled_weights, load_network
from drake_gnnocp.guesses.straight import straight_line
from drake_gnnocp.ocp.refine import Refined, Solve
from drake_gnnocp.planner import Attempt, FromGuess, MinimumTime, PlanOptions, options
from drake_gnnocp.planner import attempt as attempt_module
from drake_gnnocp.planner.options import SOURCES, source_named
from drake_gnnocp.planner.schedule import NONE_CONVERGED, Schedule, screened
from drake_gnnocp.verification import verify

KNOTS = 120


@dataclass(frozen=True)
class Hypotheses:
    """Trajectories proposed as the network's are."""

    found: tuple[Trajectory, ...]
    probability: float | None = None
    name: str = "gnn"
    proposes_many: bool = True

    def check_available(self) -> None:
        """They are there."""

    def guesses(self, scenario: Scenario, budget: Budget) -> Iterator[Guess | NoGuess]:
        """In turn."""
        for trajectory in self.found:
            yield Guess(self.name, trajectory, probability=self.probability, is_timed=True)


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    scenario = Scenario.load("map_b")
    x, y, _ = scenario.start
    return scenario.translated(-x, -y)


@pytest.fixture(scope="module")
def good(scenario: Scenario) -> Trajectory:
    found = plan(scenario, "hybrid_astar").trajectory
    assert found is not None
    return found


@pytest.fixture(scope="module")
def bad(scenario: Scenario) -> Trajectory:
    """Through the obstacles and far too fast."""
    found = straight_line(scenario, KNOTS)
    return Trajectory(found.t / 10, found.states, found.inputs)


def test_hypotheses_whose_steps_do_not_converge_are_passed_over(
    scenario: Scenario, good: Trajectory, bad: Trajectory
) -> None:
    found = list(screened(scenario, Hypotheses((bad, good, bad)), Budget.unlimited(), PlanOptions()))
    assert [guess.trajectory is good for guess, _ in found] == [True]
    guess, steps = found[0]
    assert steps.converged and guess.seconds > 0


def test_no_hypothesis_is_looked_at_when_the_budget_is_over(scenario: Scenario, good: Trajectory) -> None:
    assert list(screened(scenario, Hypotheses((good,)), Budget.of(0.0), PlanOptions())) == []


def test_the_learned_guess_gives_a_verified_plan(scenario: Scenario) -> None:
    result = plan(scenario, "gnn")
    assert result.verified and result.guess_source == "gnn"
    assert result.attempts[-1].iterations <= 20


def test_auto_asks_hybrid_astar_where_steps_converge_from_no_hypothesis(
    scenario: Scenario, bad: Trajectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(SOURCES, "gnn", lambda _: Hypotheses((bad, bad)))
    result = plan(scenario)
    assert result.verified and result.guess_source == "hybrid_astar"
    assert [attempt.source for attempt in result.attempts] == ["gnn", "hybrid_astar"]
    assert result.attempts[0].reason == NONE_CONVERGED and result.reported == 1


def test_a_learned_guess_that_no_car_can_drive_in_its_time_is_no_reason_to_give_up(
    scenario: Scenario, bad: Trajectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(SOURCES, "gnn", lambda _: Hypotheses((bad,)))
    result = plan(scenario, horizon=good_duration(scenario) / 10)
    assert [attempt.source for attempt in result.attempts] == ["gnn", "hybrid_astar"]
    assert all("at v_max" in attempt.reason for attempt in result.attempts)


def good_duration(scenario: Scenario) -> float:
    return float(np.linalg.norm(scenario.goal[:2] - scenario.start[:2])) / scenario.vehicle.v_max


def test_auto_goes_on_without_weights(
    scenario: Scenario, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def missing(_: object = None) -> None:
        raise GuessUnavailable("guess: 'gnn' needs trained weights")

    monkeypatch.setattr(learned, "load_network", missing)
    with caplog.at_level(logging.WARNING):
        result = plan(scenario)
    assert result.verified and result.guess_source == "hybrid_astar"
    assert "needs trained weights; going on with Hybrid A*" in caplog.text
    with pytest.raises(GuessUnavailable, match="weights"):
        source_named("gnn", PlanOptions())


def test_weights_that_are_named_must_be_there(scenario: Scenario) -> None:
    for typo in (Path("typo.safetensors"), "typo.safetensors"):
        with pytest.raises(GuessUnavailable, match=r"typo\.safetensors"):
            plan(scenario, options=PlanOptions(weights=typo))  # type: ignore[arg-type]


def test_weights_that_changed_are_read_again(tmp_path: Path) -> None:
    path = tmp_path / "best.safetensors"
    shutil.copy(bundled_weights(), path)
    before = load_network(path)
    assert load_network(path) is before
    os.utime(path, ns=(0, 0))
    assert load_network(path) is not before


def test_the_learned_guess_serves_a_constant_horizon(scenario: Scenario) -> None:
    result = plan(scenario, "gnn", horizon=40.0)
    assert result.verified and result.trajectory is not None
    assert result.trajectory.duration == pytest.approx(40.0)


def failed(scenario: Scenario, guess: Trajectory) -> Refined:
    check = replace(verify(scenario, guess), limits_ok=False)
    return Refined((Solve(0.0, 0.0, 1, False, "Infeasible", (), 0, 0, guess, check),), 0, "nothing found")


@pytest.fixture
def given(monkeypatch: pytest.MonkeyPatch) -> list[Budget]:
    """The budgets that attempts are given, none of which leads to a plan."""
    budgets: list[Budget] = []

    def nothing_found(scenario: Scenario, formulation: object, budget: Budget, *_: object) -> Refined:
        budgets.append(budget)
        return failed(scenario, straight_line(scenario, KNOTS))

    monkeypatch.setattr(attempt_module, "refine", nothing_found)
    return budgets


def scheduled(source: GuessSource, horizon: FromGuess | MinimumTime) -> list[Attempt]:
    field = Scenario("field", np.zeros(3), np.array([12.0, 4.0, 0.4]))
    schedule = Schedule(field, horizon, Budget.unlimited(), PlanOptions())
    schedule.try_source(source)
    return schedule.attempts


def test_all_attempts_run_down_one_budget_that_is_not_divided(given: list[Budget]) -> None:
    made = scheduled(SOURCES["hybrid_astar"](PlanOptions()), FromGuess())
    assert len(made) == 2 and not any(attempt.verified for attempt in made)
    assert given[0] is given[1]


def test_a_budget_that_is_over_when_all_is_done_has_ended_nothing(
    scenario: Scenario, good: Trajectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    now, refine = [0.0], attempt_module.refine

    def slow(*arguments: Any) -> Refined:
        refined = refine(*arguments)
        now[0] = 1e9
        return refined

    monkeypatch.setattr(attempt_module, "refine", slow)
    result = plan(scenario, good, max_seconds=Budget(60.0, lambda: now[0]))
    assert result.verified and not result.budget_ended
    assert "budget" not in result.summary and result.total_seconds == 1e9


def test_what_the_budget_leaves_undone_is_said(given: list[Budget], scenario: Scenario) -> None:
    ticks = itertools.count()
    result = plan(scenario, "hybrid_astar", max_seconds=Budget(3.0, lambda: next(ticks)))
    assert result.budget_ended and result.to_dict()["budget_ended"]
    assert "the budget ended before all was tried" in result.summary
    assert result.attempts[0].reason == "the budget of 3 s ended before it found a path"


def test_hypotheses_are_looked_at_for_so_many_steps(scenario: Scenario, good: Trajectory, bad: Trajectory) -> None:
    source = Hypotheses((bad, bad, good))
    (_, steps), *_ = screened(scenario, source, Budget.unlimited(), PlanOptions())
    assert steps.converged
    assert not list(screened(scenario, source, Budget.unlimited(), PlanOptions(), most_steps=2))


@pytest.mark.parametrize(("probability", "n"), [(None, 1), (0.3, 1), (0.1, 0)])
def test_hypotheses_that_are_unlikely_to_lead_to_a_plan_are_passed_over(
    scenario: Scenario, good: Trajectory, probability: float | None, n: int
) -> None:
    source = Hypotheses((good,), probability)
    assert len(list(screened(scenario, source, Budget.unlimited(), PlanOptions(), least_probability=0.2))) == n


def test_the_attempts_from_a_path_differ_in_what_the_solver_is_given(given: list[Budget]) -> None:
    first, closely = scheduled(SOURCES["hybrid_astar"](PlanOptions()), FromGuess())
    assert first.start is not None and closely.start is not None
    assert closely.guess_seconds < first.guess_seconds  # the path is not searched again
    assert np.abs(closely.start.states[:, 3]).max() > np.abs(first.start.states[:, 3]).max()  # nearer to the limits


def test_where_time_is_minimised_other_paths_are_tried_as_well(given: list[Budget]) -> None:
    assert len(scheduled(SOURCES["hybrid_astar"](PlanOptions()), MinimumTime())) == 4


def test_no_more_attempts_are_made_than_are_asked_for(given: list[Budget], scenario: Scenario) -> None:
    result = plan(scenario, "hybrid_astar", options=PlanOptions(most_attempts=1))
    assert len(result.attempts) == 1 and result.status == "unverified"


def test_a_new_source_is_a_line_of_the_table_and_a_name(monkeypatch: pytest.MonkeyPatch, gate: Scenario) -> None:
    monkeypatch.setitem(options.SOURCES, "again", lambda asked: Learned(asked.knots, name="again"))
    monkeypatch.setattr(options, "GUESSES", (*options.GUESSES, "again"))
    assert plan(gate, "again").attempts[0].source == "again"
