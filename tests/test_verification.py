"""Verification: a plan that is clean by its closed form passes, and every fault is found when it is planted in it."""

import json
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import shapely

from drake_gnnocp.scenario import Scenario
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import Input, State, Vehicle
from drake_gnnocp.verification import Verification, min_clearance, verify

EXACT = 1e-11  # m: Simpson's rule is exact for cubics, what is left is rounding over a thousand steps
PROVEN = 1e-3  # m: what a proven clearance may be below the true one
ENCLOSED = 1e-6  # m: bounds on the errors of the integration are part of an error at the goal
WALL = np.array([[0.0, -10.0], [1.0, -10.0], [1.0, 10.0], [0.0, 10.0]])  # scaled and moved where it is needed


def straight_plan(peak: float = 0.6, duration: float = 8.0, n: int = 81) -> Trajectory:
    """Knots of a sine of acceleration, linear in between, whose states are the exact integrals."""
    t = np.linspace(0, duration, n)
    a = peak * np.sin(2 * math.pi * t / duration)
    return driven_straight(t, a)


def driven_straight(t: np.ndarray, a: np.ndarray, heading: float = 0.0) -> Trajectory:
    """Straight ahead from the origin with the accelerations a at the knots t."""
    h, a0, da = np.diff(t), a[:-1], np.diff(a)
    v = np.append(0.0, np.cumsum(h * (a0 + da / 2)))
    x = np.append(0.0, np.cumsum(h * v[:-1] + h**2 * (a0 / 2 + da / 6)))
    states, inputs = np.zeros((len(t), 5)), np.zeros((len(t), 2))
    states[:, State.X], states[:, State.Y] = x * math.cos(heading), x * math.sin(heading)
    states[:, State.THETA], states[:, State.V], inputs[:, Input.A] = heading, v, a
    return Trajectory(t, states, inputs)


def task_of(trajectory: Trajectory, *obstacles: np.ndarray) -> Scenario:
    """The task the trajectory solves when nothing stands in the way."""
    return Scenario("task", trajectory.poses[0].copy(), trajectory.poses[-1].copy(), obstacles)


CLEAN = straight_plan()  # 6.1 m
LONG = straight_plan(peak=0.35, duration=20.0, n=121)  # 22 m
HURRIED = driven_straight(np.linspace(0, 10, 5), np.array([0.0, 1.0, 0.0, -1.0, 0.0]))  # 12.5 m, 5 m between knots


def faults(scenario: Scenario, trajectory: Trajectory) -> list[str]:
    found = verify(scenario, trajectory)
    assert found.verified == (not found.faults)
    return found.faults


@pytest.mark.parametrize("plan", [CLEAN, LONG, HURRIED])
def test_a_clean_plan_is_verified(plan: Trajectory) -> None:
    beside = WALL + [2.0, 12.0]  # 2 m from the middle of the lane
    found = verify(task_of(plan, beside), plan)
    assert found.faults == []
    assert 2 - 0.95 - PROVEN <= found.min_clearance_m <= 2 - 0.95
    assert found.terminal_position_error_m < ENCLOSED
    assert found.terminal_heading_error_rad < ENCLOSED
    assert found.max_dynamics_gap_m < EXACT


def test_without_obstacles_the_clearance_is_infinite_and_null_in_json() -> None:
    found = verify(task_of(CLEAN), CLEAN)
    assert found.verified
    assert found.min_clearance_m == math.inf
    assert json.loads(json.dumps(found.to_dict(), allow_nan=False))["min_clearance_m"] is None


def test_a_collision_between_the_knots_is_found() -> None:
    post = np.array([[4.95, -0.1], [5.15, -0.1], [5.15, 0.1], [4.95, 0.1]])
    scenario = task_of(HURRIED, post)
    assert min_clearance(scenario, scenario.vehicle.footprints(HURRIED.poses)) > 0.1  # all knots are clear of it
    assert faults(scenario, HURRIED) == ["collides with an obstacle"]


