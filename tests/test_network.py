"""The networks: what must not matter to them, what must, and that they learn."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
import torch
from safetensors.numpy import save
from torch import nn
from torch_scenes import torch_scene

from drake_gnnocp.experiments.training.losses import LossWeights, kinematic_errors, loss_of
from drake_gnnocp.experiments.training.samples import Batch
from drake_gnnocp.learning.checkpoint import WeightsError, load_weights, save_weights
from drake_gnnocp.learning.configs import CONFIGS, NetworkConfig, PaperConfig, config_of
from drake_gnnocp.learning.features import defects
from drake_gnnocp.learning.layers import decoder, encoder, nested
from drake_gnnocp.learning.modules import TrajectoryNetwork
from drake_gnnocp.learning.network import Prediction, composed, straight_line
from drake_gnnocp.learning.ranking import Ranking
from drake_gnnocp.learning.scene import Scene, mirrored, vectors_of
from drake_gnnocp.learning.surroundings import nearest_obstacles, signed_distance
from drake_gnnocp.learning.trainable import Network, new_network, trainable, trained
from drake_gnnocp.scenario import Scenario

SAME = 2e-3  # m and rad: float32 on tens of metres through some 20 layers
SCENES = ("map_a", "map_c", "courtyard", "narrow_gate")


@pytest.fixture(params=CONFIGS)
def network(request: pytest.FixtureRequest) -> Network:
    torch.manual_seed(1)
    made = new_network(config_of(request.param)).eval()
    for parameter in made.parameters():  # some are zero at first and would hide what depends on them
        torch.nn.init.normal_(parameter, std=0.03) if parameter.abs().sum() == 0 else None
    return made


def known_scenes() -> list[Scenario]:
    return [Scenario.load(name) for name in SCENES]


def predict(network: Network, scenario: Scenario) -> Prediction:
    with torch.inference_mode():
        return network(torch_scene(scenario))


def assert_same(one: Prediction, other: Prediction) -> None:
    torch.testing.assert_close(one.states, other.states, atol=SAME, rtol=0)
    torch.testing.assert_close(one.duration, other.duration, atol=SAME, rtol=SAME)
    torch.testing.assert_close(one.score, other.score, atol=SAME, rtol=0)


@pytest.mark.parametrize("scenario", known_scenes(), ids=lambda scenario: scenario.name)
def test_the_order_of_obstacles_does_not_matter(network: Network, scenario: Scenario) -> None:
    other = Scenario("other", scenario.start, scenario.goal, scenario.obstacles[::-1], scenario.bounds)
    assert_same(predict(network, scenario), predict(network, other))


@pytest.mark.parametrize("scenario", known_scenes(), ids=lambda scenario: scenario.name)
def test_the_first_vertex_and_the_orientation_of_a_polygon_do_not_matter(network: Network, scenario: Scenario) -> None:
    rings = tuple(np.roll(ring, 1, axis=0)[::-1] for ring in scenario.obstacles)
    other = Scenario("other", scenario.start, scenario.goal, rings, scenario.bounds)
    assert_same(predict(network, scenario), predict(network, other))


def test_padding_does_not_matter(network: Network) -> None:
    scene = torch_scene(Scenario.load("map_a"))
    b, j, e, _ = scene.edges.shape
    edges, mask = torch.full((b, j + 5, e + 3, 4), 7.0), torch.zeros(b, j + 5, e + 3, dtype=torch.bool)
    edges[:, :j, :e], mask[:, :j, :e] = scene.edges, scene.mask
    with torch.inference_mode():
        assert_same(network(scene), network(Scene(edges, mask, scene.goal, scene.vehicle)))


def test_a_batch_gives_what_its_scenes_give_alone(network: Network) -> None:
    scene = torch_scene(Scenario.load("map_a"))
    twice = scene.each(lambda x: x[[0, 0]])
    with torch.inference_mode():
        alone, both = network(scene), network(twice)
    assert_same(
        Prediction(alone.states[0], alone.duration[0], alone.score[0]),
        Prediction(both.states[1], both.duration[1], both.score[1]),
    )


def test_some_ranks_are_those_of_all_hypotheses(network: Network) -> None:
    scene = torch_scene(Scenario.load("map_a"))
    with torch.inference_mode():
        every = network(scene)
        for ranks in (slice(0, 3), slice(3, None)):
            expected = Prediction(every.states[:, ranks], every.duration[:, ranks], every.score[:, ranks])
            assert_same(network(scene, ranks), expected)
    assert (every.score.diff(dim=1) <= 0).all()


def test_predictions_move_with_the_scene(network: Network) -> None:
    scenario = Scenario.load("map_a")
    turn, shift = 0.7, np.array([3.0, -2.0])
    rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])

    def moved(pose: np.ndarray) -> np.ndarray:
        return np.append(rotation @ pose[:2] + shift, pose[2] + turn)

    rings = tuple(ring @ rotation.T + shift for ring in scenario.obstacles)
    other = Scenario("moved", moved(scenario.start), moved(scenario.goal), rings)
    plain = Scenario("plain", scenario.start, scenario.goal, scenario.obstacles)
    assert_same(predict(network, plain), predict(network, other))


def test_scenes_without_obstacles_have_predictions(network: Network) -> None:
    found = predict(network, Scenario("empty", np.zeros(3), np.array([9.0, 4.0, 1.0])))
    assert torch.isfinite(found.states).all() and torch.isfinite(found.duration).all()


def test_the_default_network_keeps_limits_and_ends() -> None:
    torch.manual_seed(0)
    network = TrajectoryNetwork(new_network(config_of("default")).config)  # type: ignore[arg-type]
    for parameter in network.parameters():
        torch.nn.init.normal_(parameter, std=0.1)
    scenario = Scenario.load("map_a")
    states = predict(network, scenario).states
    goal = torch_scene(scenario).goal[0]
    assert (states[..., 3].abs() <= scenario.vehicle.v_max).all()
    assert (states[..., 4].abs() <= scenario.vehicle.phi_max).all()
    assert (states[..., 0, :] == 0).all() and (states[..., -1, 3:] == 0).all()
    torch.testing.assert_close(states[..., -1, :2], goal[:2].expand_as(states[..., -1, :2]))
    assert (torch.cos(states[..., -1, 2] - goal[2]) > 1 - SAME**2).all()


def driving_in_a_circle(n: int, radius: float, speed: float, duration: float, wheelbase: float) -> torch.Tensor:
    angle = torch.linspace(0.0, speed * duration / radius, n)
    states = torch.zeros(1, n, 5)
    states[0, :, 0], states[0, :, 1], states[0, :, 2] = (
        radius * torch.sin(angle),
        radius - radius * torch.cos(angle),
        angle,
    )
    states[0, :, 3], states[0, :, 4] = speed, math.atan(wheelbase / radius)
    return states


def test_driving_in_a_circle_has_no_defects() -> None:
    states = driving_in_a_circle(200, 6.0, 1.5, 10.0, 2.8)
    vehicle = torch_scene(Scenario.load("map_a")).vehicle
    assert defects(states, torch.tensor([10.0]), vehicle).abs().max() < 1e-4  # 200 chords of 7.5 cm
    assert defects(states, torch.tensor([12.0]), vehicle).abs().max() > 1e-2


def labelled_batch(n: int, points: int) -> Batch:
    rng = torch.Generator().manual_seed(0)
    scene = torch_scene(Scenario.load("map_a"))
    scene = Scene(
        *(part.expand(n, *part.shape[1:]).clone() for part in (scene.edges, scene.mask, scene.goal, scene.vehicle))
    )
    scene.goal[:, :2] += torch.randn(n, 2, generator=rng) * 3
    u = torch.linspace(0.0, 1.0, points)
    states = torch.zeros(n, points, 5)
    states[..., :3] = u[:, None] * scene.goal[:, None]
    states[..., 1] += (torch.randn(n, 1, generator=rng) * 3) * torch.sin(math.pi * u)
    states[..., 3] = torch.sin(math.pi * u)
    return Batch(scene, states, 20 + 5 * torch.rand(n, generator=rng))


def test_gradients_reach_all_parameters(network: Network) -> None:
    loss_of(network, labelled_batch(4, network.config.points), LossWeights())["loss"].backward()
    unreached = [
        name for name, parameter in network.named_parameters() if parameter.grad is None or not parameter.grad.any()
    ]
    assert unreached == []


def test_what_is_outside_far_away_is_outside() -> None:
    corners = 3.3 + np.array([[0.0, 0.0], [4.1, 0.3], [0.7, 2.9]])  # with acute corners
    edges = torch.tensor(np.hstack([corners, np.roll(corners, -1, axis=0)])).float()[None, None]
    angle, distance = torch.meshgrid(torch.linspace(0, 2 * math.pi, 721), torch.logspace(1, 2, 20), indexing="ij")
    points = torch.stack([distance * torch.cos(angle), distance * torch.sin(angle)], dim=-1).reshape(1, -1, 2)
    assert (signed_distance(points, edges, torch.ones(1, 1, 3, dtype=torch.bool)) > 0).all()


def test_what_encloses_a_hole_is_one_obstacle() -> None:
    ring = 4.0 * np.array([(0, 0), (4, 0), (4, 4), (2, 4), (3, 2), (1, 2), (2, 4), (0, 4)])  # the hole touches the rim
    holed = Scenario("holed", np.array([-9.0, 0.0, 0.0]), np.array([30.0, 0.0, 0.0]), (ring,))
    edges, mask = (torch.as_tensor(array)[None] for array in vectors_of(holed))
    points = torch.tensor([[[8.0, 10.0], [8.0, 4.0], [-3.0, 8.0], [8.0, 20.0]]], dtype=torch.double)
    distance = signed_distance(points, edges, mask)  # in the hole, in the wall around it, and outside
    assert distance.shape == (1, 1, 4)
    assert distance[0, 0].tolist() == pytest.approx([2.0, -4.0, 3.0, 4.0], abs=1e-3)


def test_layers_compute_what_those_of_torch_do() -> None:
    torch.manual_seed(0)
    tokens, queries, mask = torch.randn(3, 7, 16), torch.randn(3, 4, 16), torch.rand(3, 7) < 0.7
    mask[:, 0] = True
    sizes: dict[str, Any] = {
        "d_model": 16,
        "nhead": 4,
        "dim_feedforward": 32,
        "dropout": 0.0,
        "batch_first": True,
        "norm_first": True,
    }
    layers = nn.TransformerEncoderLayer(**sizes), nn.TransformerDecoderLayer(**sizes)
    of_encoder, of_decoder = (nested({f"layers.0.{name}": x for name, x in one.state_dict().items()}) for one in layers)
    seen, read = (
        layers[0](tokens, src_key_padding_mask=~mask),
        layers[1](queries, tokens, memory_key_padding_mask=~mask),
    )
    torch.testing.assert_close(encoder(tokens, of_encoder, 4, mask)[mask], seen[mask])
    torch.testing.assert_close(decoder(queries, tokens, of_decoder, 4, mask), read)


def test_an_outline_of_many_edges_beside_others_of_few_is_as_far_as_it_is() -> None:
    beta = np.linspace(0.0, 2 * math.pi, 41)[:-1]
    outline = (6.0 + np.sin(5 * beta))[:, None] * np.column_stack([np.cos(beta), np.sin(beta)])
    box = np.array([[20.0, 0.0], [22.0, 0.0], [22.0, 2.0], [20.0, 2.0]])
    scenario = Scenario("many", np.array([-20.0, 0.0, 0.0]), np.array([50.0, 9.0, 0.0]), (box, outline, box + 9.0))
    edges, mask = (torch.as_tensor(np.stack([array, array])) for array in vectors_of(scenario))
    points = np.random.default_rng(0).uniform(-12.0, 30.0, (2, 200, 2))
    distance = signed_distance(torch.as_tensor(points), edges, mask)
    for ring, found in zip((box, outline, box + 9.0), distance.transpose(0, 1), strict=True):
        polygon, at = shapely.Polygon(ring), shapely.points(points)
        right = shapely.distance(polygon.exterior, at) * np.where(shapely.contains(polygon, at), -1.0, 1.0)
        np.testing.assert_allclose(found, right, atol=1e-6)


def test_a_wall_beside_the_car_counts_as_nearer_than_blocks_farther_off() -> None:
    wall = torch.tensor([[[-50.0, 1.5, 50.0, 1.5]]])  # one edge, its ends far away
    corner = 5.0 * torch.arange(12.0)[:, None]
    block = torch.cat([corner, torch.full_like(corner, 4.0), corner + 1, torch.full_like(corner, 4.0)], dim=1)
    edges = torch.cat([block[:, None], wall])[None]
    scene = Scene(edges, torch.ones(1, 13, 1, dtype=torch.bool), torch.zeros(1, 3), torch.zeros(1, 8))
    poses = torch.zeros(1, 5, 3)
    poses[..., 0] = torch.linspace(0.0, 10.0, 5)
    assert sorted(nearest_obstacles(poses, scene, 4)[0].tolist()) == [0, 1, 2, 12]


def test_an_obstacle_that_is_near_at_one_place_only_counts_as_near() -> None:
    beside_all, beside_first = [-50.0, 4.0, 50.0, 4.0], [0.1, -2.0, 0.0, -2.0]
    edges = torch.tensor([beside_all, beside_first])[None, :, None]
    scene = Scene(edges, torch.ones(1, 2, 1, dtype=torch.bool), torch.zeros(1, 3), torch.zeros(1, 8))
    poses = torch.zeros(1, 5, 3)
    poses[..., 0] = torch.linspace(0.0, 40.0, 5)
    assert nearest_obstacles(poses, scene, 1)[0].tolist() == [1]


@pytest.mark.parametrize(
    "config",
    [
        NetworkConfig(width=32, channels=32, encoder_layers=1, proposer_layers=1, hypotheses=3, refinements=1),
        PaperConfig(hidden=32),
    ],
    ids=CONFIGS,
)
def test_a_small_network_learns_eight_scenes_by_heart(config: NetworkConfig | PaperConfig) -> None:
    torch.manual_seed(0)
    network = new_network(config)
    batch = labelled_batch(8, network.config.points)
    optimiser = torch.optim.Adam(network.parameters(), 3e-3)
    first = loss_of(network, batch, LossWeights())["position"]
    for _ in range(200):
        parts = loss_of(network, batch, LossWeights())
        optimiser.zero_grad()
        parts["loss"].backward()
        optimiser.step()
    assert parts["position"] < 0.25 * first


def test_defects_and_distances_in_a_mirror_are_the_same() -> None:
    batch = labelled_batch(4, 30)
    scene, states = mirrored(batch.scene, batch.states)
    errors = kinematic_errors(batch.states, batch.duration, batch.scene.vehicle)
    torch.testing.assert_close(kinematic_errors(states, batch.duration, scene.vehicle), errors, atol=1e-5, rtol=0)
    distances = signed_distance(batch.states[..., :2], batch.scene.edges, batch.scene.mask)
    torch.testing.assert_close(signed_distance(states[..., :2], scene.edges, scene.mask), distances, atol=1e-4, rtol=0)


def test_weights_and_their_ranking_come_back_from_disk(network: Network, tmp_path: Path) -> None:
    network.ranking = Ranking(0.5, -20.0, -1.0, -10.0, -0.1)
    save_weights(tmp_path / "w.safetensors", trained(network), {"epoch": 3})
    found, about = load_weights(tmp_path / "w.safetensors")
    assert about == {"epoch": 3} and found.ranking == network.ranking
    scenario = Scenario.load("map_a")
    torch.testing.assert_close(
        predict(trainable(found).eval(), scenario).states, predict(network, scenario).states, atol=0, rtol=0
    )


def test_a_trajectory_ends_in_the_turn_that_it_arrives_in() -> None:
    scene = torch_scene(Scenario("task", np.zeros(3), np.array([9.0, 4.0, 1.0])))
    raw = torch.zeros(1, 1, 5, 5)
    raw[..., 2] = 2 * math.pi * torch.linspace(0.0, 1.0, 5) + 0.3
    states = composed(raw, straight_line(scene, 5), scene)
    assert states[0, 0, -1, 2].item() == pytest.approx(1.0 + 2 * math.pi, abs=SAME)


@pytest.mark.parametrize(
    "config",
    [
        NetworkConfig(refinements=1),
        NetworkConfig(encoder_layers=2),
        NetworkConfig(width=64),
        NetworkConfig(heads=7),
        NetworkConfig(channels=64),
        NetworkConfig(points=20),
        PaperConfig(hidden=64),
    ],
    ids=str,
)
def test_weights_of_a_network_of_other_sizes_are_not_weights(
    config: NetworkConfig | PaperConfig, tmp_path: Path
) -> None:
    usual = NetworkConfig() if isinstance(config, NetworkConfig) else PaperConfig()
    save_weights(tmp_path / "w.safetensors", replace(trained(new_network(usual)), config=config), {})
    with pytest.raises(WeightsError, match=r"w\.safetensors: not weights of this version"):
        load_weights(tmp_path / "w.safetensors")


@pytest.mark.parametrize("content", [b"", b"not weights", None])
def test_other_files_are_not_weights(content: bytes | None, tmp_path: Path) -> None:
    path = tmp_path / "w.safetensors"
    if content is None:
        texts = {"kind": "default", "config": '{"size": 3}', "ranking": "{}", "about": "{}", "checksum": ""}
        path.write_bytes(save({"layer": np.zeros(3)}, texts))
    else:
        path.write_bytes(content)
    with pytest.raises(WeightsError, match="w.safetensors"):
        load_weights(path)


def test_the_losses_are_finite_where_a_scene_has_no_obstacles(network: Network) -> None:
    scene = torch_scene(Scenario("empty", np.zeros(3), np.array([9.0, 4.0, 1.0])))
    batch = Batch(scene, torch.zeros(1, 30, 5), torch.tensor([20.0]))
    loss = loss_of(network, batch, LossWeights())["loss"]
    loss.backward()
    assert torch.isfinite(loss)
    assert all(torch.isfinite(p.grad).all() for p in network.parameters() if p.grad is not None)
