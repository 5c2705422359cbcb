"""Features: the numbers in which the networks see a task and the points of a trajectory."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from drake_gnnocp.learning.arrays import Array, array_namespace
from drake_gnnocp.learning.scene import PHI_MAX, V_MAX, WHEELBASE, Scene, into_frame
from drake_gnnocp.vehicle import State, Vehicle

LENGTH = 10.0  # m, unit of lengths inside the networks
POSE, MOTION = slice(State.X, State.V), slice(State.V, State.PHI + 1)  # columns of states
TASK_FEATURES, POINT_FEATURES = 17, 28
USUAL_VEHICLE = np.array(list(Vehicle().to_dict().values()))


def task_features(scene: Scene) -> Array:
    """Goal and vehicle: (B, TASK_FEATURES)."""
    xp = array_namespace(scene.goal)
    x, y, theta = (scene.goal[:, i] for i in range(3))
    distance = xp.hypot(x, y)
    start = into_frame(xp.zeros_like(scene.goal[:, :2]), scene.goal)  # the start seen from the goal
    pose = xp.stack([x, y, start[:, 0], start[:, 1], distance], axis=1) / LENGTH
    angles = xp.stack([xp.cos(theta), xp.sin(theta), theta, xp.log1p(distance)], axis=1)
    usual = xp.asarray(USUAL_VEHICLE, dtype=scene.vehicle.dtype)
    return xp.concat([pose, angles, 5 * (scene.vehicle / usual - 1)], axis=1)


@lru_cache(maxsize=4)
def clock(points: int) -> np.ndarray:
    """Where a point is on the way from 0 at the start to 1 at the goal, and waves of that: (T, 7)."""
    u = np.linspace(0.0, 1.0, points)
    waves = [wave(2 * math.pi * n * u) for n in (1, 2) for wave in (np.cos, np.sin)]
    return np.stack([u, u * (1 - u), np.cos(math.pi * u), *waves], axis=-1)


def point_features(states: Array, duration: Array, scene: Scene) -> Array:
    """Each point, its place on the way, and defects and changes to its neighbours: (B, T, POINT_FEATURES)."""
    xp = array_namespace(states)
    b, n = states.shape[:2]
    dt = (duration / (n - 1))[:, None]
    x, y, theta, v, phi = (states[..., column] for column in State)
    defect = defects(states, duration, scene.vehicle)  # (B, T - 1, 3)
    zero = xp.zeros_like(defect[:, :1])
    before, after = xp.concat([zero, defect], axis=1), xp.concat([defect, zero], axis=1)
    goal = into_frame(states[..., :2], scene.goal)
    turn = theta - scene.goal[:, 2:]
    v_max, phi_max = scene.vehicle[:, [V_MAX]], scene.vehicle[:, [PHI_MAX]]
    motion = states[..., MOTION]
    change = xp.concat([xp.zeros_like(motion[:, :1]), motion[:, 1:] - motion[:, :-1]], axis=1)
    columns = [
        x / LENGTH, y / LENGTH, goal[..., 0] / LENGTH, goal[..., 1] / LENGTH, xp.cos(theta), xp.sin(theta),
        xp.cos(turn), xp.sin(turn), theta, v / v_max, phi / phi_max, xp.broadcast_to(xp.log(dt), (b, n)), dt * v,
    ]  # fmt: skip
    waves = xp.broadcast_to(xp.asarray(clock(n), dtype=states.dtype), (b, n, clock(n).shape[1]))
    return xp.concat([xp.stack(columns, axis=-1), waves, change, before, after], axis=-1)


def defects(states: Array, duration: Array, vehicle: Array) -> Array:
    """Defects of the kinematic model between points, in the car's frame.

    Args:
        states: (B, ..., T, 5).
        duration: (B, ...) [s].
        vehicle: (B, 8).

    Returns:
        (B, ..., T - 1, 3) along, across, turn [m, m, rad].
    """
    xp = array_namespace(states)
    dt = (duration / (states.shape[-2] - 1))[..., None]
    left, right = states[..., :-1, :], states[..., 1:, :]
    wheelbase = vehicle[:, WHEELBASE].reshape((-1, *[1] * (states.ndim - 2)))
    mean = (left + right) / 2
    theta, v = mean[..., State.THETA], mean[..., State.V]
    turn = left[..., State.V] * xp.tan(left[..., State.PHI]) + right[..., State.V] * xp.tan(right[..., State.PHI])
    step = right - left
    cos, sin = xp.cos(theta), xp.sin(theta)
    along = cos * step[..., 0] + sin * step[..., 1] - v * dt
    across = cos * step[..., 1] - sin * step[..., 0]
    return xp.stack([along, across, step[..., 2] - turn / (2 * wheelbase) * dt], axis=-1)
