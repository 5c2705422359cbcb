"""Random car parks and yards: legal, repeatable and varied, with ends a car can stand at."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
import shapely

from drake_gnnocp.experiments.tasks.car_parks import CarParkOptions, random_car_park
from drake_gnnocp.experiments.tasks.ends import random_ends_of
from drake_gnnocp.experiments.tasks.open_maps import MapOptions, TaskOptions, random_ends, random_obstacles
from drake_gnnocp.experiments.tasks.place import SLOT_CLEARANCE, Place, VehicleOptions, random_vehicle, union
from drake_gnnocp.experiments.tasks.rows import RowOptions
from drake_gnnocp.experiments.tasks.shapes import box, moved
from drake_gnnocp.experiments.tasks.yards import random_yard
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.vehicle import Vehicle

N = 16  # places of each kind
MAKERS: dict[str, Callable[[np.random.Generator], Place]] = {"car_park": random_car_park, "yard": random_yard}
DISTANCE_TOLERANCE = 1e-9  # m, of distances between rotated polygons
UPRIGHT_TOLERANCE = 1e-6  # rad, an upright row's slots are at 0 or 90 degrees to this
FEWEST, MOST, MEDIAN = 5, 60, (14, 26)  # obstacles of a place; the median is to be about 20


@pytest.fixture(scope="module", params=sorted(MAKERS))
def places(request: pytest.FixtureRequest) -> list[Place]:
    return places_of(request.param)


@cache
def places_of(kind: str) -> list[Place]:
    return [drawn(kind, i) for i in range(N)]


def drawn(kind: str, i: int) -> Place:
    return MAKERS[kind](np.random.default_rng([1, i]))


def ends_of(place: Place, i: int) -> tuple[np.ndarray, np.ndarray] | None:
    return random_ends_of(np.random.default_rng([2, i]), place)


def is_in(pose: np.ndarray, slots: tuple[np.ndarray, ...]) -> bool:
    return any(np.array_equal(pose, slot) for slot in slots)


@pytest.mark.parametrize("kind", MAKERS)
def test_the_same_seed_gives_the_same_place_and_ends(kind: str) -> None:
    first, second = drawn(kind, 3), drawn(kind, 3)
    assert (first.kind, first.area, first.vehicle) == (kind, second.area, second.vehicle)
    for one, other in ((first.obstacles, second.obstacles), (first.slots, second.slots)):
        assert len(one) == len(other)
        assert all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))
    ends, same = ends_of(first, 0), ends_of(second, 0)
    assert ends is not None and same is not None and np.array_equal(ends, same)
    assert not np.array_equal(drawn(kind, 4).obstacles[0], first.obstacles[0])


def test_tasks_are_legal_scenarios(places: list[Place]) -> None:
    for i, place in enumerate(places):
        ends = ends_of(place, i)
        assert ends is not None
        scenario = Scenario("task", *ends, place.obstacles, place.area, place.vehicle)  # raises where it is not legal
        assert len(scenario.polygons) == len(place.obstacles)  # no ring touches itself


def test_ends_keep_the_distance_and_the_clearance(places: list[Place]) -> None:
    options = TaskOptions()
    for i, place in enumerate(places):
        ends = ends_of(place, i)
        assert ends is not None
        assert options.distance[0] <= np.linalg.norm(ends[1][:2] - ends[0][:2]) <= options.distance[1]
        for pose in ends:
            car = shapely.Polygon(place.vehicle.footprints(pose)[0])
            least = SLOT_CLEARANCE if is_in(pose, place.slots) else options.clearance
            assert car.distance(union(place.obstacles)) >= least - DISTANCE_TOLERANCE


def test_slots_are_clear_and_inside_the_area(places: list[Place]) -> None:
    for place in places:
        assert place.slots
        cars = place.vehicle.footprints(np.array(place.slots))
        assert (
            shapely.distance(union(place.obstacles), shapely.polygons(cars)) >= SLOT_CLEARANCE - DISTANCE_TOLERANCE
        ).all()
        low, high = np.array(place.area[0::2]), np.array(place.area[1::2])
        assert (cars >= low).all() and (cars <= high).all()


def test_places_are_compact_and_not_too_crowded(places: list[Place]) -> None:
    counts = [len(place.obstacles) for place in places]
    assert FEWEST <= min(counts) and max(counts) <= MOST
    assert MEDIAN[0] <= np.median(counts) <= MEDIAN[1]
    for place in places:
        assert max(len(ring) for ring in place.obstacles) <= 10
        xmin, xmax, ymin, ymax = place.area
        assert 10.0 < min(xmax - xmin, ymax - ymin) and max(xmax - xmin, ymax - ymin) < 60.0
        area = shapely.box(xmin, ymin, xmax, ymax)
        assert all(shapely.Polygon(ring).distance(area) <= DISTANCE_TOLERANCE for ring in place.obstacles)


def test_tasks_go_into_slots_out_of_them_and_elsewhere(places: list[Place]) -> None:
    into = out_of = elsewhere = 0
    for i in range(3 * N):
        ends = ends_of(places[i % N], i)
        assert ends is not None
        slots = places[i % N].slots
        into, out_of = into + is_in(ends[1], slots), out_of + is_in(ends[0], slots)
        elsewhere += not (is_in(ends[0], slots) or is_in(ends[1], slots))
    assert into > out_of > 0 and elsewhere > 0


def test_half_of_the_places_have_the_papers_car() -> None:
    rng, options = np.random.default_rng(5), VehicleOptions()
    vehicles = [random_vehicle(rng, options) for _ in range(200)]
    others = [vehicle for vehicle in vehicles if vehicle != Vehicle()]
    assert 70 <= len(others) <= 130
    for name, value in ((name, getattr(v, name)) for v in others for name in v.to_dict()):
        assert getattr(options, name)[0] <= value <= getattr(options, name)[1]


@pytest.mark.parametrize("kind", range(3), ids=["perpendicular", "parallel", "angled"])
def test_slots_stand_to_the_aisle_as_their_row_says(kind: int) -> None:
    shares = tuple(float(k == kind) for k in range(3))
    options = CarParkOptions(turn=(0.0, 0.0), row=RowOptions(kinds=shares))  # type: ignore[arg-type]
    for i in range(4):
        place = random_car_park(np.random.default_rng([4, i]), options)
        to_aisle = np.abs(np.array([math.remainder(slot[2], math.pi) for slot in place.slots]))  # aisles along x
        low, high = ((math.pi / 2,) * 2, (0.0,) * 2, options.row.angle)[kind]
        assert (to_aisle >= low - UPRIGHT_TOLERANCE).all() and (to_aisle <= high + UPRIGHT_TOLERANCE).all()


def test_all_kinds_of_rows_occur() -> None:
    options, found = CarParkOptions(turn=(0.0, 0.0)), set()
    for i in range(12):
        place = random_car_park(np.random.default_rng([6, i]), options)
        to_aisle = [abs(math.remainder(slot[2], math.pi)) for slot in place.slots]
        found |= {0 if angle < 0.1 else 1 if angle < 1.1 else 2 for angle in to_aisle}
    assert found == {0, 1, 2}


def test_yards_have_concave_obstacles_and_thin_walls() -> None:
    polygons = [[shapely.Polygon(ring) for ring in place.obstacles] for place in places_of("yard")]
    concave = [any(ring.convex_hull.area > 1.01 * ring.area for ring in rings) for rings in polygons]
    thin = [any(ring.buffer(-0.26).is_empty for ring in rings) for rings in polygons]
    assert np.mean(concave) > 0.8 and all(thin)


def test_an_end_that_is_walled_in_is_not_taken() -> None:
    walls = [moved(box(-4.0, 4.0, 3.9, 4.1), (2.0, 4.0, quarter * math.pi / 2)) for quarter in range(4)]
    cell = np.array([2.0, 4.0, 0.0])  # in the middle of four walls
    place = Place("yard", (-20.0, 20.0, -20.0, 20.0), tuple(walls), (cell,), Vehicle())
    for i in range(10):
        ends = ends_of(place, i)
        assert ends is None or not any(is_in(pose, place.slots) for pose in ends)


def test_ends_on_open_maps_are_those_of_the_paper() -> None:
    options = MapOptions()
    obstacles = random_obstacles(np.random.default_rng(7), options)
    place = Place("open", (0.0, options.side, 0.0, options.side), obstacles, (), Vehicle())
    expected = random_ends(np.random.default_rng([2, 0]), obstacles, options.side, TaskOptions())
    ends = ends_of(place, 0)
    assert ends is not None and expected is not None and np.array_equal(ends, expected)
