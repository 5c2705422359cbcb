"""Scenes as a network that learns sees them."""

from __future__ import annotations

import torch

from drake_gnnocp.learning.scene import Scene, scene_of
from drake_gnnocp.scenario import Scenario


def torch_scene(scenario: Scenario) -> Scene:
    """One scenario as a batch of one scene, as tensors."""
    return scene_of(scenario).each(torch.from_numpy)