@pytest.mark.parametrize("thickness", [0.1, 1e-3, 1e-6])
def test_crossing_a_thin_wall_is_found(thickness: float) -> None:
    wall = WALL * [thickness, 1] + [5.0, 0]
    scenario = task_of(LONG, wall)
    assert verify(scenario, LONG).min_clearance_m == 0
    assert faults(scenario, LONG) == ["collides with an obstacle"]


def test_a_car_wholly_inside_a_polygon_collides() -> None:
    block = WALL * [12, 1] + [5.0, 0]
    scenario = task_of(LONG, block)
    inside = scenario.vehicle.footprints(np.array([[8.0, 0, 0]]))
    assert inside.min(axis=(0, 1))[0] > 5
    assert inside.max(axis=(0, 1))[0] < 17
    assert min_clearance(scenario, inside) == 0
    assert faults(scenario, LONG) == ["collides with an obstacle"]


def test_a_notch_is_free_though_the_hull_of_its_polygon_covers_it() -> None:
    pocket = np.array([[-5, -4], [35, -4], [35, 4], [-5, 4], [-5, 1.2], [30, 1.2], [30, -1.2], [-5, -1.2]])
    found = verify(task_of(LONG, pocket), LONG)
    assert found.faults == []
    assert 1.2 - 0.95 - PROVEN <= found.min_clearance_m <= 1.2 - 0.95


@pytest.mark.parametrize(("side", "heading"), [(0, math.pi), (1, 0.0), (2, -math.pi / 2), (3, math.pi / 2)])
def test_leaving_the_bounds_by_a_tenth_of_a_millimetre_is_found(side: int, heading: float) -> None:
    a = np.array([0, 1, 0, -1, 0, -1, 0, 1, 0.0])  # ahead, and back to where it began
    plan = driven_straight(np.linspace(0, 8, 9), a, heading)
    farthest = 2.0 + 3.76  # v is 1 at t = 2 and 0 at t = 4, symmetric: 2 m; and the front bumper
    for room, kept in ((1e-4, True), (-1e-4, False)):
        bounds = [-20.0, 20.0, -20.0, 20.0]
        bounds[side] = math.copysign(farthest + room, bounds[side])
        xmin, xmax, ymin, ymax = bounds
        scenario = replace(task_of(plan), bounds=(xmin, xmax, ymin, ymax))
        assert faults(scenario, plan) == ([] if kept else ["leaves the bounds"])


def test_a_corner_that_swings_over_the_bounds_is_found() -> None:
    plan = Trajectory(CLEAN.t, CLEAN.states, CLEAN.inputs.copy())
    plan.inputs[:, Input.W] = 0.3 * np.sin(4 * math.pi * CLEAN.t / 8)
    scenario = replace(task_of(CLEAN), bounds=(-2.0, 20.0, -0.96, 0.96))
    assert "leaves the bounds" in faults(scenario, plan)


def test_standing_exactly_on_the_bounds_is_inside_after_any_move() -> None:
    scenario = replace(task_of(CLEAN), bounds=(-0.929, CLEAN.states[-1, State.X] + 3.76, -0.95, 0.95))
    for dx, dy in np.random.default_rng(0).uniform(-50, 50, (20, 2)):
        assert verify(scenario.translated(dx, dy), CLEAN.translated(dx, dy)).bounds_ok


@pytest.mark.parametrize(
    ("limit", "peak"),
    [("v_max", np.abs(HURRIED.states[:, State.V]).max()), ("a_max", 1.0)],
)
def test_a_limit_exceeded_by_half_a_percent_is_found(limit: str, peak: float) -> None:
    for share, kept in ((1.0005, True), (1.005, False)):
        vehicle = Vehicle.from_dict({limit: peak / share})
        found = verify(replace(task_of(HURRIED), vehicle=vehicle), HURRIED)
        assert found.limits_ok == kept
        assert found.faults == ([] if kept else ["exceeds a limit of the vehicle"])


