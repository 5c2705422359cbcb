"""Scenarios, trajectories and problems that several test files use."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from drake_gnnocp import Scenario, Trajectory, Vehicle
from drake_gnnocp.experiments.dataset.generate import DatasetSettings
from drake_gnnocp.experiments.dataset.label import KEPT, NO_PATH, Label
from drake_gnnocp.experiments.dataset.records import MapRecord
from drake_gnnocp.experiments.tasks.draw import draw_place, draw_tasks
from drake_gnnocp.ocp.costs import CostWeights
from drake_gnnocp.ocp.formulation import Formulation, Line, formulate
from drake_gnnocp.vehicle import State


@pytest.fixture(scope="session")
def gate() -> Scenario:
    """A gate of 3 m between two blocks, off the straight line from start to goal."""
    blocks = ([[6, -8], [8, -8], [8, 0], [6, 0]], [[6, 3], [8, 3], [8, 10], [6, 10]])
    return Scenario(
        "gate",
        np.array([0.0, 0.0, 0.0]),
        np.array([14.0, 0.0, 0.0]),
        tuple(np.array(block, dtype=float) for block in blocks),
        bounds=(-3.0, 20.0, -8.0, 8.0),
    )


@pytest.fixture(scope="session")
def yard() -> Callable[..., Scenario]:
    """Makes a small yard with an L-shaped block and a thin clockwise wall; keywords change fields of it."""

    def make(**changes: Any) -> Scenario:
        ell = np.array([[8.0, 0.0], [14.0, 0.0], [14.0, 2.0], [10.0, 2.0], [10.0, 8.0], [8.0, 8.0]])
        wall = np.array([[0.0, 5.0], [0.0, 9.0], [0.1, 9.0], [0.1, 5.0]])
        fields: dict[str, Any] = {"obstacles": (ell, wall), "bounds": (-5.0, 25.0, -5.0, 12.0)}
        start, goal = np.zeros(3), np.array([20.0, 5.0, 1.0])
        return Scenario(**{"name": "yard", "start": start, "goal": goal, **fields, **changes})

    return make


@pytest.fixture(scope="session")
def left_turn() -> Callable[..., Trajectory]:
    """Makes a drive along a circle to the left in closed form, of constant v and phi, for some seconds."""

    def make(seconds: float = 6.0) -> Trajectory:
        vehicle, v, phi = Vehicle(), 1.0, 0.5
        t = np.linspace(0.0, seconds, 40)
        rate = v * np.tan(phi) / vehicle.wheelbase
        theta = rate * t
        x, y = v / rate * np.sin(theta), v / rate * (1 - np.cos(theta))
        states = np.column_stack([x, y, theta, np.full(40, v), np.full(40, phi)])
        return Trajectory(t, states, np.zeros((40, 2)))

    return make


@pytest.fixture(scope="session")
def small_dataset() -> DatasetSettings:
    """A dataset of a few maps."""
    return DatasetSettings(seed=3, maps=7, pairs=2)


@pytest.fixture(scope="session")
def straight_record() -> Callable[[DatasetSettings, int], MapRecord]:
    """Draws a map of a dataset; every other task is labelled with a straight line instead of a plan."""

    def straight_label(task: Scenario, i: int) -> Label:
        if i % 2:
            return Label(NO_PATH)
        states = np.zeros((120, 5))
        states[:, :3] = np.linspace(task.start, task.goal, 120)
        states[:, State.V] = np.sin(np.linspace(0, np.pi, 120))
        return Label(KEPT, Trajectory(np.linspace(0, 20.0 + i, 120), states, np.zeros((120, 2))), 1.5, 12, 1)

    def record(settings: DatasetSettings, index: int) -> MapRecord:
        place = draw_place(settings.seed, index)
        tasks = draw_tasks(settings.seed, index, place, settings.pairs)
        return MapRecord(index, place, tuple(tasks), tuple(straight_label(task, i) for i, task in enumerate(tasks)))

    return record


@pytest.fixture(scope="session")
def wavy() -> Formulation:
    """The problem around a rough reference of 30 knots, with rows of every kind: obstacles, bounds and two lines."""
    rng = np.random.default_rng(0)
    t = np.linspace(0.0, 6.0, 30)
    states = np.column_stack([t * 1.2, 0.3 * t, 0.2 + 0.1 * t, 1 + 0.1 * t, 0.05 * t]) + rng.normal(0, 0.1, (30, 5))
    reference = Trajectory(t, states, rng.normal(0, 0.2, (30, 2)))
    square = np.array([[1.0, 3.5], [3.0, 3.5], [3.0, 5.5], [1.0, 5.5]])
    triangle = np.array([[4.0, -4.5], [6.0, -3.5], [4.5, -1.5]])
    scenario = Scenario("wavy", states[0, :3], states[-1, :3], (square, triangle), bounds=(-3.0, 13.0, -5.0, 8.0))
    weights = CostWeights(lambda1=0.7, lambda2=1.3)
    return replace(formulate(scenario, reference, weights, margin=0.1), lines=(Line(9, 0, 0.02), Line(20, 1, 0.05)))
