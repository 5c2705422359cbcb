r"""From a scenario to guesses: the network's hypotheses as trajectories, the most promising first.

Between the predicted points run clamped cubic splines, which start and end with zero slope: the car rests at both ends.
A spline through P equally spaced values y is linear in them. With u in [0, 1] from the first point to the last, the
slopes s at the points satisfy s_0 = s_{P-1} = 0 and, for d = 1 / (P - 1),

    s_{i-1} + 4 s_i + s_{i+1} = 3 (y_{i+1} - y_{i-1}) / d,

and between two points the Hermite cubic takes their values and slopes. Interpolated like this, points of an optimum
took the solver half the iterations that linear interpolation took.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from drake_gnnocp.learning.checkpoint import Trained
from drake_gnnocp.learning.ranking import rank_features
from drake_gnnocp.learning.scene import (
    Scene,
    goal_of,
    mirrored,
    out_of_frame,
    reversed_in_time,
    scene_of,
    turned_around,
)
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import State

LIKELIEST, LESS_LIKELY = slice(0, 4), slice(4, None)  # ranks by the network's score: what is refined first, and later
VIEWS = ((False, True), (True, False), (True, True))  # mirrored, turned around


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """One predicted trajectory of a scene, in the frame of its start."""

    points: np.ndarray  # (T, 5) x, y, theta, v, phi at equal steps [m, m, rad, m/s, rad]
    duration: float  # s
    features: np.ndarray  # (N_FEATURES,) see `rank_features`
    promise: float  # see `Ranking`
    probability: float | None  # that the planner's SQP steps from it converge


def guesses(network: Trained, scenario: Scenario, n_knots: int) -> Iterator[Trajectory]:
    """The hypotheses in turn as trajectories of n_knots equally spaced knots in the scenario's frame.

    Args:
        network: ready for use.
        scenario: near the origin.
        n_knots: of each trajectory.
    """
    for hypothesis in hypotheses(network, scenario):
        yield interpolated(hypothesis.points, hypothesis.duration, scenario, n_knots)


def hypotheses(network: Trained, scenario: Scenario) -> Iterator[Hypothesis]:
    """The network's hypotheses, the most promising first.

    The likeliest of the scene as it is come first: refining is what takes time. After them, where they are asked for,
    come the less likely, and the network looks at the scene in a mirror and the other way round as well: four views,
    each with its own hypotheses.
    """
    scene = scene_of(scenario)
    yield from _best_first(_seen_from(network, scene, LIKELIEST))
    others = _seen_from(network, scene, LESS_LIKELY)
    for mirror, turn in VIEWS:
        others += _seen_from(network, scene, mirror=mirror, turn=turn)
    yield from _best_first(others)


def first_looks(network: Trained, scene_task: Scenario, tasks: Sequence[Scenario], n_knots: int) -> list[Trajectory]:
    """The most promising of the likeliest hypotheses for each of several goals in one scene, in one pass.

    Args:
        network: ready for use.
        scene_task: whose obstacles are looked at, near the origin.
        tasks: (C,) with the same start and vehicle, of which the goals are looked at.
        n_knots: of each trajectory.
    """
    one, n = scene_of(scene_task), len(tasks)
    goals = np.concatenate([goal_of(task) for task in tasks])
    scene = replace(one.each(lambda x: np.repeat(x, n, axis=0)), goal=goals)
    prediction = network(scene, LIKELIEST)
    features = rank_features(prediction.states, prediction.duration, prediction.score, scene)
    best = network.ranking.promise(features).argmax(axis=1).tolist()
    return [
        interpolated(prediction.states[i, k].astype(float), float(prediction.duration[i, k]), task, n_knots)
        for i, (k, task) in enumerate(zip(best, tasks, strict=True))
    ]


def _best_first(found: list[Hypothesis]) -> list[Hypothesis]:
    return sorted(found, key=lambda hypothesis: hypothesis.promise, reverse=True)


def _seen_from(
    network: Trained, scene: Scene, ranks: slice = slice(None), mirror: bool = False, turn: bool = False
) -> list[Hypothesis]:
    """Hypotheses for one scene from one view of it, in the scene's frame."""
    view = turned_around(scene) if turn else scene
    view = mirrored(view, np.zeros((1, 1, len(State)), np.float32))[0] if mirror else view
    prediction = network(view, ranks)
    states = prediction.states
    states = mirrored(view, states)[1] if mirror else states
    if turn:
        states = out_of_frame(reversed_in_time(states), scene.goal)
        states[..., State.THETA] -= 2 * np.pi * np.round(states[..., :1, State.THETA] / (2 * np.pi))
    features = rank_features(states, prediction.duration, prediction.score, scene)[0]
    promise = network.ranking.promise(features).tolist()
    probability = map(network.ranking.probability, promise)
    points, durations = states[0].astype(float), prediction.duration[0].tolist()
    return [Hypothesis(*row) for row in zip(points, durations, features, promise, probability, strict=True)]


