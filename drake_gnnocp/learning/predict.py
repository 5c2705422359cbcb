"""From a scenario to guesses: the network's hypotheses as trajectories, the most promising first."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from drake_gnnocp.learning.checkpoint import Network
from drake_gnnocp.learning.losses import disc_distance
from drake_gnnocp.learning.network import Prediction, defects
from drake_gnnocp.learning.scene import Scene, scene_of
from drake_gnnocp.learning.spline import spline_matrices
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import State, Vehicle


@dataclass(frozen=True)
class RankWeights:
    """What makes a hypothesis unattractive, in units of the score's logits."""

    gap: float = 4.0  # a metre (or radian) of mean kinematic error between points
    depth: float = 3.0  # a metre of mean depth in obstacles, over the trajectory
    duration: float = 0.0  # a second


def guesses(network: Network, scenario: Scenario, n_knots: int, weights: RankWeights | None = None) -> list[Trajectory]:
    """Trajectories of n_knots equally spaced knots in the scenario's frame, the most promising first.

    Args:
        network: ready for use.
        scenario: near the origin.
        n_knots: of each trajectory.
        weights: of the ranking.
    """
    scene = scene_of(scenario)
    with torch.inference_mode():
        prediction = network(scene)
        order = torch.argsort(ranking(prediction, scene, weights or RankWeights())[0], descending=True)
    states, duration = prediction.states[0].double().numpy(), prediction.duration[0].double().numpy()
    return [interpolated(states[k], float(duration[k]), scenario, n_knots) for k in order.tolist()]


def ranking(prediction: Prediction, scene: Scene, weights: RankWeights) -> torch.Tensor:
    """How promising every hypothesis is, (B, K): its score less what is wrong with it."""
    b, k = prediction.score.shape
    rows = torch.arange(b).repeat_interleave(k)
    gap = defects(prediction.states, prediction.duration, scene.vehicle).abs().mean(dim=(-1, -2))
    clearance = disc_distance(prediction.states.flatten(0, 1), scene.subset(rows)).unflatten(0, (b, k))
    half_width = scene.vehicle[:, 3] / 2
    depth = torch.relu(half_width[:, None, None, None] - clearance).mean(dim=(-1, -2))
    return prediction.score - weights.gap * gap - weights.depth * depth - weights.duration * prediction.duration


def interpolated(points: np.ndarray, duration: float, scenario: Scenario, n_knots: int) -> Trajectory:
    """Predicted points (T, 5) in the start's frame as a trajectory in the scenario's, from its start to its goal.

    Inputs are the derivatives of v and phi, as in the paper, cut to the limits.
    """
    values, derivatives = spline_matrices(len(points), n_knots)
    states, rates = values @ points, derivatives @ points / duration
    vehicle = scenario.vehicle
    limits = np.array([vehicle.a_max, vehicle.w_max])
    inputs = rates[:, State.V :].clip(-limits, limits)
    states = into_world(states, scenario.start)
    turns = np.round((states[-1, State.THETA] - scenario.goal[State.THETA]) / (2 * np.pi))
    states[0, :3], states[-1, :3] = scenario.start, scenario.goal + [0.0, 0.0, 2 * np.pi * turns]
    states[:, State.V :] = within_limits(states[:, State.V :], vehicle)
    states[[0, -1], State.V :] = inputs[[0, -1]] = 0.0
    return Trajectory(np.linspace(0.0, duration, n_knots), states, inputs)


def into_world(states: np.ndarray, start: np.ndarray) -> np.ndarray:
    """States (N, 5) in the frame of a start pose (3,) seen from the world."""
    cos, sin = np.cos(start[2]), np.sin(start[2])
    world = states.copy()
    world[:, State.X] = start[0] + cos * states[:, State.X] - sin * states[:, State.Y]
    world[:, State.Y] = start[1] + sin * states[:, State.X] + cos * states[:, State.Y]
    world[:, State.THETA] += start[2]
    return world


def within_limits(motion: np.ndarray, vehicle: Vehicle) -> np.ndarray:
    """V and phi (N, 2) cut to the limits."""
    limits = np.array([vehicle.v_max, vehicle.phi_max])
    return motion.clip(-limits, limits)
