"""The learned guess in the planner: which hypotheses are solved, and what comes when none is worth it."""

from __future__ import annotations

import logging
import math
import os
import shutil
import time
from pathlib import Path

import numpy as np
import pytest

from drake_gnnocp import Scenario, Trajectory, plan
from drake_gnnocp.guesses import sources as guess_module
from drake_gnnocp.guesses.sources import (
    GuessOptions,
    GuessUnavailable,
    bundled_weights,
    check_available,
    gnn_guesses,
    load_network,
    straight_guess,
)
from drake_gnnocp.learning.network import NetworkConfig
from drake_gnnocp.learning.predict import interpolated
from drake_gnnocp.learning.spline import spline_matrices
from drake_gnnocp.ocp.convex_step import ConvexSteps
from drake_gnnocp.ocp.refine import RefineOptions
from drake_gnnocp.planner import schedule as strategies_module
from drake_gnnocp.planner.hypotheses import Candidate, settled_hypotheses
from drake_gnnocp.planner.schedule import PlanOptions

ROUNDING = 1e-9  # of double precision, a few operations on numbers up to 100
SINGLE = 1e-5  # m, rad: float32 at coordinates of 30 m


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return Scenario.load("map_b")


@pytest.fixture(scope="module")
def good(scenario: Scenario) -> Trajectory:
    found = plan(scenario, "hybrid_astar").trajectory
    assert found is not None
    return found


@pytest.fixture(scope="module")
def bad(scenario: Scenario) -> Trajectory:
    """Through the obstacles and far too fast: v_max for a hundredth of the time."""
    found = straight_guess(scenario, GuessOptions()).trajectory
    assert found is not None
    return Trajectory(found.t / 10, found.states, found.inputs)


def test_hypotheses_that_do_not_settle_are_passed_over(scenario: Scenario, good: Trajectory, bad: Trajectory) -> None:
    found = list(settled_hypotheses(scenario, [bad, good, bad], RefineOptions(), math.inf))
    assert [candidate.guess is good for candidate in found] == [True]
    assert found[0].stepped.settled and found[0].seconds > 0


def test_no_hypothesis_is_looked_at_after_the_deadline(scenario: Scenario, good: Trajectory) -> None:
    assert list(settled_hypotheses(scenario, [good], RefineOptions(), time.monotonic())) == []


def test_the_learned_guess_gives_a_verified_plan(scenario: Scenario) -> None:
    result = plan(scenario, "gnn")
    assert result.verified and result.guess_source == "gnn"
    assert result.attempts[-1].iterations <= 20


def test_auto_asks_hybrid_astar_where_no_hypothesis_settles(
    scenario: Scenario, bad: Trajectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(strategies_module, "gnn_guesses", lambda *_: iter([bad, bad]))
    result = plan(scenario)
    assert result.verified and result.guess_source == "hybrid_astar"
    assert [attempt.guess for attempt in result.attempts] == ["gnn", "hybrid_astar"]
    assert result.attempts[0].reason == "convex steps settled from no hypothesis"


def test_auto_goes_on_without_weights(
    scenario: Scenario, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def missing(_: object) -> None:
        raise GuessUnavailable("guess: 'gnn' needs trained weights")

    monkeypatch.setattr(guess_module, "load_network", missing)
    with caplog.at_level(logging.WARNING):
        result = plan(scenario)
    assert result.verified and result.guess_source == "hybrid_astar"
    assert "needs trained weights; going on with Hybrid A*" in caplog.text
    with pytest.raises(GuessUnavailable, match="weights"):
        check_available("gnn")


def test_weights_that_are_named_must_be_there(scenario: Scenario) -> None:
    options = PlanOptions(guess=GuessOptions(weights=Path("typo.pt")))
    with pytest.raises(GuessUnavailable, match=r"typo\.pt"):
        plan(scenario, options=options)


def test_weights_that_changed_are_read_again(tmp_path: Path) -> None:
    path = tmp_path / "best.pt"
    shutil.copy(bundled_weights(), path)
    before = load_network(path)
    assert load_network(path) is before
    os.utime(path, ns=(0, 0))
    assert load_network(path) is not before


@pytest.mark.parametrize("horizon", ["free", 40.0])
def test_the_learned_guess_serves_other_horizons(scenario: Scenario, horizon: float | str) -> None:
    result = plan(scenario, "gnn", horizon=horizon, options=PlanOptions(other_searches=()))
    assert result.verified and result.trajectory is not None
    if horizon != "free":
        assert result.trajectory.duration == pytest.approx(horizon)


def test_learned_guesses_fit_the_scenario(scenario: Scenario) -> None:
    x, y, _ = scenario.start
    local = scenario.translated(-x, -y)
    for guess in gnn_guesses(local, GuessOptions(n_knots=90)):
        assert len(guess) == 90
        assert np.array_equal(guess.poses[0], local.start)
        assert np.allclose(guess.poses[-1, :2], local.goal[:2])
        assert math.cos(guess.poses[-1, 2] - local.goal[2]) == pytest.approx(1.0)
        limits = [local.vehicle.v_max, local.vehicle.phi_max, local.vehicle.a_max, local.vehicle.w_max]
        assert (np.abs(np.hstack([guess.states[:, 3:], guess.inputs])) <= np.array(limits) + ROUNDING).all()


def test_every_hypothesis_of_every_view_is_given_once(scenario: Scenario) -> None:
    found = list(gnn_guesses(scenario, GuessOptions(n_knots=10)))
    assert len(found) == 4 * NetworkConfig().hypotheses
    assert len({guess.poses.tobytes() for guess in found}) == len(found)


def test_splines_meet_their_points_and_rest_at_both_ends() -> None:
    points = np.random.default_rng(0).normal(size=(8, 2))
    values, slopes = spline_matrices(8, 71)
    assert np.allclose((values @ points)[::10], points)
    assert np.allclose((slopes @ points)[[0, -1]], 0.0)


def test_slopes_of_splines_are_their_derivatives() -> None:
    points = np.random.default_rng(1).normal(size=12)
    values, slopes = spline_matrices(12, 110001)
    curve = values @ points
    differences = np.gradient(curve, 1 / 110000)[1:-1]
    assert np.allclose(differences, (slopes @ points)[1:-1], atol=1e-3)  # truncation, at curvatures up to 1e3


def test_predicted_points_are_seen_from_the_start() -> None:
    task = Scenario("task", np.array([3.0, -2.0, 0.5]), np.array([9.0, 4.0, 1.5]))
    points = np.zeros((30, 5))
    points[:, 0] = np.linspace(0.0, 5.0, 30)  # straight ahead
    found = interpolated(points, 12.0, task, 59)
    assert found.duration == pytest.approx(12.0)
    x, y, theta = found.poses[28]
    ahead = (x - 3.0) * math.cos(0.5) + (y + 2.0) * math.sin(0.5)
    assert (x, y) == pytest.approx((3.0 + ahead * math.cos(0.5), -2.0 + ahead * math.sin(0.5)))
    assert theta == pytest.approx(0.5) and 2.0 < ahead < 3.0


def test_a_learned_guess_that_no_car_can_drive_in_its_time_is_no_reason_to_give_up(
    scenario: Scenario, bad: Trajectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    candidate = Candidate(bad, ConvexSteps(bad, 1, True, 0.0, 0.0), 0.0)
    monkeypatch.setattr(strategies_module, "settled_hypotheses", lambda *_: iter([candidate]))
    result = plan(scenario)
    assert result.verified and result.guess_source == "hybrid_astar"
    assert result.attempts[0].guess == "gnn" and "v_max" in result.attempts[0].reason