def interpolated(points: np.ndarray, duration: float, scenario: Scenario, n_knots: int) -> Trajectory:
    """Predicted points (T, 5) in the start's frame as a trajectory in the scenario's, from its start to its goal.

    Inputs are the derivatives of v and phi, as in the paper; v, phi and the inputs are cut to the limits.
    """
    values, derivatives = spline_matrices(len(points), n_knots)
    local, rates = values @ points, derivatives @ points / duration
    vehicle, (x0, y0, theta0) = scenario.vehicle, scenario.start
    cos, sin = np.cos(theta0), np.sin(theta0)
    states = local.copy()
    states[:, State.X] = x0 + cos * local[:, State.X] - sin * local[:, State.Y]
    states[:, State.Y] = y0 + sin * local[:, State.X] + cos * local[:, State.Y]
    states[:, State.THETA] += theta0
    turns = np.round((states[-1, State.THETA] - scenario.goal[State.THETA]) / (2 * np.pi))
    states[0, :3], states[-1, :3] = scenario.start, scenario.goal + [0.0, 0.0, 2 * np.pi * turns]
    most_motion, most_input = np.array([vehicle.v_max, vehicle.phi_max]), np.array([vehicle.a_max, vehicle.w_max])
    states[:, State.V :] = states[:, State.V :].clip(-most_motion, most_motion)
    inputs = rates[:, State.V :].clip(-most_input, most_input)
    states[[0, -1], State.V :] = inputs[[0, -1]] = 0.0
    return Trajectory(np.linspace(0.0, duration, n_knots), states, inputs)


@lru_cache(maxsize=16)
def spline_matrices(points: int, knots: int) -> tuple[np.ndarray, np.ndarray]:
    """Matrices (knots, points) that give a spline's values, and its derivatives with respect to u, at equal steps."""
    d = 1.0 / (points - 1)
    left, right = np.eye(points), np.zeros((points, points))
    for i in range(1, points - 1):
        left[i, [i - 1, i, i + 1]] = 1.0, 4.0, 1.0
        right[i, [i - 1, i + 1]] = -3.0 / d, 3.0 / d
    slopes = np.linalg.solve(left, right)
    u = np.linspace(0.0, 1.0, knots)
    i = np.minimum((u / d).astype(int), points - 2)
    t = (u / d - i)[:, None]
    identity = np.eye(points)
    values = (
        (1 + 2 * t) * (1 - t) ** 2 * identity[i]
        + t**2 * (3 - 2 * t) * identity[i + 1]
        + d * (t * (1 - t) ** 2 * slopes[i] - t**2 * (1 - t) * slopes[i + 1])
    )
    derivatives = (
        6 * t * (1 - t) / d * (identity[i + 1] - identity[i])
        + (1 - t) * (1 - 3 * t) * slopes[i]
        + t * (3 * t - 2) * slopes[i + 1]
    )
    return values, derivatives
