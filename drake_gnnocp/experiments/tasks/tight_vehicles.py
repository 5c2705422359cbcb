"""Vehicles of tight places: cars, vans, trucks and robots, quick and slow ones."""

from __future__ import annotations

import math

import numpy as np

from drake_gnnocp.experiments.tasks.place import VehicleOptions, random_vehicle
from drake_gnnocp.experiments.tasks.shapes import Range
from drake_gnnocp.vehicle import Vehicle

CAR = VehicleOptions(default=0.0, v_max=(1.0, 3.0))
LONG = VehicleOptions(
    default=0.0,
    wheelbase=(3.2, 5.0),
    front_hang=(0.8, 1.4),
    rear_hang=(0.9, 2.0),
    width=(1.95, 2.45),
    v_max=(1.0, 3.0),
    a_max=(0.4, 1.5),
    phi_max=(0.55, 0.8),
    w_max=(0.3, 0.8),
)
ROBOT = VehicleOptions(  # as long as a car: it is made smaller afterwards
    default=0.0,
    wheelbase=(2.2, 3.4),
    front_hang=(0.5, 1.2),
    rear_hang=(0.5, 1.2),
    width=(1.9, 3.0),
    v_max=(1.0, 4.0),
    a_max=(0.5, 3.0),
    phi_max=(0.6, 0.9),
    w_max=(0.5, 1.5),
)
ROBOT_SCALE = (0.05, 0.5)  # drawn by its logarithm
SHARES = (0.35, 0.3, 0.15, 0.2)  # of the paper's car, cars, long vehicles, robots
PACE = 0.25  # share of the vehicles that are much quicker or slower than they were drawn ...
PACES = (0.2, 3.0)  # ... by a factor on their speed, drawn by its logarithm


def random_tight_vehicle(rng: np.random.Generator) -> Vehicle:
    """A vehicle of a kind drawn at random."""
    kind = int(rng.choice(len(SHARES), p=SHARES))
    vehicle = Vehicle() if kind == 0 else random_vehicle(rng, (CAR, LONG, ROBOT)[kind - 1])
    if kind == 3:
        vehicle = vehicle.scaled(log_uniform(rng, ROBOT_SCALE))
    if rng.uniform() < PACE:
        pace = log_uniform(rng, PACES)
        changed = vehicle.to_dict() | {"v_max": vehicle.v_max * pace, "a_max": vehicle.a_max * pace}
        vehicle = Vehicle(**changed)
    return vehicle


def log_uniform(rng: np.random.Generator, bounds: Range) -> float:
    """A number between two, whose logarithm is uniform."""
    low, high = map(math.log, bounds)
    return math.exp(rng.uniform(low, high))
