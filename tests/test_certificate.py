"""What verification proves for all times: the motion's errors, and the clearance between its samples."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

from drake_gnnocp import Scenario, Trajectory, Vehicle, verify
from drake_gnnocp.simulation import drive
from drake_gnnocp.verification import motion as module
from drake_gnnocp.verification.clearance import TIGHT, proven_clearance, proven_inside
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


def motion_in_steps(trajectory: Trajectory, steps: int, monkeypatch: pytest.MonkeyPatch) -> module.Motion:
    """The motion by so many steps of integration an interval."""
    monkeypatch.setattr(module, "MAX_STEP", float(np.diff(trajectory.t).max()) / (steps - 0.5))
    motion = motion_of(np.zeros(3), trajectory, SPORTY)
    assert motion.steps_per_interval == steps
    return motion


@pytest.mark.parametrize("steps", [2, 20])
@pytest.mark.parametrize("seed", range(4))
def test_the_motion_is_within_its_errors_of_one_with_steps_ten_times_finer(
    seed: int, steps: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    trajectory = turn(seed)
    found, fine = (motion_in_steps(trajectory, n, monkeypatch) for n in (steps, 10 * steps))
    corners, exact = (SPORTY.footprints(states[:, :3]) for states in (found.states, fine.states[::10]))
    off = np.linalg.norm(corners - exact, axis=2).max(axis=1)
    assert (off <= found.errors).all() and found.errors.max() < 1e-4
    assert (np.abs(found.states[:, 2] - fine.states[::10, 2]) <= found.heading_errors + 1e-12).all()
    if steps == 2:
        assert off.max() > 10 * module.ROUNDING  # Simpson's rule is visibly off: the errors are not only rounding
    between = SPORTY.footprints(found.poses_at(fine.t))
    off = np.linalg.norm(between - SPORTY.footprints(fine.states[:, :3]), axis=2).max(axis=1)
    assert (off <= found.errors[found.step_at(fine.t) + 1] + 1e-12).all()


@pytest.mark.parametrize("seed", range(4))
def test_no_point_of_the_car_bends_more_than_is_said(seed: int) -> None:
    trajectory = turn(seed)
    motion = motion_of(np.zeros(3), trajectory, SPORTY)
    corners, h = SPORTY.footprints(motion.states[:, :3]), np.diff(motion.t)[0]
    second = np.linalg.norm(corners[2:] - 2 * corners[1:-1] + corners[:-2], axis=2).max(axis=1) / h**2
    assert (second <= np.maximum(motion.bends[1:], motion.bends[:-1]) * (1 + 1e-6)).all()
    assert second.max() > 0.3 * motion.bends.max()


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
    samples = shapely.polygons(SPORTY.footprints(motion.states[:, :3]))
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
    corners = SPORTY.footprints(motion_of(np.zeros(3), trajectory, SPORTY).states[:, :3])
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    for room, proven in ((1e-3, True), (1e-9, True), (-2 * TIGHT, False)):
        bounds = (low[0] - 1e-9, high[0] + 1.0, low[1] - max(room, -1e-9), high[1] + room)
        motion = motion_of(np.zeros(3), trajectory, SPORTY)
        inside, sampled = proven_inside(replace_bounds(scenario, bounds), motion)
        assert inside <= sampled and (inside >= -TIGHT) == proven


def replace_bounds(scenario: Scenario, bounds: tuple[float, float, float, float]) -> Scenario:
    copy = Scenario(scenario.name, scenario.start, scenario.goal, vehicle=scenario.vehicle)
    object.__setattr__(copy, "bounds", bounds)  # a task that its plan leaves would be refused
    return copy


def test_without_obstacles_and_bounds_there_is_nothing_to_prove() -> None:
    trajectory = turn(0)
    motion = motion_of(np.zeros(3), trajectory, SPORTY)
    assert proven_clearance(task(trajectory), motion) == (math.inf, math.inf)
    assert proven_inside(task(trajectory), motion) == (math.inf, math.inf)
    assert verify(task(trajectory), trajectory).verified
