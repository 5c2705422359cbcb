"""Plans of a scene at another scale, with its vehicle and its speeds, are the same plans at that scale."""

from dataclasses import replace

import numpy as np
import pytest

from drake_gnnocp import Area, Scenario, Trajectory, Vehicle, plan
from drake_gnnocp.scenario import bundled_scenarios

SAME_COST = 0.01  # relative; the cost does not depend on the scale
SAME_PLACE = 0.02  # of the car's length: rounding may lead the solvers to another iterate
SCALES = (0.1, 0.5, 5.0)  # a model car, a small robot, a vehicle of a mine
LENGTHS = ("wheelbase", "front_hang", "rear_hang", "width", "v_max", "a_max")


def at_scale(scenario: Scenario, factor: float) -> Scenario:
    vehicle = {name: factor * v if name in LENGTHS else v for name, v in scenario.vehicle.to_dict().items()}
    in_plane = np.array([factor, factor, 1.0])
    bounds = scenario.bounds
    assert not any(isinstance(obstacle, Area) for obstacle in scenario.obstacles)
    return replace(
        scenario,
        start=scenario.start * in_plane,
        goal=scenario.goal * in_plane,
        obstacles=tuple(factor * np.asarray(ring) for ring in scenario.obstacles),
        bounds=tuple(factor * np.array(bounds)) if isinstance(bounds, tuple) else None,
        vehicle=Vehicle(**vehicle),
        clearance=factor * scenario.clearance,
    )


def assert_same_plan_at_every_scale(name: str, clearance: float) -> None:
    scenario = replace(Scenario.load(name), clearance=clearance)
    here = plan(scenario)
    for factor in SCALES:
        there = plan(at_scale(scenario, factor))
        assert there.status == here.status == "verified"
        assert here.cost is not None and there.cost is not None
        assert there.cost.J == pytest.approx(here.cost.J, rel=SAME_COST)
        assert here.trajectory is not None and there.trajectory is not None
        off = here.trajectory.scaled(factor).poses[:, :2] - there.trajectory.poses[:, :2]
        assert np.abs(off).max() <= SAME_PLACE * factor * scenario.vehicle.length
        assert here.verification is not None and there.verification is not None
        kept = here.verification.min_clearance_m, there.verification.min_clearance_m
        assert kept[1] == pytest.approx(factor * kept[0], abs=SAME_PLACE * factor * scenario.vehicle.length)


@pytest.mark.parametrize(("name", "clearance"), [("map_a", 0.0), ("map_c", 0.3)])
def test_scaled_twins_have_the_scaled_plan(name: str, clearance: float) -> None:
    assert_same_plan_at_every_scale(name, clearance)


@pytest.mark.slow
@pytest.mark.parametrize("name", bundled_scenarios())
def test_scaled_twins_of_every_bundled_scenario_have_the_scaled_plan(name: str) -> None:
    assert_same_plan_at_every_scale(name, 0.0)


def test_reasons_are_told_in_metres() -> None:
    wall = np.array([[0.7, -9.0], [0.8, -9.0], [0.8, 9.0], [0.7, 9.0]])
    car = Vehicle().scaled(0.1)
    gate = (wall + (0, 9.08), wall - (0, 9.08))  # 16 cm wide, the car has 19
    scenario = Scenario("gate", np.array([0.05, 0.02, 0.0]), np.array([1.6, 0.0, 0.0]), gate, (-1, 3, -1, 1), car)
    result = plan(scenario)
    assert result.no_path is not None and result.no_path.width == pytest.approx(0.16, abs=0.005)
    assert result.no_path.place == pytest.approx((0.75, 0.0), abs=0.08)
    assert "is 0.16 m wide, the car 0.19 m" in result.reason
    straight = plan(replace(scenario, obstacles=gate[:1]), "straight", horizon=0.5)
    assert "the guess's path is 1.6 m long, and 0.5 s at v_max are 0.1 m" in straight.reason


def test_a_guess_of_ones_own_is_taken_at_its_scale() -> None:
    small = at_scale(Scenario.load("map_a"), 0.1)
    first = plan(small)
    assert isinstance(first.trajectory, Trajectory)
    again = plan(small, guess=first.trajectory)
    assert again.verified and again.guess is not None
    off = np.abs(again.guess.poses[:, :2] - first.trajectory.poses[:, :2]).max()
    assert off <= SAME_PLACE * small.vehicle.length
