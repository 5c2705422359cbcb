"""Random tight places: legal, repeatable, of every layout and size of car, and what is stored of them."""

from __future__ import annotations

from collections import Counter
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import shapely

from drake_gnnocp.experiments.dataset.label import UNVERIFIED, Label
from drake_gnnocp.experiments.dataset.records import MapRecord, load_records, save_records
from drake_gnnocp.experiments.tasks import tight_places
from drake_gnnocp.experiments.tasks.draw import WIDE_MAPS, draw_place, draw_tasks, kind_of
from drake_gnnocp.experiments.tasks.place import Place, union
from drake_gnnocp.experiments.tasks.tight_places import LAYOUTS, LEAST_CLEARANCE, TightOptions
from drake_gnnocp.verification import min_clearance

N = 60


@cache
def places() -> list[Place]:
    return [draw_place(0, WIDE_MAPS + i) for i in range(N)]


def test_the_same_seed_gives_the_same_place_and_tasks() -> None:
    index = WIDE_MAPS + 7
    first, second = draw_place(3, index), draw_place(3, index)
    assert kind_of(index) == first.kind == "tight" and first.vehicle == second.vehicle
    for one, other in zip((*first.obstacles, *first.lines), (*second.obstacles, *second.lines), strict=True):
        np.testing.assert_array_equal(one, other)
    pairs = list(zip(draw_tasks(3, index, first, 2), draw_tasks(3, index, second, 2), strict=True))
    assert pairs and all(np.array_equal(a.start, b.start) and np.array_equal(a.goal, b.goal) for a, b in pairs)


def test_the_car_can_stand_in_every_slot_and_most_of_them_are_tight() -> None:
    nearest = []
    for place in places():
        unit = place.vehicle.size
        blocked = union(place.obstacles, place.lines)
        cars = shapely.polygons(place.vehicle.footprints(np.array(place.slots)))
        clearances = shapely.distance(cars, blocked) / unit
        assert place.slots and clearances.min() >= LEAST_CLEARANCE - 1e-9
        nearest.append(float(clearances.min()))
    assert 0.02 < np.median(nearest) < 0.3


def test_there_is_a_legal_task_on_nearly_every_place() -> None:
    drawn = [(place, draw_tasks(0, WIDE_MAPS + i, place, 1)) for i, place in enumerate(places())]
    assert sum(map(len, (tasks for _, tasks in drawn))) >= 0.9 * N
    for place, tasks in drawn:
        for task in tasks:  # a pose that collides raises
            assert task.name.startswith("tight_0_") and (task.bounds is not None) == place.is_bounded
            assert min_clearance(task, task.vehicle.footprints(np.stack([task.start, task.goal]))) > 0.0


def test_cars_robots_and_long_vehicles_stand_among_cars_walls_and_lines() -> None:
    sizes = np.array([place.vehicle.size for place in places()])
    assert (sizes < 0.55).mean() > 0.05 and (sizes > 1.1).mean() > 0.05 and (sizes == 1.0).mean() > 0.2
    assert {bool(place.lines) for place in places()} == {bool(place.obstacles) for place in places()} == {True, False}
    assert {place.is_bounded for place in places()} == {True, False}
    vertices = [sum(map(len, (*place.obstacles, *place.lines))) for place in places()]
    assert max(vertices) > 200


@pytest.mark.parametrize("which", range(len(LAYOUTS)))
def test_every_layout_has_slots_and_walls(which: int) -> None:
    shares = tuple(float(i == which) for i in range(len(LAYOUTS)))
    options = TightOptions(shares=shares)
    drawn = [tight_places.random_tight_place(np.random.default_rng(i), options) for i in range(5)]
    assert all(place.slots and (place.obstacles or place.lines) for place in drawn)


def test_the_room_beside_the_car_is_what_the_options_say_at_the_size_of_the_car() -> None:
    options = TightOptions(shares=(1.0, 0.0, 0.0, 0.0, 0.0, 0.0), side=(0.05, 0.05001), behind=(0.5, 0.6))
    drawn = [tight_places.random_tight_place(np.random.default_rng(i), options) for i in range(20)]
    assert len({place.vehicle.length for place in drawn}) > 8
    for place in drawn:
        car = shapely.Polygon(place.vehicle.footprints(place.slots[0])[0])
        room = car.distance(union(place.obstacles, place.lines)) / place.vehicle.size
        assert room == pytest.approx(0.05, abs=0.001)


def test_what_is_stored_of_a_place_has_its_lines_and_bounds(tmp_path: Path) -> None:
    records = []
    for i, place in enumerate(places()[:12]):
        tasks = draw_tasks(0, WIDE_MAPS + i, place, 2)
        records.append(MapRecord(WIDE_MAPS + i, place, tuple(tasks), tuple(Label(UNVERIFIED) for _ in tasks)))
    assert Counter(record.place.is_bounded for record in records).keys() == {True, False}
    save_records(tmp_path / "tight.npz", records)
    for record, found in zip(records, load_records(tmp_path / "tight.npz"), strict=True):
        assert (found.place.is_bounded, found.place.vehicle) == (record.place.is_bounded, record.place.vehicle)
        for one, other in zip(record.place.lines, found.place.lines, strict=True):
            np.testing.assert_array_equal(one, other)
        for task, again in zip(record.tasks, found.tasks, strict=True):
            assert task.bounds == again.bounds and len(task.lines) == len(again.lines)
