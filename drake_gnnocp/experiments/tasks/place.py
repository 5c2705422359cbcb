"""A place: obstacles, where start and goal may be, and the car that drives there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drake_gnnocp.vehicle import Vehicle

KINDS = ("open", "car_park", "yard")


@dataclass(frozen=True)
class Place:
    """A map without a task."""

    kind: str  # one of KINDS
    area: tuple[float, float, float, float]  # m, xmin, xmax, ymin, ymax: start and goal lie inside
    obstacles: tuple[np.ndarray, ...]  # rings (N_j, 2) [m]
    slots: tuple[np.ndarray, ...]  # goal poses (3,) of free parking slots, collision-free for `vehicle` [m, m, rad]
    vehicle: Vehicle