def test_a_speed_that_exceeds_its_limit_only_between_the_knots_is_found() -> None:
    plan = driven_straight(np.array([0, 1, 3, 4.0]), np.array([0, 1, -1, 0.0]))
    assert plan.states[:, State.V].max() == pytest.approx(0.5)  # at the knots; 1.0 half-way between the inner two
    assert faults(replace(task_of(plan), vehicle=Vehicle(v_max=0.9)), plan) == ["exceeds a limit of the vehicle"]
    assert faults(replace(task_of(plan), vehicle=Vehicle(v_max=1.0)), plan) == []


@pytest.mark.parametrize(("limit", "peak"), [("phi_max", 0.5), ("w_max", 0.5)])
def test_steering_beyond_its_limits_is_found_at_standstill_and_between_the_knots(limit: str, peak: float) -> None:
    w = np.array([0, 0.5, -0.5, 0.0])  # phi is 0.25 at the inner knots and 0.5 half-way between them
    plan = Trajectory(np.array([0, 1, 3, 4.0]), np.zeros((4, 5)), np.column_stack([np.zeros(4), w]))
    plan.states[1:3, State.PHI] = 0.25
    for share, kept in ((1.0005, True), (1.005, False)):
        vehicle = Vehicle.from_dict({limit: peak / share})
        assert verify(replace(task_of(plan), vehicle=vehicle), plan).limits_ok == kept


@pytest.mark.parametrize("axis", [State.X, State.Y])
@pytest.mark.parametrize("sign", [1, -1])
def test_the_goal_is_reached_to_a_centimetre_in_x_and_in_y(axis: State, sign: int) -> None:
    for error, reached in ((0.009, True), (0.011, False)):
        scenario = task_of(CLEAN)
        scenario.goal[axis] += sign * error
        found = verify(scenario, CLEAN)
        assert found.terminal_position_error_m == pytest.approx(error, abs=ENCLOSED)
        assert found.faults == ([] if reached else ["ends 0.011 m off the goal"])


def test_the_goal_is_reached_when_both_coordinates_are_off_by_nine_millimetres() -> None:
    scenario = task_of(CLEAN)
    scenario.goal[:2] += 0.009
    assert faults(scenario, CLEAN) == []


@pytest.mark.parametrize("turns", [0, 1, -3])
@pytest.mark.parametrize("sign", [1, -1])
def test_the_goals_heading_is_reached_to_a_degree_whatever_the_full_turns(turns: int, sign: int) -> None:
    for degrees, reached in ((0.0, True), (0.95, True), (1.05, False), (180.0, False)):
        scenario = task_of(CLEAN)
        scenario.goal[2] += 2 * math.pi * turns + sign * math.radians(degrees)
        found = verify(scenario, CLEAN)
        assert math.degrees(found.terminal_heading_error_rad) == pytest.approx(degrees, abs=1e-9)
        assert found.verified == reached


def spoiled(change: Callable[[np.ndarray, np.ndarray], None]) -> Trajectory:
    states, inputs = CLEAN.states.copy(), CLEAN.inputs.copy()
    change(states, inputs)
    return Trajectory(CLEAN.t, states, inputs)


AT_REST = "does not start or end at rest as asked"


@pytest.mark.parametrize("knot", [0, -1])
@pytest.mark.parametrize("column", [State.V, State.PHI, Input.A, Input.W])
def test_a_plan_that_is_not_at_rest_at_its_ends_is_found(knot: int, column: State | Input) -> None:
    for value, kept in ((0.9e-3, True), (2e-3, False)):

        def change(states: np.ndarray, inputs: np.ndarray, value: float = value) -> None:
            (states if isinstance(column, State) else inputs)[knot, column] = value

        assert verify(task_of(CLEAN), spoiled(change)).ends_ok == kept


