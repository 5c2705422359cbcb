"""The proof that there is no path: never for what can be driven, and always for what is closed by centimetres."""

from __future__ import annotations

import math
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
import shapely

from drake_gnnocp import Scenario, Vehicle
from drake_gnnocp.experiments.dataset.records import load_records
from drake_gnnocp.scenario import bundled_scenarios
from drake_gnnocp.search.reachability import NoPath, _body, no_passage, no_path

SHARDS = Path(__file__).parents[1] / "artifacts" / "dataset" / "shards"
VEHICLE = Vehicle()


def gate(width: float, bounds: bool = True, corners: int = 0) -> Scenario:
    """A gate in a wall through all of the bounds; `corners`: more vertices than the wall needs."""
    wall = [[8.0, -20.0], [8.3, -20.0], [8.3, -width / 2], [8.0, -width / 2]]
    teeth = [[8.0, y] for y in np.linspace(-width / 2, -20.0, corners + 2)[1:-1]]
    halves = np.array(wall + teeth), np.array([[8.0, width / 2], [8.3, width / 2], [8.3, 20.0], [8.0, 20.0]])
    box = (-6.0, 30.0, -12.0, 12.0) if bounds else None
    return Scenario("gate", np.zeros(3), np.array([18.0, 0.0, 0.0]), halves, box)


def box(xmin: float, xmax: float, ymin: float, ymax: float) -> np.ndarray:
    return np.array([[xmin, ymin], [xmax, ymin], [xmax, ymax], [xmin, ymax]])


def corner(width: float, vehicle: Vehicle) -> Scenario:
    """A corridor with a corner, closed at both ends."""
    half = width / 2
    walls = (
        box(-5.0, 12.0 - half, half, 14.0),
        box(-5.0, 13.0 + half, -half - 1.0, -half),
        box(12.0 + half, 13.0 + half, -half, 15.0),
        box(-5.0, -4.0, -half, half),
        box(12.0 - half, 12.0 + half, 14.0, 15.0),
    )
    return Scenario("corner", np.zeros(3), np.array([12.0, 8.0, math.pi / 2]), walls, vehicle=vehicle)


@pytest.mark.parametrize("name", bundled_scenarios())
def test_no_bundled_scenario_is_called_impossible(name: str) -> None:
    assert no_path(Scenario.load(name)) is None


@pytest.mark.slow
def test_no_task_that_was_solved_is_called_impossible() -> None:
    shards = sorted(SHARDS.glob("*.npz"))[:12]
    records = (record for shard in shards for record in load_records(shard))
    solved = (
        task
        for record in records
        for task, label in zip(record.tasks, record.labels, strict=True)
        if label.trajectory is not None
    )
    tasks = list(islice(solved, 1000))
    assert len(tasks) == 1000
    assert [task.name for task in tasks if no_path(task.translated(*-task.start[:2])) is not None] == []


def test_a_gate_is_closed_for_what_is_wider_and_open_for_what_is_narrower() -> None:
    assert no_path(gate(VEHICLE.width + 0.001)) is None
    closed = no_path(gate(VEHICLE.width - 0.01))
    assert closed is not None and closed.proven and closed.place is not None
    assert closed.width == pytest.approx(1.89, abs=0.005)
    np.testing.assert_allclose(closed.place, (8.15, 0.0), atol=0.05)


def test_without_bounds_there_is_a_way_around() -> None:
    assert no_path(gate(0.5, bounds=False)) is None


def test_many_corners_change_the_words_and_not_the_proof() -> None:
    closed = no_path(gate(1.7, corners=2500))
    assert closed is not None and closed.proven and closed.place is None
    assert no_passage(gate(1.7, corners=2500)) is None and no_passage(gate(1.7)) is not None
    assert no_path(gate(VEHICLE.width + 0.001, corners=2500)) is None


def test_a_corner_of_a_corridor_is_closed_for_long_cars_alone() -> None:
    assert no_path(corner(2.6, Vehicle(wheelbase=1.6, front_hang=0.5, rear_hang=0.5))) is None
    refused = no_path(corner(2.6, VEHICLE))
    assert refused is not None and refused.width is None and refused.place is not None
    assert math.dist(refused.place, (12.0, 0.0)) < 4.0


def test_the_body_of_an_interval_is_inside_the_car_at_every_heading_of_it() -> None:
    half_interval = math.pi / 16
    body = _body(2.0, 0.9, half_interval)
    assert shapely.Polygon(body).area > 0.75 * 4.0 * 1.8
    for heading in np.linspace(-half_interval, half_interval, 101):
        along = body @ [math.cos(heading), math.sin(heading)]
        across = body @ [-math.sin(heading), math.cos(heading)]
        assert np.abs(along).max() <= 2.0 + 1e-12 and np.abs(across).max() <= 0.9 + 1e-12


def test_the_reason_moves_with_the_task() -> None:
    moved = NoPath("near {place} it is narrow", True, (1.0, 2.0), 1.5).placed(10.0, -4.0, 1.0)
    assert moved.text == "near (11.0, -2.0) it is narrow" and moved.to_dict()["near"] == [11.0, -2.0]
