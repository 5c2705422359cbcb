"""Slots little longer than the car, and the quickest of several plans."""

import time
from dataclasses import replace

import numpy as np
import pytest

from drake_gnnocp import Scenario, Trajectory, Vehicle, plan
from drake_gnnocp.guesses.sources import Guess, GuessOptions, hybrid_astar_guess
from drake_gnnocp.ocp.cost import Cost
from drake_gnnocp.ocp.refine import Optimised, RefineOptions, Round
from drake_gnnocp.planner import planner
from drake_gnnocp.planner.many_shifts import FineOptions, fine_guess, fine_refine
from drake_gnnocp.planner.minimum_time import PolishOptions
from drake_gnnocp.planner.schedule import PlanOptions
from drake_gnnocp.search.path import n_sections
from drake_gnnocp.timing.speed_planner import SpeedOptions
from drake_gnnocp.verification import min_clearance, verify

ROUNDING = 1e-9  # relative
OPTIONS = FineOptions()


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
    guess = hybrid_astar_guess(short_slot, GuessOptions(n_knots=20), time.monotonic() + 30)
    assert guess.path is not None and guess.trajectory is not None, guess.reason
    return guess


def test_a_path_with_more_sections_than_the_knots_allow_gets_more_knots(found: Guess) -> None:
    assert found.path is not None and found.trajectory is not None
    assert n_sections(found.path) > OPTIONS.sections
    assert len(found.trajectory) > 20


@pytest.mark.parametrize("most_knots", [150, 600])
def test_fine_guesses_have_knots_near_in_time_as_far_as_allowed(found: Guess, most_knots: int) -> None:
    assert found.path is not None and found.trajectory is not None
    options = replace(OPTIONS, most_knots=most_knots)
    guess = fine_guess(found.path, Vehicle(), found.trajectory, 1.2, SpeedOptions(), options)
    if most_knots == 600:
        assert guess.t[1] <= OPTIONS.step * (1 + ROUNDING)
    else:
        assert len(guess) == most_knots
    plain = fine_guess(found.path, Vehicle(), guess, 1.0, SpeedOptions(), replace(options, most_knots=len(guess)))
    assert guess.duration == pytest.approx(1.2 * plain.duration)


def test_fine_refinement_asks_for_half_of_the_clearance_there_is(short_slot: Scenario, found: Guess) -> None:
    assert found.trajectory is not None
    clearance = min_clearance(short_slot, short_slot.vehicle.footprints(found.trajectory.poses))
    fitted = fine_refine(short_slot, found.trajectory, RefineOptions(), OPTIONS)
    expected = min(RefineOptions().gap, max(OPTIONS.clearance_share * clearance, OPTIONS.least_gap))
    assert fitted.gap == fitted.threshold == fitted.problem.least_margin == pytest.approx(expected)


def test_a_slot_of_many_short_moves_is_verified_at_the_first_attempt_with_more_knots(short_slot: Scenario) -> None:
    result = plan(short_slot, "hybrid_astar")
    assert result.verified and result.trajectory is not None and result.guess is not None, result.attempts
    assert len(result.attempts) == 1
    assert len(result.trajectory) == len(result.guess) > 120
    assert result.trajectory.t[1] <= 1.2 * OPTIONS.step  # fewer rests are rounded up to whole intervals, or more


@pytest.mark.slow
@pytest.mark.parametrize("extra", [0.5, 0.7, 0.8, 1.0, 1.2])
def test_short_slots_are_verified(extra: float) -> None:
    result = plan(slot(extra), "hybrid_astar")
    assert result.verified, [attempt.reason for attempt in result.attempts]


def test_a_free_horizon_keeps_the_quickest_of_several_plans() -> None:
    scenario = Scenario.load("perpendicular_in")
    unpolished = PlanOptions(polish=PolishOptions(candidates=0))
    one = plan(scenario, "hybrid_astar", horizon="free", options=replace(unpolished, other_searches=()))
    several = plan(scenario, "hybrid_astar", horizon="free", options=unpolished)
    assert one.verified and several.verified and one.trajectory is not None and several.trajectory is not None
    assert len(several.attempts) > len(one.attempts) == 1
    assert several.trajectory.duration <= one.trajectory.duration * (1 + ROUNDING)


@pytest.mark.parametrize("verified", [True, False])
def test_a_quicker_solution_replaces_a_verified_plan_only_where_it_is_verified(
    verified: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    pose = np.array([1.0, 2.0, 0.5])
    scenario, durations = Scenario("stay", pose, pose), iter([8.0, 4.0, 4.0])

    def stay(local: Scenario, *_: object) -> Optimised:
        t = np.linspace(0.0, next(durations), 20)
        standing = Trajectory(t, np.tile(np.append(local.start, [0.0, 0.0]), (20, 1)), np.zeros((20, 2)))
        check = verify(local, standing)
        check = check if verified or t[-1] == 8.0 else replace(check, collision_free=False)
        solve = Round(0.0, 0.0, 1, True, "Success", (), 0, 0, check)
        return Optimised(standing, check, Cost(0.0, 0.0, 0.0), (solve,), "")

    monkeypatch.setattr(planner, "optimise", stay)
    options = PlanOptions(polish=PolishOptions(candidates=0))
    result = plan(scenario, "straight", horizon="free", options=options)
    assert result.verified and result.trajectory is not None
    assert result.trajectory.duration == (4.0 if verified else 8.0)
