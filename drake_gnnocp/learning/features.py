"""Features: the numbers in which the networks see a task and the points of a trajectory."""

from __future__ import annotations

import math
from functools import lru_cache

import torch
from torch import Tensor

from drake_gnnocp.learning.scene import PHI_MAX, V_MAX, WHEELBASE, Scene, into_frame
from drake_gnnocp.vehicle import State, Vehicle

LENGTH = 10.0  # m, unit of lengths inside the networks
POSE, MOTION = slice(State.X, State.V), slice(State.V, State.PHI + 1)  # columns of states
TASK_FEATURES, POINT_FEATURES = 17, 28
USUAL_VEHICLE = torch.tensor(list(Vehicle().to_dict().values()))


def task_features(scene: Scene) -> Tensor:
    """Goal and vehicle: (B, TASK_FEATURES)."""
    x, y, theta = scene.goal.unbind(dim=1)
    distance = torch.hypot(x, y)
    start = into_frame(torch.zeros_like(scene.goal[:, :2]), scene.goal)  # the start seen from the goal
    pose = torch.stack([x, y, start[:, 0], start[:, 1], distance], dim=1) / LENGTH
    angles = torch.stack([torch.cos(theta), torch.sin(theta), theta, torch.log1p(distance)], dim=1)
    return torch.cat([pose, angles, 5 * (scene.vehicle / USUAL_VEHICLE.to(scene.vehicle) - 1)], dim=1)


@lru_cache(maxsize=4)
@torch.inference_mode(False)
def clock(points: int) -> Tensor:
    """Where a point is on the way from 0 at the start to 1 at the goal, and waves of that: (T, 7)."""
    u = torch.linspace(0.0, 1.0, points)
    waves = [wave(2 * math.pi * n * u) for n in (1, 2) for wave in (torch.cos, torch.sin)]
    return torch.stack([u, u * (1 - u), torch.cos(math.pi * u), *waves], dim=-1)


def point_features(states: Tensor, duration: Tensor, scene: Scene) -> Tensor:
    """Each point, its place on the way, and defects and changes to its neighbours: (B, T, POINT_FEATURES)."""
    n = states.shape[1]
    dt = (duration / (n - 1))[:, None]
    x, y, theta, v, phi = states.unbind(dim=-1)
    defect = defects(states, duration, scene.vehicle)  # (B, T - 1, 3)
    zero = torch.zeros_like(defect[:, :1])
    before, after = torch.cat([zero, defect], dim=1), torch.cat([defect, zero], dim=1)
    goal = into_frame(states[..., :2], scene.goal)
    turn = theta - scene.goal[:, 2:]
    v_max, phi_max = scene.vehicle[:, [V_MAX]], scene.vehicle[:, [PHI_MAX]]
    change = torch.diff(states[..., MOTION], dim=1, prepend=states[:, :1, MOTION])
    columns = [
        x / LENGTH, y / LENGTH, goal[..., 0] / LENGTH, goal[..., 1] / LENGTH, torch.cos(theta), torch.sin(theta),
        torch.cos(turn), torch.sin(turn), theta, v / v_max, phi / phi_max, torch.log(dt).expand_as(x), dt * v,
    ]  # fmt: skip
    waves = clock(n).to(states).expand(len(states), -1, -1)
    return torch.cat([torch.stack(columns, dim=-1), waves, change, before, after], dim=-1)


def defects(states: Tensor, duration: Tensor, vehicle: Tensor) -> Tensor:
    """Defects of the kinematic model between points, in the car's frame.

    Args:
        states: (B, ..., T, 5).
        duration: (B, ...) [s].
        vehicle: (B, 8).

    Returns:
        (B, ..., T - 1, 3) along, across, turn [m, m, rad].
    """
    dt = (duration / (states.shape[-2] - 1))[..., None]
    left, right = states[..., :-1, :], states[..., 1:, :]
    wheelbase = vehicle[:, WHEELBASE].reshape(-1, *[1] * (states.dim() - 2))
    mean = (left + right) / 2
    theta, v = mean[..., State.THETA], mean[..., State.V]
    turn = left[..., State.V] * torch.tan(left[..., State.PHI]) + right[..., State.V] * torch.tan(right[..., State.PHI])
    step = right - left
    cos, sin = torch.cos(theta), torch.sin(theta)
    along = cos * step[..., 0] + sin * step[..., 1] - v * dt
    across = cos * step[..., 1] - sin * step[..., 0]
    return torch.stack([along, across, step[..., 2] - turn / (2 * wheelbase) * dt], dim=-1)
