"""Plans of minimum time: solved again while that makes them quicker, then polished, and never slower."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drake_gnnocp import CostWeights, Scenario, Trajectory, plan
from drake_gnnocp.budget import Budget
from drake_gnnocp.ocp.formulation import Formulation
from drake_gnnocp.ocp.ipopt import USUAL, IpoptSettings
from drake_gnnocp.ocp.refine import Refined, Solve
from drake_gnnocp.planner import minimum_time, schedule
from drake_gnnocp.planner.minimum_time import polished, quicker, worth_polishing
from drake_gnnocp.verification import verify

STANDING = Scenario("stay", np.zeros(3), np.zeros(3))
WEIGHTS = CostWeights()
TPCAP = Path(__file__).parents[2] / "shared" / "scenarios" / "tpcap"


def standing(duration: float, verified: bool = True) -> Refined:
    """A plan of a car that stays where it is, from one solve."""
    trajectory = Trajectory(np.linspace(0.0, duration, 20), np.zeros((20, 5)), np.zeros((20, 2)))
    check = replace(verify(STANDING, trajectory), collision_free=verified)
    return Refined((Solve(0.0, 0.0, 1, True, "Success", (), 0, 0, trajectory, check),), 0, "")


def duration_of(plan: Refined) -> float:
    assert plan.trajectory is not None
    return plan.trajectory.duration


@pytest.mark.parametrize(
    ("found", "expected"),
    [
        ([(7.0, True), (6.0, True)], 6.0),
        ([(7.0, True), (6.0, False)], 7.0),
        ([(7.0, True), (7.002, True)], 7.002),  # the smoother one
        ([(7.0, False), (7.5, True)], 7.5),
        ([(9.0, True), (7.0, False)], 8.0),
    ],
)
def test_only_a_verified_plan_that_is_as_quick_is_taken(
    found: list[tuple[float, bool]], expected: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    results = iter([standing(duration, verified) for duration, verified in found])
    monkeypatch.setattr(minimum_time, "refine", lambda *_, **__: next(results))
    best = polished(STANDING, standing(8.0), WEIGHTS, 0.1, Budget.unlimited())
    assert best.verified
    assert duration_of(best) == expected
    assert len(best.solves) == 1 + len(found)


@pytest.mark.parametrize(
    ("found", "expected", "solves"),
    [
        ([(4.0, True), (3.99, True)], 4.0, 3),  # what saves less than half a per cent is not worth another solve
        ([(4.0, True), (3.0, True), (2.0, False)], 3.0, 4),
        ([(4.0, False)], 8.0, 2),
    ],
)
def test_a_quicker_solution_replaces_a_verified_plan_only_where_it_is_verified(
    found: list[tuple[float, bool]], expected: float, solves: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    results = iter([standing(duration, verified) for duration, verified in found])
    monkeypatch.setattr(minimum_time, "refine", lambda *_: next(results))
    best = quicker(STANDING, standing(8.0), WEIGHTS, 0.1, Budget.unlimited())
    assert best.verified and duration_of(best) == expected and len(best.solves) == solves


def test_what_is_not_verified_is_not_made_quicker(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(minimum_time, "refine", lambda *_: pytest.fail("nothing to go on from, and yet it solves"))
    before = standing(8.0, verified=False)
    assert quicker(STANDING, before, WEIGHTS, 0.1, Budget.unlimited()) is before


@pytest.mark.parametrize("margin", [0.1, 0.01])
def test_the_patient_solver_hurries_first_and_asks_for_no_more_clearance(
    margin: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[Formulation, IpoptSettings]] = []

    def solve(_: Scenario, formulation: Formulation, budget: Budget, settings: IpoptSettings) -> Refined:
        asked.append((formulation, settings))
        return standing(9.0)

    margins: list[Any] = []
    formulate = minimum_time.formulate

    def formulated(*arguments: Any, **named: Any) -> Formulation:
        margins.append(arguments[3])
        return formulate(*arguments, **named)

    monkeypatch.setattr(minimum_time, "refine", solve)
    monkeypatch.setattr(minimum_time, "formulate", formulated)
    polished(STANDING, standing(8.0), WEIGHTS, margin, Budget.unlimited())
    (first, _), (last, settings) = asked
    assert margins == [min(minimum_time.MARGIN, margin)] * 2
    assert first.weights.time > last.weights.time == WEIGHTS.time
    assert first.minimum_time and settings.objective_change < USUAL.objective_change


def test_nothing_is_solved_without_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(minimum_time, "refine", lambda *_, **__: pytest.fail("out of time, and yet it solves"))
    before = standing(8.0)
    assert polished(STANDING, before, WEIGHTS, 0.1, Budget.of(0.0)) is before


@pytest.mark.parametrize(
    ("durations", "chosen"),
    [
        ([], []),
        ([12.0, 10.0, 11.0], [1, 2, 0]),  # the quickest first
        ([10.01, 10.0, 11.0], [1, 2]),  # two of one length are one plan
        ([10.0, 12.1], [0]),  # too slow to overtake
        ([10.0, 10.3, 10.6, 10.9], [0, 1, 2]),
    ],
)
def test_different_plans_are_polished_the_quickest_first(durations: list[float], chosen: list[int]) -> None:
    assert worth_polishing(durations) == chosen


@pytest.mark.slow
def test_a_polished_plan_is_verified_and_quicker_and_its_cost_is_what_it_was_defined_as(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scenario = Scenario.load("parallel_in")
    monkeypatch.setattr(schedule.Schedule, "_try_other_searches", lambda _: None)
    monkeypatch.setattr(minimum_time, "CANDIDATES", 0)
    before = plan(scenario, "hybrid_astar", horizon="free")
    monkeypatch.setattr(minimum_time, "CANDIDATES", 1)
    after = plan(scenario, "hybrid_astar", horizon="free")
    assert before.trajectory is not None and after.trajectory is not None and after.cost is not None
    assert before.verified and after.verified
    assert after.trajectory.duration < 0.99 * before.trajectory.duration
    assert after.cost.J == pytest.approx(WEIGHTS.lambda1 * after.cost.J1 + WEIGHTS.lambda2 * after.cost.J2)
    assert after.attempt.iterations > before.attempt.iterations


@pytest.mark.slow
def test_the_quickest_of_several_plans_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(minimum_time, "CANDIDATES", 0)
    result = plan("perpendicular_in", "hybrid_astar", horizon="free")
    durations = [attempt.trajectory.duration for attempt in result.attempts if attempt.trajectory and attempt.verified]
    assert len(durations) > 1 and result.trajectory is not None
    assert result.trajectory.duration == min(durations)


@pytest.mark.slow
@pytest.mark.skipif(not TPCAP.is_dir(), reason="the TPCAP cases are not beside this checkout")
@pytest.mark.parametrize(("case", "longest"), [("Case1", 12.0), ("Case3", 14.2), ("Case9", 37.7)])
def test_tpcap_cases_are_driven_quickly(case: str, longest: float) -> None:
    result = plan(Scenario.load(TPCAP / f"{case}.csv"), "hybrid_astar", horizon="free")
    assert result.verified and result.trajectory is not None, [attempt.reason for attempt in result.attempts]
    assert result.trajectory.duration <= longest
