"""Plans with a free horizon are made quicker by a last, patient solve, and never slower."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from drake_gnnocp import Scenario, Trajectory, plan
from drake_gnnocp.ocp.cost import Cost
from drake_gnnocp.ocp.refine import Optimised, RefineOptions, Round
from drake_gnnocp.planner import minimum_time as polish
from drake_gnnocp.planner.minimum_time import PolishOptions, polished, worth_polishing
from drake_gnnocp.planner.schedule import PlanOptions
from drake_gnnocp.verification import verify

OPTIONS = PolishOptions()
STANDING = Scenario("stay", np.zeros(3), np.zeros(3))
FAR_DEADLINE = 1e12  # of time.monotonic() [s]
TPCAP = Path(__file__).parents[2] / "shared" / "scenarios" / "tpcap"


def standing(duration: float, verified: bool = True) -> Optimised:
    """A plan of a car that stays where it is, from one solve."""
    trajectory = Trajectory(np.linspace(0.0, duration, 20), np.zeros((20, 5)), np.zeros((20, 2)))
    check = replace(verify(STANDING, trajectory), collision_free=verified)
    solve = Round(0.0, 0.0, 1, True, "Success", (), 0, 0, check)
    return Optimised(trajectory, check, Cost(0.0, 0.0, 0.0), (solve,), "")


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
    monkeypatch.setattr(polish, "optimise", lambda *_: next(results))
    plan = polished(STANDING, standing(8.0), RefineOptions(), FAR_DEADLINE, OPTIONS)
    assert plan.verification.verified
    assert plan.trajectory.duration == expected
    assert len(plan.rounds) == 1 + len(found)


def test_the_patient_solver_hurries_first_and_asks_for_no_more_clearance(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[RefineOptions] = []

    def solve(_scenario: Scenario, _guess: Trajectory, refine: RefineOptions, _deadline: float) -> Optimised:
        asked.append(refine)
        return standing(9.0)

    monkeypatch.setattr(polish, "optimise", solve)
    near = replace(RefineOptions().problem, margin=0.01)
    for usual in (RefineOptions(), RefineOptions(problem=near)):
        asked.clear()
        polished(STANDING, standing(8.0), usual, FAR_DEADLINE, OPTIONS)
        first, last = asked
        assert first.problem.margin == last.problem.margin == min(OPTIONS.margin, usual.problem.margin)
        assert first.problem.weights.time > last.problem.weights.time
        assert last.problem.weights == usual.problem.weights
        assert last.ipopt.objective_change < usual.ipopt.objective_change


def test_nothing_is_solved_without_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(polish, "optimise", lambda *_: pytest.fail("out of time, and yet it solves"))
    before = standing(8.0)
    assert polished(STANDING, before, RefineOptions(), 0.0, OPTIONS) == before


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
    assert worth_polishing(durations, OPTIONS) == chosen


def test_a_polished_plan_is_verified_and_quicker_and_its_cost_is_what_it_was_defined_as() -> None:
    scenario = Scenario.load("parallel_in")
    unpolished = PlanOptions(other_searches=(), polish=PolishOptions(candidates=0))
    before = plan(scenario, "hybrid_astar", horizon="free", options=unpolished)
    after = plan(scenario, "hybrid_astar", horizon="free", options=replace(unpolished, polish=OPTIONS))
    assert before.trajectory is not None and after.trajectory is not None and after.cost is not None
    assert before.verified and after.verified
    assert after.trajectory.duration < 0.99 * before.trajectory.duration
    weights = unpolished.refine.problem.weights
    assert after.cost.J == pytest.approx(weights.lambda1 * after.cost.J1 + weights.lambda2 * after.cost.J2)
    assert after.attempts[0].iterations > before.attempts[0].iterations
    assert after.attempts[0].cost == after.cost.J


@pytest.mark.slow
@pytest.mark.skipif(not TPCAP.is_dir(), reason="the TPCAP cases are not beside this checkout")
@pytest.mark.parametrize(("case", "longest"), [("Case1", 12.0), ("Case3", 14.2), ("Case9", 37.7)])
def test_tpcap_cases_are_driven_quickly(case: str, longest: float) -> None:
    result = plan(Scenario.load(TPCAP / f"{case}.csv"), "hybrid_astar", horizon="free")
    assert result.verified and result.trajectory is not None, [attempt.reason for attempt in result.attempts]
    assert result.trajectory.duration <= longest