def test_a_plan_that_states_rest_but_is_driven_past_it_is_found() -> None:
    def change(states: np.ndarray, inputs: np.ndarray) -> None:
        inputs[-5, Input.A] += 0.05  # 5 mm/s too fast from there on, and less than a centimetre off

    assert faults(task_of(CLEAN), spoiled(change)) == [AT_REST]


@pytest.mark.parametrize("axis", [State.X, State.Y, State.THETA])
def test_a_plan_that_starts_elsewhere_is_found(axis: State) -> None:
    def change(states: np.ndarray, inputs: np.ndarray) -> None:
        states[:, axis] += 2e-3

    assert faults(task_of(CLEAN), spoiled(change)) == [AT_REST]


def test_knots_that_are_not_where_the_inputs_lead_are_measured() -> None:
    def change(states: np.ndarray, inputs: np.ndarray) -> None:
        states[40, [State.X, State.Y]] += [0.3, -0.4]

    assert verify(task_of(CLEAN), spoiled(change)).max_dynamics_gap_m == pytest.approx(0.5, abs=EXACT)


def undrivable(kind: str) -> Trajectory:
    t, states, inputs = CLEAN.t.copy(), CLEAN.states.copy(), CLEAN.inputs.copy()
    match kind:
        case "NaN in the inputs":
            inputs[7, Input.W] = math.nan
        case "infinite input":
            inputs[7, Input.A] = math.inf
        case "NaN in the states":
            states[7, State.Y] = math.nan
        case "NaN in the time":
            t[7] = math.nan
        case "time stands still":
            t[7] = t[6]
        case "time runs backwards":
            t = t[::-1].copy()
        case "inputs that overflow":
            inputs[7] = 1e300
        case _:
            raise ValueError(kind)
    return Trajectory(t, states, inputs)


@pytest.mark.parametrize(
    "kind",
    [
        *("NaN in the inputs", "infinite input", "NaN in the states", "NaN in the time"),
        *("time stands still", "time runs backwards", "inputs that overflow"),
    ],
)
def test_a_plan_that_cannot_be_driven_fails_every_check_and_still_writes_as_json(kind: str) -> None:
    found = verify(task_of(CLEAN, WALL + [2.0, 12.0]), undrivable(kind))
    assert len(found.faults) == 6
    assert json.loads(json.dumps(found.to_dict(), allow_nan=False))["terminal_position_error_m"] is None


def test_every_fault_alone_keeps_a_plan_from_being_verified() -> None:
    clean = Verification(True, 1.0, 0.0, 0.0, 0.0, True, True, True, True)
    assert clean.verified
    for spoil in (
        replace(clean, collision_free=False),
        replace(clean, terminal_position_error_m=0.0101),
        replace(clean, terminal_heading_error_rad=0.0175),
        replace(clean, limits_ok=False),
        replace(clean, bounds_ok=False),
        replace(clean, ends_ok=False),
        replace(clean, certified=False),
    ):
        assert not spoil.verified
        assert len(spoil.faults) == 1


@pytest.mark.parametrize("seed", range(5))
def test_the_clearance_of_a_motion_is_that_of_its_nearest_footprint(seed: int) -> None:
    rng = np.random.default_rng(seed)
    scenario = Scenario.load("crowded_yard")
    poses = np.cumsum(rng.normal(scale=[0.05, 0.05, 0.01], size=(1003, 3)), axis=0) + rng.uniform(0.0, 3.0, 3)
    footprints = scenario.vehicle.footprints(poses)
    every = shapely.distance(np.array(scenario.polygons)[:, None], shapely.polygons(footprints))
    assert min_clearance(scenario, footprints) == every.min()
    for few in (footprints[:1], footprints[:2], footprints[:17]):
        every = shapely.distance(np.array(scenario.polygons)[:, None], shapely.polygons(few))
        assert min_clearance(scenario, few) == every.min()
