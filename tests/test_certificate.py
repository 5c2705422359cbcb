"""What verification proves for all times: the motion's errors, and the clearance between its samples."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely

from drake_gnnocp import Scenario, Trajectory, Vehicle, verify
from drake_gnnocp.simulation import drive
from drake_gnnocp.verification import motion as module
from drake_gnnocp.verification.clearance import OVER, TIGHT, Surroundings, proven_clearances
from drake_gnnocp.verification.motion import motion_of

SPORTY = Vehicle(v_max=12.0, a_max=10.0, phi_max=0.7, w_max=3.0)


def turn(seed: int, vehicle: Vehicle = SPORTY, speed: float = 8.0, seconds: float = 4.0) -> Trajectory:
    """A drive from rest to rest with a swing of the wheels to one side and back, exact at its knots."""
    rng, t = np.random.default_rng(seed), np.linspace(0.0, seconds, 41)
    phase = 2 * math.pi * t / seconds
    a = speed * math.pi / seconds * np.sin(phase)
    w = rng.uniform(0.3, 0.6) * rng.choice([-1, 1]) * math.pi / seconds * np.sin(phase)
    inputs = np.stack([a, w], axis=1)
    inputs[[0, -1]] = 0.0
    motion = drive(np.zeros(3), Trajectory(t, np.zeros((41, 5)), inputs), vehicle)
    return Trajectory(t, motion.states[:: motion.steps_per_interval], inputs)


def task(trajectory: Trajectory, *obstacles: np.ndarray) -> Scenario:
    return Scenario("turn", np.zeros(3), trajectory.poses[-1].copy(), obstacles, vehicle=SPORTY)


def square(centre: np.ndarray, side: float) -> np.ndarray:
    return centre + side / 2 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])


@pytest.mark.parametrize("most_error", [1e-3, module.MOST_ERROR])
@pytest.mark.parametrize("seed", range(4))
def test_the_motion_is_within_its_errors_of_one_with_steps_much_finer(
    seed: int, most_error: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    trajectory = turn(seed)
    monkeypatch.setattr(module, "MOST_ERROR", most_error)
    found = motion_of(np.zeros(3), trajectory, SPORTY)
    fine = motion_of(np.zeros(3), replace_steps(trajectory), SPORTY)
    exact = SPORTY.footprints(fine.states[:, :3])
    off = np.linalg.norm(SPORTY.footprints(found.poses_at(fine.t)) - exact, axis=2).max(axis=1)
    interval = np.clip(np.searchsorted(found.times, fine.t), 1, len(found.times) - 1)
    assert (off <= found.errors[interval] + fine.errors[-1]).all()
    assert found.errors.max() <= most_error + module.ROUNDING and off.max() > most_error / 1000
    assert np.abs(found.poses_at(fine.t) - fine.states[:, :3])[:, 2].max() <= found.heading_error + 1e-12
    assert len(found.t) < len(fine.t) / 10


def test_knots_of_any_spacing_are_samples_of_the_motion() -> None:
    t = np.array([3.0, 3.001, 3.5, 8.0, 8.25])
    inputs = np.array([[0.0, 0.0], [1.0, 0.2], [0.5, -0.1], [-0.2, 0.0], [0.0, 0.0]])
    motion = motion_of(np.zeros(3), Trajectory(t, np.zeros((5, 5)), inputs), SPORTY)
    assert (motion.times == t).all() and (motion.inputs[motion.knots] == pytest.approx(inputs))
    exact = np.cumsum(np.diff(t)[:, None] * (inputs[1:] + inputs[:-1]) / 2, axis=0)
    assert motion.states[motion.knots[1:], 3:] == pytest.approx(exact)
    assert len(np.unique(np.diff(motion.knots))) > 1


def test_a_drive_that_needs_too_many_steps_is_refused() -> None:
    for seconds, stays in ((900.0, True), (1e300, False)):
        still = Trajectory(np.array([0.0, seconds]), np.zeros((2, 5)), np.zeros((2, 2)))
        assert verify(task(still), still).verified == stays
    wild = Trajectory(np.array([0.0, 9e4]), np.zeros((2, 5)), np.array([[1.0, 1.0], [0.0, 0.0]]))
    with pytest.raises(OverflowError, match="too many"):
        motion_of(np.zeros(3), wild, SPORTY)
    assert not verify(task(wild), wild).verified


@pytest.mark.parametrize("seed", range(4))
def test_no_point_of_the_car_bends_more_than_is_said(seed: int) -> None:
    trajectory = turn(seed)
    motion = motion_of(np.zeros(3), trajectory, SPORTY)
    h = 1e-3
    corners = SPORTY.footprints(motion.poses_at(np.arange(0.0, trajectory.duration, h)))
    second = np.linalg.norm(corners[2:] - 2 * corners[1:-1] + corners[:-2], axis=2).max(axis=1) / h**2
    assert second.max() <= motion.bends.max() * (1 + 1e-6)
    assert second.max() > 0.3 * motion.bends.max()
    for k, bend in enumerate(motion.bends):
        assert second[100 * k : 100 * k + 99].max() <= bend * (1 + 1e-6)


def finest_clearance(trajectory: Trajectory, scenario: Scenario) -> float:
    """At every 0.1 ms."""
    fine = motion_of(np.zeros(3), replace_steps(trajectory), SPORTY)
    cars = shapely.polygons(SPORTY.footprints(fine.states[:, :3]))
    return float(shapely.distance(np.array(scenario.polygons)[:, None], cars).min())


def replace_steps(trajectory: Trajectory) -> Trajectory:
    """The same motion with knots 0.2 ms apart, which the integration cuts in two."""
    t = np.linspace(0.0, trajectory.duration, 1 + round(trajectory.duration / 2e-4))
    inputs = np.stack([np.interp(t, trajectory.t, column) for column in trajectory.inputs.T], axis=1)
    return Trajectory(t, np.zeros((len(t), 5)), inputs)


@pytest.mark.parametrize("seed", range(8))
def test_the_proven_clearance_is_below_the_finest_one_and_tight(seed: int) -> None:
    trajectory, rng = turn(seed), np.random.default_rng(seed)
    middle = trajectory.poses[20, :2]
    posts = [square(middle + rng.uniform(3.0, 6.0) * np.array([np.cos(b), np.sin(b)]), 0.3) for b in (1.0, 3.0, 5.0)]
    scenario = task(trajectory)
    obstacles = tuple(post for post in posts if finest_clearance(trajectory, replace(scenario, obstacles=(post,))) > 0)
    scenario = replace(scenario, obstacles=obstacles)
    if not obstacles:
        pytest.skip("all posts stand in the way")
    found, exact = verify(scenario, trajectory), finest_clearance(trajectory, scenario)
    assert found.certified and exact - TIGHT <= found.min_clearance_m <= exact


def test_a_post_that_a_corner_sweeps_over_between_two_samples_is_found() -> None:
    trajectory = turn(1)
    motion = motion_of(np.zeros(3), trajectory, SPORTY)
    fine = motion_of(np.zeros(3), replace_steps(trajectory), SPORTY)
    samples = shapely.polygons(SPORTY.footprints(motion.poses_at(np.arange(0.0, trajectory.duration, 0.005))))
    fastest = int(np.abs(fine.states[:, 3]).argmax())
    missed = 0
    for k in range(fastest - 200, fastest + 200, 20):
        for corner in SPORTY.footprints(fine.states[[k], :3])[0]:
            inwards = fine.states[k, :2] - corner
            post = square(corner + 1.5e-3 * inwards / np.linalg.norm(inwards), 1e-3)
            if shapely.intersects(shapely.Polygon(post), samples).any():
                continue  # seen by sampling as well
            missed += 1
            found = verify(task(trajectory, post), trajectory)
            assert found.min_clearance_m == 0.0
            assert found.faults in (["collides with an obstacle"], ["is not proven to keep clear at all times"])
    assert missed > 5


def test_touching_the_bounds_at_rest_is_inside_and_a_swing_beyond_them_between_samples_is_not() -> None:
    trajectory = turn(2)
    scenario = task(trajectory)
    corners = SPORTY.footprints(motion_of(np.zeros(3), replace_steps(trajectory), SPORTY).states[:, :3])
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    for room, proven in ((1e-3, True), (1e-6, True), (-2 * TIGHT, False)):
        bounds = (low[0] - 1e-9, high[0] + 1.0, low[1] - max(room, -1e-9), high[1] + room)
        motion = motion_of(np.zeros(3), trajectory, SPORTY)
        found = proven_clearances(replace_bounds(scenario, bounds), motion).bounds
        assert found.proven <= found.seen and (found.proven >= -OVER) == proven


def replace_bounds(scenario: Scenario, bounds: tuple[float, float, float, float]) -> Scenario:
    copy = Scenario(scenario.name, scenario.start, scenario.goal, vehicle=scenario.vehicle)
    object.__setattr__(copy, "bounds", bounds)  # a task that its plan leaves would be refused
    return copy


def test_without_obstacles_and_bounds_there_is_nothing_to_prove() -> None:
    trajectory = turn(0)
    found = proven_clearances(task(trajectory), motion_of(np.zeros(3), trajectory, SPORTY))
    for least in (found.obstacles, found.bounds, found.beyond_demand):
        assert (least.seen, least.proven) == (math.inf, math.inf)
    assert verify(task(trajectory), trajectory).verified


# --- the clearance that is asked for ---

LENGTH = SPORTY.length


def lane(**changes: Any) -> tuple[Scenario, Trajectory]:
    """A straight drive of 40 m, and walls: 0.2 m beside the car at the start and 0.5 m beside it from 8 m on."""
    t = np.linspace(0.0, 20.0, 81)
    a = 40.0 * 2 * math.pi / 400 * np.sin(2 * math.pi * t / 20.0)
    motion = motion_of(np.zeros(3), Trajectory(t, np.zeros((81, 5)), np.stack([a, 0 * a], axis=1)), SPORTY)
    plan = Trajectory(t, motion.states[motion.knots], np.stack([a, 0 * a], axis=1))
    side = SPORTY.width / 2
    walls = ([[-2, side + 0.2], [-0.5, side + 0.2], [-0.5, 5], [-2, 5]], [[8, side + 0.5], [60, side + 0.5], [60, 5]])
    return replace(task(plan, *(np.array(wall) for wall in walls)), **changes), plan


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({"clearance": 0.45}, None),  # 0.2 m at the start are exempt
        ({"clearance": 0.5009}, None),  # what is asked for is proven to a millimetre
        ({"clearance": 0.53}, "keeps 0.50 m where 0.53 m are asked"),
        ({"clearance": 0.45, "bounds": (-2.0, 60.0, -5.0, 5.0)}, None),
        (
            {"clearance": 0.45, "bounds": (-2.0, 60.0, -SPORTY.width / 2 - 0.3, 5.0)},
            "keeps 0.30 m where 0.45 m are asked",
        ),
        ({"clearance": 0.29, "bounds": (-2.0, 60.0, -SPORTY.width / 2 - 0.3, 5.0)}, None),
    ],
)
def test_the_clearance_that_is_asked_for_is_kept_to_obstacles_and_bounds(
    changes: dict[str, Any], fault: str | None
) -> None:
    scenario, plan = lane(**changes)
    found = verify(scenario, plan)
    assert found.faults == ([] if fault is None else [fault])
    assert found.clearance_ok == (fault is None)
    assert found.min_clearance_m == pytest.approx(0.2, abs=TIGHT)  # to obstacles


@pytest.mark.parametrize("offset", [-0.05, 0.05])
def test_the_exemption_ends_one_length_of_the_car_from_the_start(offset: float) -> None:
    # a wall 0.3 m beside the lane that the car has left when its axle is a length from the start, or just not
    end = LENGTH - SPORTY.rear_hang + offset
    beside = SPORTY.width / 2 + 0.3
    wall = np.array([[-2.0, beside], [end, beside], [end, 5.0], [-2.0, 5.0]])
    scenario, plan = lane(clearance=0.5)
    found = verify(replace(scenario, obstacles=(wall,)), plan)
    assert found.clearance_ok == (math.hypot(0.3, max(0.0, -offset)) > 0.5 or offset < -0.4)


def test_no_more_is_asked_near_an_end_than_what_the_car_has_there_but_no_less() -> None:
    post = square(np.array([3.0 + SPORTY.wheelbase, -SPORTY.width / 2 - 0.15]), 0.1)  # 0.1 m, within the zone
    scenario, plan = lane(clearance=0.45)
    scenario = replace(scenario, obstacles=(*scenario.obstacles, post))
    first, around = verify(scenario, plan).first_fault, Surroundings(scenario)
    assert first is not None and first.x == pytest.approx(post[0, 0], abs=0.2)
    axle = np.interp(first.t, plan.t, plan.poses[:, 0])
    assert around.to_obstacles(shapely.polygons(SPORTY.footprints(np.array([axle, 0, 0]))))[0] == pytest.approx(
        0.2, abs=0.03
    )


def test_a_stretch_that_may_leave_a_zone_is_asked_for_the_larger_demand() -> None:
    around = Surroundings(lane(clearance=0.45)[0])
    for x, spread, asked in ((4.6, 0.0, 0.2), (4.6, 0.15, 0.45), (LENGTH + 1e-3, 0.0, 0.45), (38.0, 0.0, 0.45)):
        assert around.demand(np.array([[[1.0, 0.0], [x, 0.0]]]), spread)[0] == pytest.approx(asked), x


def test_both_zones_overlap_with_the_smaller_of_what_both_ends_have() -> None:
    plan = lane()[1]
    short = Trajectory(plan.t, np.zeros((81, 5)), plan.inputs / 20)  # 2 m
    beside = SPORTY.width / 2 + np.array([0.3, 0.1])
    front = SPORTY.wheelbase + SPORTY.front_hang
    walls = (
        [[-5, beside[0]], [front + 1, beside[0]], [front + 1, 5]],
        [[front + 1, -beside[1]], [20, -beside[1]], [20, -5]],
    )
    scenario = replace(task(short, *(np.array(wall) for wall in walls)), goal=np.array([2.0, 0.0, 0.0]), clearance=0.5)
    assert verify(scenario, short).clearance_ok


# --- where and when ---


def test_a_collision_is_placed_where_the_car_first_touches() -> None:
    plan = lane()[1]
    wall = np.array([[20.0, -3.0], [30.0, -3.0], [30.0, 3.0], [20.0, 3.0]])
    found = verify(task(plan, wall), plan)
    first = found.first_fault
    assert first is not None and first.fault == "collides with an obstacle"
    assert first.x == pytest.approx(20.0, abs=0.02) and abs(first.y) <= SPORTY.width / 2 + 1e-9
    nose = np.interp(first.t, plan.t, plan.poses[:, 0]) + SPORTY.wheelbase + SPORTY.front_hang
    assert nose == pytest.approx(20.0, abs=0.1)
    assert found.to_dict()["faults"][0]["x"] == first.x


def test_the_least_clearance_is_placed_and_moves_with_the_task() -> None:
    scenario, plan = lane(bounds=(-2.0, 60.0, -2.0, 6.0))
    found = verify(scenario, plan)
    assert found.nearest is not None and found.nearest[0] == 0.0
    assert found.nearest[2] == pytest.approx(SPORTY.width / 2)
    moved = found.translated(100.0, -10.0)
    assert moved.nearest is not None and moved.nearest[1:] == pytest.approx(
        np.array(found.nearest[1:]) + [100.0, -10.0]
    )
    assert found.clearance_text.startswith("clearance 0.20 m at (-") and found.first_fault is None


def test_every_limit_is_a_finding_with_its_place() -> None:
    scenario, plan = lane(vehicle=replace(SPORTY, v_max=3.0))
    first = verify(scenario, plan).first_fault
    assert first is not None and first.what == "speed" and first.allowed == "at most 3 m/s"
    assert np.interp(first.t, plan.t, plan.states[:, 3]) == pytest.approx(3.0, abs=0.2)
