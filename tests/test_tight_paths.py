"""Paths with hardly any room beside the car, as into slots little longer than the car."""

import numpy as np
import pytest

from drake_gnnocp import Guess, HybridAStar, Scenario, Vehicle, plan
from drake_gnnocp.budget import Budget
from drake_gnnocp.ocp.costs import CostWeights
from drake_gnnocp.ocp.formulation import formulate
from drake_gnnocp.planner import tight_paths
from drake_gnnocp.search.path import n_sections
from drake_gnnocp.verification import min_clearance

ROUNDING = 1e-9  # relative


def slot(extra: float) -> Scenario:
    """A parallel slot `extra` [m] longer than the car, with a kerb behind it and a wall across the lane."""
    car = Vehicle()
    low, length = -1.05 - car.width / 2 - 0.2, car.length + extra
    blocks = [
        (-4.7, 0.0, low, -0.15),
        (length, length + 4.7, low, -0.15),
        (-9.0, length + 9.0, low - 1.0, low),
        (-9.0, length + 9.0, 5.0, 6.0),
    ]
    rings = tuple(np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]) for x0, x1, y0, y1 in blocks)
    goal = np.array([car.rear_hang + extra / 2, -1.05, 0.0])
    return Scenario("slot", np.array([0.0, 2.5, 0.0]), goal, rings)


@pytest.fixture(scope="module")
def short_slot() -> Scenario:
    return slot(0.6)


@pytest.fixture(scope="module")
def found(short_slot: Scenario) -> Guess:
    near_origin = short_slot.translated(0.0, -2.5)
    guess = next(HybridAStar(knots=20).guesses(near_origin, Budget.unlimited()))
    assert isinstance(guess, Guess)
    return guess


def test_a_path_with_more_sections_than_the_knots_allow_gets_more_knots(found: Guess) -> None:
    assert found.path is not None
    assert len(found.trajectory) > 3 * n_sections(found.path) > 20


def test_knots_are_near_in_time_as_far_as_there_may_be_so_many(found: Guess, monkeypatch: pytest.MonkeyPatch) -> None:
    assert found.path is not None
    guess = tight_paths.timed(found.path, Vehicle(), found.trajectory, slack=1.2)
    assert guess.t[1] <= tight_paths.STEP * (1 + ROUNDING)
    monkeypatch.setattr(tight_paths, "MOST_KNOTS", 150)
    few = tight_paths.timed(found.path, Vehicle(), found.trajectory, slack=1.2)
    plain = tight_paths.timed(found.path, Vehicle(), found.trajectory, slack=1.0)
    assert len(few) == len(plain) == 150
    assert few.duration == pytest.approx(1.2 * plain.duration)


def test_no_more_clearance_is_asked_for_than_a_share_of_what_there_is(short_slot: Scenario, found: Guess) -> None:
    near_origin = short_slot.translated(0.0, -2.5)
    clearance = min_clearance(near_origin, near_origin.vehicle.footprints(found.trajectory.poses))
    usual = formulate(near_origin, found.trajectory, CostWeights(), 0.1)
    near = tight_paths.kept_near(near_origin, usual)
    expected = np.minimum(
        usual.line_clearances, max(tight_paths.CLEARANCE_SHARE * clearance, tight_paths.LEAST_CLEARANCE)
    )
    np.testing.assert_allclose(near.line_clearances, expected)
    np.testing.assert_allclose(near.least_margins, expected)
    assert near.trust_region is not None and usual.trust_region is not None
    assert near.trust_region < usual.trust_region and near.rows_within < usual.rows_within


def test_a_slot_of_many_short_moves_is_verified_at_the_first_attempt_with_more_knots(short_slot: Scenario) -> None:
    result = plan(short_slot, "hybrid_astar")
    assert result.verified and result.trajectory is not None and result.guess is not None, result.attempts
    assert len(result.attempts) == 1
    assert all("exceeds a limit of the vehicle" not in solve.verification.faults for solve in result.attempts[0].solves)
    assert len(result.trajectory) == len(result.guess) > 120
    assert result.trajectory.t[1] <= 1.2 * tight_paths.STEP  # fewer rests are rounded up to whole intervals, or more


@pytest.mark.parametrize(("room", "tight"), [(0.04, True), (0.3, False)])
def test_a_path_is_tight_where_it_comes_near_to_an_obstacle(room: float, tight: bool) -> None:
    half = Vehicle().width / 2 + room
    walls = [np.array([[2.0, y], [8.0, y], [8.0, y + 1.0], [2.0, y + 1.0]]) for y in (half, -half - 1.0)]
    task = Scenario("lane", np.zeros(3), np.array([12.0, 0.0, 0.0]), tuple(walls))
    guess = next(HybridAStar(knots=120).guesses(task, Budget.unlimited()))
    assert isinstance(guess, Guess) and tight_paths.is_tight(task, guess) is tight
    result = plan(task, "hybrid_astar")
    assert result.verified and len(result.attempts) == 1
    if tight:
        assert [solve.success for solve in result.attempts[0].solves] == [True]


@pytest.mark.slow
@pytest.mark.parametrize("extra", [0.5, 0.7, 0.8, 1.0, 1.2])
def test_short_slots_are_verified(extra: float) -> None:
    result = plan(slot(extra), "hybrid_astar")
    assert result.verified, [attempt.reason for attempt in result.attempts]
