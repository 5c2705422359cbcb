"""Properties of all polygons and vehicles, whatever they are like: refused with a reason, or good for a plan."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from drake_gnnocp import CostWeights, Scenario, ScenarioError, Vehicle
from drake_gnnocp.budget import Budget
from drake_gnnocp.guesses.straight import straight_line
from drake_gnnocp.ocp.formulation import formulate
from drake_gnnocp.ocp.sqp import LEARNED, sqp_steps
from drake_gnnocp.pictures.meshes import prism
from drake_gnnocp.planner.horizon import LONGEST
from drake_gnnocp.search.collision import FootprintTest, Margins
from drake_gnnocp.search.distance_field import DistanceField
from drake_gnnocp.search.reeds_shepp import all_paths
from drake_gnnocp.vehicle import LARGEST, SMALLEST
from drake_gnnocp.verification import verify

REGION = (-20.0, 40.0, -20.0, 40.0)  # m
COVERED = 1e-6  # m^2: parts and polygon agree, at coordinates of up to 1e6 m
NUDGES = (0.0, 1e-12, 1e-10, 1e-9, 2e-9, 1e-8, 1e-7, 1e-6)  # m, that put vertices nearly in the same place
RUNS = pytest.mark.parametrize("examples", [60, pytest.param(5_000, marks=pytest.mark.slow)])


def for_all(examples: int, *strategies: st.SearchStrategy[Any]) -> Callable[[Callable[..., None]], None]:
    """Call a function with examples, always the same ones."""

    def run(holds: Callable[..., None]) -> None:
        unhurried = settings(
            max_examples=examples,
            derandomize=True,
            database=None,
            deadline=None,
            suppress_health_check=list(HealthCheck),
        )
        unhurried(given(*strategies)(holds))()

    return run


@st.composite
def rings(draw: st.DrawFn) -> np.ndarray:
    """Rings with vertices of a coarse grid, some of them on an edge or on one another but for a nudge, anywhere."""
    on_grid = st.tuples(st.integers(-6, 6), st.integers(-6, 6))
    ring = np.array(draw(st.lists(on_grid, min_size=3, max_size=9)), dtype=float) / 2
    for _ in range(draw(st.integers(0, 4))):
        at, share = draw(st.integers(0, len(ring) - 1)), draw(st.sampled_from([0.0, 0.3, 0.5, 1.0]))
        to, where = draw(st.integers(0, len(ring) - 1)), draw(st.integers(0, len(ring)))
        nudge = [draw(st.sampled_from(NUDGES)) * draw(st.sampled_from([-1, 1])) for _ in "xy"]
        ring = np.insert(ring, where, share * ring[at] + (1 - share) * ring[to] + nudge, axis=0)
    angle, offset = draw(st.floats(0, 6.28)), draw(st.sampled_from([0.0, 1.7, 1e3 / 3, 1e6 / 7, 1e9 / 3, 1e11]))
    cos, sin = math.cos(angle), math.sin(angle)
    return ring @ [[cos, sin], [-sin, cos]] + offset


@RUNS
def test_a_polygon_is_refused_or_good_for_all_that_a_plan_does_with_it(examples: int) -> None:
    @for_all(examples, rings())
    def holds(ring: np.ndarray) -> None:
        start = np.append(ring.mean(axis=0) + [-14.0, 0.0], 0.0)
        try:
            scenario = Scenario("any", start, start + [24.0, -12.0, 0.0], (ring,))
        except ScenarioError as error:
            assert str(error).startswith(("obstacles[0]: ", "start: ", "goal: "))
            return
        assert all(polygon.is_valid for polygon in scenario.polygons)
        local = scenario.translated(*-start[:2])
        area = sum(shapely.Polygon(part).area for part in local.convex_obstacles)
        if np.abs(ring).max() < 1e6:
            assert area == pytest.approx(sum(polygon.area for polygon in scenario.polygons), abs=COVERED)
        assert np.isfinite(local.end_clearances).all() and np.isfinite(local.centroids).all()
        line = straight_line(local, 20)
        verify(local, line)
        field = DistanceField.of(local.convex_obstacles, REGION, 0.4, 4.0)
        FootprintTest(local, field, REGION, Margins.of(local, 0.12)).collides(line.poses)
        sqp_steps(formulate(local, line, CostWeights(), 0.1), LEARNED, Budget.unlimited())
        for polygon in scenario.polygons:
            assert np.isfinite(prism(polygon, 0.0, 1.0)[0]).all()


def sizes(least: float, most: float) -> st.SearchStrategy[float]:
    """Numbers of all orders of magnitude."""
    return st.floats(math.log10(least), math.log10(most)).map(lambda power: min(max(10.0**power, least), most))


@RUNS
def test_any_vehicle_is_refused_or_good_for_all_that_a_plan_does_with_it(examples: int) -> None:
    names = ("wheelbase", "width", "v_max", "a_max", "w_max")
    hangs = st.one_of(st.just(0.0), sizes(1e-12, LARGEST))
    lengths = {name: sizes(SMALLEST, LARGEST) for name in names} | {"front_hang": hangs, "rear_hang": hangs}
    vehicles = st.fixed_dictionaries(lengths | {"phi_max": sizes(SMALLEST, 1.5707)})

    @for_all(examples, vehicles, sizes(1e-3, 1e6))
    def holds(parameters: dict[str, float], distance: float) -> None:
        vehicle = Vehicle(**parameters)
        post = np.array([[0.5, 2.0], [0.6, 2.0], [0.6, 2.1]]) * max(distance, 2 * vehicle.length + vehicle.width)
        scenario = Scenario("any", np.zeros(3), np.array([distance, 0.0, 0.0]), (post,), vehicle=vehicle)
        line = straight_line(scenario, 20)
        if line.duration < LONGEST:
            verify(scenario, line)
            sqp_steps(formulate(scenario, line, CostWeights(), 0.1), LEARNED, Budget.unlimited())
        paths = list(all_paths((0.0, 0.0, 0.0), (distance, 0.1 * distance, 1.0), vehicle.turning_radius))
        assert all(math.isfinite(move.length) for moves in paths for move in moves)


@RUNS
def test_any_parameters_of_a_vehicle_are_those_or_refused_by_name(examples: int) -> None:
    values = st.one_of(st.floats(), st.integers(), st.booleans(), st.none(), st.text(max_size=3), st.just([1.0]))

    @for_all(examples, st.dictionaries(st.sampled_from([*Vehicle().to_dict(), "height"]), values, max_size=4))
    def holds(parameters: dict[str, Any]) -> None:
        try:
            vehicle = Vehicle.from_dict(parameters)
        except ValueError as error:
            assert str(error).startswith("vehicle.") and "\n" not in str(error)
        else:
            assert vehicle.to_dict() == Vehicle().to_dict() | parameters
