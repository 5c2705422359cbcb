"""From a scenario to guesses: the order of the hypotheses, the views of a scene, and splines between points."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch
from torch_scenes import torch_scene

from drake_gnnocp.guesses.learned import load_network
from drake_gnnocp.learning.checkpoint import load_weights, save_weights
from drake_gnnocp.learning.configs import NetworkConfig
from drake_gnnocp.learning.modules import TrajectoryNetwork
from drake_gnnocp.learning.predict import guesses, interpolated, spline_matrices
from drake_gnnocp.learning.ranking import Ranking, rank_features
from drake_gnnocp.learning.scene import MOST_OBSTACLES, Scene, vectors_of
from drake_gnnocp.learning.trainable import trained
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.vehicle import State, Vehicle

SAME = 2e-3  # m and s: float32 on tens of metres through some 10 layers


def test_hypotheses_come_in_the_order_of_the_ranking_in_the_file(tmp_path: Path) -> None:
    torch.manual_seed(0)
    config = NetworkConfig(width=16, channels=16, encoder_layers=1, hypotheses=4, refinements=0)
    network, scenario = TrajectoryNetwork(config), Scenario.load("map_a")
    for sign in (1.0, -1.0):
        network.ranking = Ranking(score=0.0, duration=sign)
        save_weights(tmp_path / "w.safetensors", trained(network), {})
        found = list(guesses(load_weights(tmp_path / "w.safetensors")[0], scenario, 10))
        signed = [sign * guess.duration for guess in found]
        assert len(found) == 16 and len({guess.duration for guess in found}) == 16
        assert signed[:4] == sorted(signed[:4], reverse=True) and signed[4:] == sorted(signed[4:], reverse=True)


def test_the_ranking_sees_defects_and_penetration_in_metres() -> None:
    states = torch.zeros(1, 1, 3, 5)
    states[..., 2, 0] = 1.0  # a jump of 1 m at rest: one of six defects
    block = torch.tensor([[-50.0, 0.5], [50.0, 0.5], [50.0, 9.0], [-50.0, 9.0]])  # 0.5 m beside the car's axis
    edges = torch.cat([block, block.roll(-1, dims=0)], dim=1)[None, None]
    vehicle = torch_scene(Scenario.load("map_a")).vehicle
    scene = Scene(edges, torch.ones(1, 1, 4, dtype=torch.bool), torch.zeros(1, 3), vehicle)
    features = rank_features(states, torch.tensor([[10.0]]), torch.tensor([[-0.7]]), scene)
    assert features[0, 0].tolist() == pytest.approx([-0.7, 1 / 6, 1.0, Vehicle().width / 2 - 0.5, 10.0, 0.0], abs=1e-5)


def test_the_ranking_sees_changes_of_gear() -> None:
    states = torch.zeros(1, 2, 6, 5)
    states[0, 0, :, State.V] = torch.tensor([0.0, 1.0, -1.0, -1.0, 2.0, 0.0])
    states[0, 1, :, State.V] = torch.tensor([0.0, -1.0, -2.0, -1.0, -0.1, 0.0])
    scene = torch_scene(Scenario.load("map_a"))
    features = rank_features(states, torch.full((1, 2), 10.0), torch.zeros(1, 2), scene)
    assert features[0, :, -1].tolist() == [2.0, 0.0]


@pytest.mark.parametrize("turn", [False, True], ids=["mirrored", "the other way"])
def test_all_views_of_a_task_together_are_those_of_its_image(turn: bool) -> None:
    torch.manual_seed(0)
    network = TrajectoryNetwork(NetworkConfig(width=16, channels=16, encoder_layers=1, hypotheses=3)).eval()
    flip = np.array([1.0, -1.0])
    rings = (np.array([[3.0, 3.0], [5.0, 3.0], [4.0, 6.0]]), np.array([[7.0, -6.0], [8.0, -6.0], [8.0, -3.0]]))
    start, goal = np.zeros(3), np.array([9.0, 4.0, 1.0])
    image = Scenario("image", start, goal * [1, -1, -1], tuple(ring * flip for ring in rings))
    if turn:
        image = Scenario("image", goal, start, rings)
    found, other = (
        sorted(guesses(trained(network), task, network.config.points), key=lambda guess: guess.duration)
        for task in (Scenario("task", start, goal, rings), image)
    )
    assert len(found) == len(other) == 12
    for guess, same in zip(found, other, strict=True):
        assert guess.duration == pytest.approx(same.duration, abs=SAME)
        expected = same.poses[::-1, :2] if turn else same.poses[:, :2] * flip
        np.testing.assert_allclose(guess.poses[:, :2], expected, atol=SAME)


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


def test_learned_guesses_fit_the_scenario() -> None:
    scenario = Scenario.load("map_b")
    x, y, _ = scenario.start
    local = scenario.translated(-x, -y)
    for guess in guesses(load_network(), local, n_knots=90):
        assert len(guess) == 90
        assert np.array_equal(guess.poses[0], local.start)
        assert np.allclose(guess.poses[-1, :2], local.goal[:2])
        assert math.cos(guess.poses[-1, 2] - local.goal[2]) == pytest.approx(1.0)
        limits = [local.vehicle.v_max, local.vehicle.phi_max, local.vehicle.a_max, local.vehicle.w_max]
        assert (np.abs(np.hstack([guess.states[:, 3:], guess.inputs])) <= np.array(limits) + 1e-9).all()


def test_every_hypothesis_of_every_view_is_given_once() -> None:
    found = list(guesses(load_network(), Scenario.load("map_b"), n_knots=10))
    assert len(found) == 4 * NetworkConfig().hypotheses
    assert len({guess.poses.tobytes() for guess in found}) == len(found)


def test_of_very_many_obstacles_the_network_is_shown_those_nearest_to_the_way() -> None:
    box = np.array([[0.0, 0.0], [0.2, 0.0], [0.2, 0.2], [0.0, 0.2]])
    boxes = tuple(box + [0.0, 3.0 + y] for y in np.random.default_rng(0).permutation(MOST_OBSTACLES + 100))
    start, goal, bounds = np.array([-9.0, 0.0, 0.0]), np.array([9.0, 0.0, 0.0]), (-99.0, 99.0, -99.0, 99.0)
    edges, mask = vectors_of(Scenario("boxes", start, goal, boxes, bounds))
    assert len(edges) == len(mask) == MOST_OBSTACLES + 4
    assert edges[:MOST_OBSTACLES, :, 1].min() == 3.0
    assert edges[:MOST_OBSTACLES, :, 1].max() == pytest.approx(2.0 + MOST_OBSTACLES + 0.2)
