"""From a scenario to guesses: the network's hypotheses as trajectories, the most promising first."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import torch

from drake_gnnocp.learning.checkpoint import Network
from drake_gnnocp.learning.features import defects
from drake_gnnocp.learning.network import Prediction
from drake_gnnocp.learning.scene import (
    WIDTH,
    Scene,
    mirrored,
    out_of_frame,
    reversed_in_time,
    scene_of,
    turned_around,
)
from drake_gnnocp.learning.spline import spline_matrices
from drake_gnnocp.learning.surroundings import signed_distance, stations
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import State, Vehicle

LIKELIEST, LESS_LIKELY = slice(0, 4), slice(4, None)  # ranks by the network's score: what is refined first, and later
VIEWS = ((False, True), (True, False), (True, True))  # mirrored, turned around


@dataclass(frozen=True)
class RankWeights:
    """What makes a hypothesis promising: a logistic regression of "its convex steps settle" on validation maps."""

    score: float = 0.16  # a logit of the network's own score
    gap: float = -27.0  # a metre (or radian) of mean kinematic error from point to point
    largest_gap: float = -0.35  # a metre (or radian) of the largest
    depth: float = -16.0  # a metre of mean depth in obstacles, over the points
    duration: float = -0.03  # a second


RANK_WEIGHTS = RankWeights()


def guesses(
    network: Network, scenario: Scenario, n_knots: int, weights: RankWeights = RANK_WEIGHTS
) -> Iterator[Trajectory]:
    """Trajectories of n_knots equally spaced knots in the scenario's frame, the most promising first.

    The likeliest of the scene as it is come first: refining is what takes time. After them, where they are asked for,
    come the less likely, and the network looks at the scene in a mirror and the other way round as well: four views,
    each with its own hypotheses.

    Args:
        network: ready for use.
        scenario: near the origin.
        n_knots: of each trajectory.
        weights: of the ranking.
    """
    scene = scene_of(scenario)
    for states, duration, _ in _hypotheses(network, scene, weights, LIKELIEST):
        yield interpolated(states, duration, scenario, n_knots)
    views = _hypotheses(network, scene, weights, LESS_LIKELY)
    for mirror, turn in VIEWS:
        views += _hypotheses(network, scene, weights, mirror=mirror, turn=turn)
    for states, duration, _ in sorted(views, key=lambda each: each[2], reverse=True):
        yield interpolated(states, duration, scenario, n_knots)


@torch.inference_mode()
def _hypotheses(
    network: Network,
    scene: Scene,
    weights: RankWeights,
    ranks: slice = slice(None),
    mirror: bool = False,
    turn: bool = False,
) -> list[tuple[np.ndarray, float, float]]:
    """Hypotheses for one scene from one view of it, in the scene's frame, best first: points (T, 5), duration, rank."""
    seen = turned_around(scene) if turn else scene
    seen = mirrored(seen, seen.goal.new_zeros(1, 1, 5))[0] if mirror else seen
    prediction = network(seen, ranks)
    states = prediction.states
    states = mirrored(seen, states)[1] if mirror else states
    if turn:
        states = out_of_frame(reversed_in_time(states), scene.goal)
        turns = torch.round(states[..., :1, 2] / (2 * torch.pi))
        states[..., 2] -= 2 * torch.pi * turns
    promise = ranking(replace(prediction, states=states), scene, weights)[0]
    points, durations, rank = states[0].double().cpu().numpy(), prediction.duration[0].tolist(), promise.tolist()
    return [(points[k], durations[k], rank[k]) for k in torch.argsort(promise, descending=True).tolist()]


def ranking(prediction: Prediction, scene: Scene, weights: RankWeights) -> torch.Tensor:
    """How promising every hypothesis is: (B, K)."""
    gap = defects(prediction.states, prediction.duration, scene.vehicle).abs()
    discs = stations(prediction.states[..., :3].flatten(1, 2), scene.vehicle)  # (B, K T, S, 2)
    clearance = signed_distance(discs.flatten(1, 2), scene.edges, scene.mask).amin(dim=1)  # (B, K T S)
    depth = torch.relu(scene.vehicle[:, [WIDTH]] / 2 - clearance)
    depth = depth.unflatten(1, (*prediction.states.shape[1:3], discs.shape[2])).mean(dim=(-1, -2))
    return (
        weights.score * prediction.score
        + weights.gap * gap.mean(dim=(-1, -2))
        + weights.largest_gap * gap.amax(dim=(-1, -2))
        + weights.depth * depth
        + weights.duration * prediction.duration
    )


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
