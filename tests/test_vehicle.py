"""The car: its rectangle, its limits and the bicycle model against closed forms and independent geometry."""

import math
from typing import Any

import numpy as np
import pytest
import shapely
import shapely.affinity

from drake_gnnocp.vehicle import Input, State, Vehicle

EXACT = 1e-12  # relative: a handful of float operations on numbers of order one
DIFFERENCES = 1e-8  # error of central differences with a step of 1e-6 on numbers of order one
POSES = np.array([[0.0, 0.0, 0.0], [3.0, -2.0, 2.5], [-7.0, 4.0, -9.0]])


def test_defaults_are_the_papers_table() -> None:
    assert Vehicle().to_dict() == {
        "wheelbase": 2.8,
        "front_hang": 0.96,
        "rear_hang": 0.929,
        "width": 1.9,
        "v_max": 2.5,
        "a_max": 2.0,
        "phi_max": 0.7,
        "w_max": 0.85,
    }


def test_length_and_turning_radius() -> None:
    assert Vehicle().length == pytest.approx(4.689, rel=EXACT)
    assert Vehicle(phi_max=math.pi / 4).turning_radius == pytest.approx(2.8, rel=EXACT)


def test_footprints_are_the_rectangle_rotated_about_the_rear_axle_and_moved() -> None:
    vehicle = Vehicle()
    body = shapely.box(-0.929, -0.95, 2.8 + 0.96, 0.95)
    for footprint, (x, y, theta) in zip(vehicle.footprints(POSES), POSES, strict=True):
        turned = shapely.affinity.rotate(body, theta, origin=(0, 0), use_radians=True)
        expected = shapely.affinity.translate(turned, x, y)
        assert shapely.Polygon(footprint).symmetric_difference(expected).area < EXACT * expected.area


def test_footprints_run_counter_clockwise_from_the_rear_right_corner() -> None:
    (footprint,) = Vehicle().footprints(np.array([[10.0, 20.0, math.pi / 2]]))  # facing +y: right is +x
    np.testing.assert_allclose(footprint[0], [10.95, 20 - 0.929], rtol=EXACT)
    assert all(shapely.LinearRing(footprint).is_ccw for footprint in Vehicle().footprints(POSES))


def test_one_pose_may_come_without_its_row_dimension() -> None:
    np.testing.assert_array_equal(Vehicle().footprints(POSES[1]), Vehicle().footprints(POSES[1:2]))


def test_rates_are_the_bicycle_model() -> None:
    state = np.zeros(5)
    state[State.THETA], state[State.V], state[State.PHI] = math.pi / 6, 2.0, math.pi / 4
    inputs = np.zeros(2)
    inputs[Input.A], inputs[Input.W] = 0.3, -0.2
    expected = [math.sqrt(3), 1.0, 2.0 / 2.8, 0.3, -0.2]
    np.testing.assert_allclose(Vehicle().rates(state, inputs), expected, rtol=EXACT)


def test_rates_take_any_leading_shape() -> None:
    rng = np.random.default_rng(1)
    states, inputs = rng.uniform(-1, 1, (3, 4, 5)), rng.uniform(-1, 1, (3, 4, 2))
    rates = Vehicle().rates(states, inputs)
    assert rates.shape == (3, 4, 5)
    np.testing.assert_array_equal(rates[2, 1], Vehicle().rates(states[2, 1], inputs[2, 1]))


def test_the_jacobian_of_the_pose_rates_is_that_of_central_differences() -> None:
    states, step = np.random.default_rng(2).uniform(-0.6, 0.6, (20, 5)), 1e-6
    rates, jacobian = Vehicle().pose_rates(states)
    inputs = np.zeros((20, 2))
    np.testing.assert_array_equal(rates, Vehicle().rates(states, inputs)[:, :3])
    for column, shift in enumerate(step * np.eye(5)):
        difference = Vehicle().rates(states + shift, inputs) - Vehicle().rates(states - shift, inputs)
        np.testing.assert_allclose(jacobian[:, :, column], difference[:, :3] / (2 * step), atol=DIFFERENCES)


def test_a_dict_gives_back_the_vehicle() -> None:
    vehicle = Vehicle(width=2.1, rear_hang=0.0)
    assert Vehicle.from_dict(vehicle.to_dict()) == vehicle
    assert Vehicle.from_dict({}) == Vehicle()


@pytest.mark.parametrize("name", ["front_hang", "rear_hang"])
def test_a_car_may_end_at_its_axle(name: str) -> None:
    assert Vehicle.from_dict({name: 0}).length < Vehicle().length


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"hight": 1.5}, r"vehicle\.hight: unknown key; allowed are wheelbase, .*w_max"),
        ({"width": -1}, r"vehicle\.width: must be between 0.001 and 10000, not -1"),
        ({"wheelbase": 0}, r"vehicle\.wheelbase: must be between 0.001 and 10000, not 0"),
        ({"rear_hang": -0.1}, r"vehicle\.rear_hang: must be between 0 and 10000, not -0.1"),
        ({"width": True}, r"vehicle\.width: must be a number, not True"),
        ({"width": "2"}, r"vehicle\.width: must be a number, not '2'"),
        ({"width": None}, r"vehicle\.width: must be a number, not None"),
        ({"v_max": math.nan}, r"vehicle\.v_max: must be between 0.001 and 10000, not"),
        ({"v_max": math.inf}, r"vehicle\.v_max: must be between 0.001 and 10000, not"),
        ({"v_max": 10**400}, r"vehicle\.v_max: must be between 0.001 and 10000, not"),
        ({"phi_max": math.pi / 2}, r"vehicle\.phi_max: must be below pi/2"),
        ({"phi_max": 2}, r"vehicle\.phi_max: must be below pi/2"),
    ],
)
def test_an_illegal_parameter_is_named(parameters: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=f"^{message}"):
        Vehicle.from_dict(parameters)
