"""A plan to draw: a small yard and a turn to the left in it."""

from __future__ import annotations

import numpy as np

from drake_gnnocp.scenario import Scenario
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import Vehicle

ROUNDING = 1e-9  # sums of a few doubles of size 10
FAR_ROUNDING = 1e-5  # m, doubles near 1e10 are 2e-6 apart
FAR = (7.0e9 + 0.3, -8.7e9)  # m, the kind of world coordinates some benchmarks use

ELL = np.array([[8.0, 0.0], [14.0, 0.0], [14.0, 2.0], [10.0, 2.0], [10.0, 8.0], [8.0, 8.0]])
WALL = np.array([[0.0, 5.0], [0.0, 9.0], [0.1, 9.0], [0.1, 5.0]])  # clockwise and thin


def left_turn(seconds: float = 6.0) -> Trajectory:
    """Drive a quarter of a circle to the left, in closed form: v and phi are constant."""
    vehicle, v, phi = Vehicle(), 1.0, 0.5
    t = np.linspace(0.0, seconds, 40)
    rate = v * np.tan(phi) / vehicle.wheelbase
    theta = rate * t
    x, y = v / rate * np.sin(theta), v / rate * (1 - np.cos(theta))
    states = np.column_stack([x, y, theta, np.full(40, v), np.full(40, phi)])
    return Trajectory(t, states, np.zeros((40, 2)))


def scenario(**changes: object) -> Scenario:
    fields: dict = {
        "name": "yard",
        "start": np.zeros(3),
        "goal": np.array([20.0, 5.0, 1.0]),
        "obstacles": (ELL, WALL),
        "bounds": (-5.0, 25.0, -5.0, 12.0),
    }
    return Scenario(**{**fields, **changes})
