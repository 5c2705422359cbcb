"""Trajectories as tables whose x and y belong to a reference point, CSV and JSON.

The planner's point is the middle of the rear axle. The centre of the car's rectangle is d ahead of it,

    x_centre = x + d cos(theta),  y_centre = y + d sin(theta),  d = (wheelbase + front_hang - rear_hang) / 2

All other columns are the same for both: v is the speed of the rear axle, whose way is along the heading.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from drake_gnnocp.files import write_atomically
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.trajectory import COLUMNS, Trajectory
from drake_gnnocp.vehicle import State, Vehicle

REAR_AXLE, CENTRE = "rear_axle", "centre"
REFERENCES = (REAR_AXLE, CENTRE)
UNITS = dict(zip(COLUMNS, ("s", "m", "m", "rad", "m/s", "rad", "m/s^2", "rad/s"), strict=True))


def centre_offset(vehicle: Vehicle) -> float:
    """d: from the middle of the rear axle forward to the centre of the car's rectangle [m]."""
    return (vehicle.wheelbase + vehicle.front_hang - vehicle.rear_hang) / 2


def save_centre_csv(path: Path, trajectory: Trajectory, vehicle: Vehicle) -> None:
    """Write a trajectory as `Trajectory.save_csv` does, with x and y of the centre: the header says so."""
    rows = _table(trajectory, vehicle, CENTRE)
    lines = [",".join(_names(CENTRE)), *(",".join(map(repr, row)) for row in rows.tolist())]
    write_atomically(path, "\n".join(lines) + "\n")


def save_json(path: Path, scenario: Scenario, trajectory: Trajectory, status: str, reference: str) -> None:
    """Write a trajectory as JSON that says what its numbers mean.

    Args:
        path: where to.
        scenario: whose it is.
        trajectory: in the scenario's frame, of equally spaced rows.
        status: of the plan; only a "verified" one may be driven.
        reference: one of REFERENCES, what x and y are those of.
    """
    ahead = centre_offset(scenario.vehicle) if reference == CENTRE else 0.0
    data: dict[str, Any] = {
        "scenario": scenario.name,
        "status": status,
        "frame": "the scenario's: x and y in m, theta counter-clockwise from the x axis, t from the start",
        "reference_point": reference,
        "reference_ahead_of_rear_axle_m": ahead,
        "rate_hz": round((len(trajectory) - 1) / trajectory.duration, 9),
        "between_rows": "a and w are linear in time",
        "vehicle": scenario.vehicle.to_dict(),
        "columns": [{"name": name, "unit": unit} for name, unit in zip(_names(reference), UNITS.values(), strict=True)],
    }
    rows = ",\n".join(f"  {json.dumps(row)}" for row in _table(trajectory, scenario.vehicle, reference).tolist())
    head = json.dumps(data, indent=1, allow_nan=False).removesuffix("\n}")
    write_atomically(path, f'{head},\n "rows": [\n{rows}\n ]\n}}\n')


def _names(reference: str) -> Sequence[str]:
    """Names of the columns: those of the centre cannot be mistaken for the rear axle's."""
    return [f"{name}_centre" if reference == CENTRE and name in ("x", "y") else name for name in COLUMNS]


def _table(trajectory: Trajectory, vehicle: Vehicle, reference: str) -> np.ndarray:
    """One row (8,) for every row of the trajectory, in the order of COLUMNS."""
    states = trajectory.states.copy()
    if reference == CENTRE:
        theta = states[:, State.THETA]
        states[:, State.X] += centre_offset(vehicle) * np.cos(theta)
        states[:, State.Y] += centre_offset(vehicle) * np.sin(theta)
    return np.column_stack([trajectory.t, states, trajectory.inputs])
