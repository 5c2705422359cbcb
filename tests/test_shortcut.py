"""Shortcuts: what they make of a path is as free, ends where it did, and costs less."""

from __future__ import annotations

import numpy as np
import pytest

from drake_gnnocp.budget import Budget
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.search import shortcut
from drake_gnnocp.search.collision import FootprintTest, Margins
from drake_gnnocp.search.distance_field import DistanceField
from drake_gnnocp.search.moves import Costs, Move, joints, length_of, poses_along
from drake_gnnocp.search.reeds_shepp import path_length

EXACT = 1e-9  # m and rad, rounding of some arcs driven one after the other
REGION = (-20.0, 40.0, -20.0, 20.0)
COSTS = Costs()
WIGGLE = [Move(0.2, 3.0), Move(-0.2, 6.0), Move(0.2, 6.0), Move(-0.2, 6.0), Move(0.2, 3.0)]  # ends ahead of its start


def task_along(moves: list[Move], *obstacles: np.ndarray) -> tuple[Scenario, FootprintTest]:
    """The task that moves from the origin solve, and its collision test without a margin."""
    scenario = Scenario("test", np.zeros(3), joints(np.zeros(3), moves)[-1], obstacles)
    field = DistanceField.of(scenario.convex_obstacles, REGION, 0.2, 3.0)
    return scenario, FootprintTest(scenario, field, REGION, Margins.of(scenario, 0.0))


def cost(scenario: Scenario, moves: list[Move]) -> float:
    return COSTS.of(moves, 1.0 / scenario.vehicle.turning_radius)


def test_a_path_that_wiggles_in_the_open_becomes_nearly_the_shortest() -> None:
    scenario, test = task_along(WIGGLE)
    shorter = shortcut.shortened(scenario, WIGGLE, test, COSTS, Budget.unlimited())
    np.testing.assert_allclose(joints(scenario.start, shorter)[-1], scenario.goal, atol=EXACT)
    shortest = path_length(scenario.start, scenario.goal, scenario.vehicle.turning_radius)
    assert length_of(shorter) < 1.01 * shortest < 0.99 * length_of(WIGGLE)


def test_around_an_obstacle_the_shortcut_is_free_and_a_second_round_finds_what_the_first_leaves(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    around = [Move(0.25, 3.0), Move(-0.25, 3.0), Move(0.0, 2.0), Move(-0.2, 5.0), Move(0.1, 4.0), Move(0.2, 6.0)]
    block = np.array([[6.0, -5.0], [8.0, -5.0], [8.0, -2.0], [6.0, -2.0]])
    scenario, test = task_along(around, block)
    assert not test.collides(poses_along(scenario.start, around, test.spacing).poses).any()
    costs = []
    for rounds in (1, 2):
        with monkeypatch.context() as patch:
            patch.setattr(shortcut, "CUT_EVERY", shortcut.CUT_EVERY[:rounds])
            shorter = shortcut.shortened(scenario, around, test, COSTS, Budget.unlimited())
        assert not test.collides(poses_along(scenario.start, shorter, test.spacing).poses).any()
        np.testing.assert_allclose(joints(scenario.start, shorter)[-1], scenario.goal, atol=EXACT)
        costs.append(cost(scenario, shorter))
    assert costs[1] < costs[0] < cost(scenario, around)


def test_without_time_the_path_stays_as_it_is() -> None:
    scenario, test = task_along(WIGGLE)
    assert shortcut.shortened(scenario, WIGGLE, test, COSTS, Budget(0.0)) == WIGGLE


def test_the_work_grows_with_the_length_of_the_path_not_with_its_square(monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[int] = []

    def connect(*arguments: object) -> None:
        """As if nothing were free."""
        tried[-1] += 1

    monkeypatch.setattr(shortcut, "connect", connect)
    for times in (10, 40):
        long = WIGGLE * times
        scenario, test = task_along(long)
        tried.append(0)
        assert length_of(shortcut.shortened(scenario, long, test, COSTS, Budget.unlimited())) == length_of(long)
    assert 0 < tried[1] < 5 * tried[0]
