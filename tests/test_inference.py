"""What plans are made with, numpy, computes the same as torch does, with which the network learns."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch_scenes import torch_scene

from drake_gnnocp.guesses.learned import bundled_weights
from drake_gnnocp.learning.checkpoint import Trained, load_weights
from drake_gnnocp.learning.ranking import rank_features
from drake_gnnocp.learning.scene import scene_of
from drake_gnnocp.learning.trainable import trainable
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.vehicle import Vehicle

SAME = 1e-5  # relative to the largest number: single precision through some 30 layers
SCENES = 200
LARGEST, CAR = 3.0, 5.0  # m, radius of an obstacle, and what is left free around start and goal


@pytest.fixture(scope="module")
def trained() -> Trained:
    return load_weights(bundled_weights())[0]


def drawn(seed: int) -> Scenario:
    """A scene of up to 20 star-shaped obstacles of 3 to 80 vertices, some that cross each other, for some vehicle."""
    rng = np.random.default_rng(seed)
    start, goal = rng.uniform((-3, -3, -np.pi), (3, 3, np.pi)), rng.uniform((5, 5, -np.pi), (40, 40, np.pi))
    rings = []
    for centre in rng.uniform(-5, 45, (rng.integers(0, 21), 2)):
        vertices = rng.integers(3, 12) if rng.random() < 0.9 else 80
        angle = (np.arange(vertices) + rng.uniform(0.0, 0.4, vertices)) * 2 * np.pi / vertices
        radius = rng.uniform(0.5, LARGEST) * rng.uniform(0.6, 1.0, vertices)
        if min(np.linalg.norm(centre - end[:2]) for end in (start, goal)) > LARGEST + CAR:
            rings.append(centre + radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]))
    bounds = (-9.0, 50.0, -9.0, 50.0) if rng.random() < 0.5 else None
    vehicle = Vehicle(wheelbase=rng.uniform(2.2, 3.5), v_max=rng.uniform(1.0, 4.0), width=rng.uniform(1.6, 2.2))
    return Scenario(f"drawn {seed}", start, goal, tuple(rings), bounds, vehicle)


def test_numpy_predicts_what_torch_does(trained: Trained) -> None:
    module = trainable(trained).eval()
    for seed in range(SCENES):
        scenario = drawn(seed)
        scene, tensors = scene_of(scenario), torch_scene(scenario)
        found = trained(scene)
        with torch.inference_mode():
            expected = module(tensors)
        for name in ("states", "duration", "score"):
            ours, theirs = getattr(found, name), getattr(expected, name).numpy()
            assert ours.dtype == theirs.dtype == np.float32
            assert np.abs(ours - theirs).max() < SAME * np.abs(theirs).max(), (scenario.name, name)
        # of the same points: which side of an obstacle a point is on may hang on its last digit
        features = rank_features(found.states, found.duration, found.score, scene)
        states, duration, score = map(torch.from_numpy, (found.states, found.duration, found.score))
        same = rank_features(states, duration, score, tensors).numpy()
        assert np.abs(features - same).max() < SAME * np.abs(same).max()


def test_weights_come_back_from_a_module_as_they_were(trained: Trained) -> None:
    state = trainable(trained).state_dict()
    assert set(state) == set(trained.arrays)
    for name, array in trained.arrays.items():
        np.testing.assert_array_equal(state[name].numpy(), array)
