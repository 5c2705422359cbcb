"""The speed planner: limits, exact splines, stops at gear changes, poses on the path, sensible durations."""

import math
from functools import cache

import numpy as np
import pytest

from drake_gnnocp.search.moves import poses_along
from drake_gnnocp.search.path import GearedPath
from drake_gnnocp.search.reeds_shepp import all_paths
from drake_gnnocp.timing.speed_planner import STANDING_TIME, plan_speed
from drake_gnnocp.timing.speed_profile import A_FRACTION, V_FRACTION, W_FRACTION
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import Input, State, Vehicle

EXACT = 1e-9  # relative to the limit or absolute: only rounding errors
STEP = 0.1  # m, between the poses of the paths made here
ON_PATH = 3e-3  # m: poses lie on chords of the path, STEP long, and the motion between knots on arcs
POSITION_DEFECT = 0.01  # m an interval: a curvature jump of 0.6 / m smoothed over 1.5 m moves the path by 6 cm in all
HEADING_DEFECT = 0.05  # rad an interval: full lock over the swing distance, 0.15 m / 3.3 m
MEAN_HEADING_DEFECT = 4e-3  # rad: the defects are few, at stops and where the curvature jumps
SLOWER = 1.6  # the duration over that of a driver who uses all limits in full: 1 / sqrt(0.6), and rests at the stops
BLOCKS = [range(0, 80), range(80, 160)]
VEHICLES = {"paper": Vehicle(), "tpcap": Vehicle(width=1.942, a_max=1.0, phi_max=0.75, w_max=0.5)}

pytestmark = pytest.mark.parametrize("vehicle", VEHICLES.values(), ids=VEHICLES)


def arcs(*pieces: tuple[float, float], start: tuple[float, float, float] = (1.0, 2.0, 0.5)) -> GearedPath:
    """A path of arcs, each (signed length [m], curvature [1/m]); negative lengths are driven in reverse."""
    poses, gears, curvatures = [np.array(start)], [0], [0.0]
    for length, curvature in pieces:
        n = max(1, math.ceil(abs(length) / STEP))
        x, y, theta = poses[-1]
        for s in np.linspace(0.0, length, n + 1)[1:]:
            chord, middle = s * np.sinc(0.5 * s * curvature / math.pi), theta + 0.5 * s * curvature
            poses.append(np.array([x + chord * math.cos(middle), y + chord * math.sin(middle), theta + s * curvature]))
            gears.append(1 if length > 0 else -1)
            curvatures.append(curvature)
    if len(gears) > 1:
        gears[0], curvatures[0] = gears[1], curvatures[1]
    return GearedPath(np.array(poses), np.array(gears), np.array(curvatures))


@cache
def random_plan(seed: int, vehicle: Vehicle) -> tuple[GearedPath, Trajectory]:
    """A Reeds-Shepp path between random poses within 2 m to 40 m, and its trajectory."""
    rng = np.random.default_rng(seed)
    size = rng.choice([1.0, 5.0, 20.0])
    start, goal = rng.uniform([-size, -size, -math.pi], [size, size, math.pi], (2, 3))
    path = poses_along(start, all_paths(start, goal, vehicle.turning_radius)[0], STEP)
    return path, plan_speed(path, vehicle)


def stops(path: GearedPath) -> np.ndarray:
    """Poses where the gear changes: (C, 3)."""
    return path.poses[np.flatnonzero(np.diff(path.gears))]


def assert_legal(trajectory: Trajectory, vehicle: Vehicle) -> None:
    """Zeros at both ends, limits, and exact integrals of linear inputs."""
    h = np.diff(trajectory.t)
    np.testing.assert_allclose(h, h[0], rtol=EXACT)
    np.testing.assert_array_equal(trajectory.states[[0, -1], State.V :], 0.0)
    np.testing.assert_array_equal(trajectory.inputs[[0, -1]], 0.0)
    limits: list[tuple[State | Input, float]] = [
        (State.V, vehicle.v_max),
        (State.PHI, vehicle.phi_max),
        (Input.A, vehicle.a_max),
        (Input.W, vehicle.w_max),
    ]
    for column, limit in limits:
        assert np.abs(trajectory.column(column)).max() <= limit * (1 + EXACT), column
    for state, rate in [(State.V, Input.A), (State.PHI, Input.W)]:
        r = trajectory.column(rate)
        np.testing.assert_allclose(np.diff(trajectory.column(state)), h * (r[1:] + r[:-1]) / 2, atol=EXACT)


def distances_to(path: GearedPath, points: np.ndarray) -> np.ndarray:
    """Distance of points (N, 2) to the polyline of the path: (N,) [m]."""
    a, b = path.poses[:-1, :2], path.poses[1:, :2]
    ab = b - a
    squared = np.maximum(np.sum(ab**2, axis=1), 1e-18)
    f = np.clip(np.sum((points[:, None] - a) * ab, axis=2) / squared, 0.0, 1.0)
    return np.linalg.norm(points[:, None] - a - f[..., None] * ab, axis=2).min(axis=1)


def defects(trajectory: Trajectory, vehicle: Vehicle) -> np.ndarray:
    """What each knot misses the bicycle model by, integrated from the knot before: (N - 1, 5) x, y, theta, v, phi."""
    substeps = 20
    dt = (trajectory.t[1] - trajectory.t[0]) / substeps
    states = trajectory.states[:-1]
    for k in range(substeps):
        first, middle = (
            trajectory.inputs[:-1] + f * np.diff(trajectory.inputs, axis=0)
            for f in (k / substeps, (k + 0.5) / substeps)
        )
        half = states + 0.5 * dt * vehicle.rates(states, first)
        states = states + dt * vehicle.rates(half, middle)
    return np.abs(states - trajectory.states[1:])


@pytest.mark.parametrize("seeds", BLOCKS, ids=str)
def test_random_paths_become_legal_trajectories_on_the_path(vehicle: Vehicle, seeds: range) -> None:
    for seed in seeds:
        path, trajectory = random_plan(seed, vehicle)
        assert len(trajectory) == 120
        assert_legal(trajectory, vehicle)
        np.testing.assert_allclose(trajectory.poses[[0, -1]], path.poses[[0, -1]], atol=EXACT)
        assert distances_to(path, trajectory.poses[:, :2]).max() <= EXACT
        turns = np.abs(np.diff(trajectory.column(State.THETA)))
        assert turns.max() <= vehicle.v_max * trajectory.t[1] / vehicle.turning_radius + EXACT  # no jumps


@pytest.mark.parametrize("seeds", BLOCKS, ids=str)
def test_the_gear_changes_at_the_cusps_and_nowhere_else(vehicle: Vehicle, seeds: range) -> None:
    for seed in seeds:
        path, trajectory = random_plan(seed, vehicle)
        v = trajectory.column(State.V)
        assert not np.any(v[:-1] * v[1:] < 0.0)  # v is zero at a knot in between
        moving = np.flatnonzero(v)
        changes = np.flatnonzero(np.diff(np.sign(v[moving])))
        at = np.array([trajectory.poses[moving[i] + 1] for i in changes]).reshape(-1, 3)
        np.testing.assert_allclose(at, stops(path), atol=EXACT)


@pytest.mark.parametrize("seeds", BLOCKS, ids=str)
def test_the_bicycle_model_nearly_follows(vehicle: Vehicle, seeds: range) -> None:
    for seed in seeds:
        largest = defects(random_plan(seed, vehicle)[1], vehicle)
        assert largest[:, : State.THETA].max() <= POSITION_DEFECT, seed
        assert largest[:, State.THETA].max() <= HEADING_DEFECT, seed
        assert largest[:, State.THETA].mean() <= MEAN_HEADING_DEFECT, seed


def test_a_constant_arc_is_followed_closely_away_from_its_ends(vehicle: Vehicle) -> None:
    curvature = 0.6 / vehicle.turning_radius
    trajectory = plan_speed(arcs((15.0, curvature)), vehicle)
    middle = slice(len(trajectory) // 4, 3 * len(trajectory) // 4)
    np.testing.assert_allclose(
        trajectory.column(State.PHI)[middle], math.atan(vehicle.wheelbase * curvature), rtol=1e-6
    )
    largest = defects(trajectory, vehicle)[middle]
    assert largest[:, : State.V].max() <= ON_PATH


@pytest.mark.parametrize("length", [0.1, 1.0, 5.0, 20.0, 60.0, -20.0])
def test_a_straight_line_takes_as_long_as_the_trapezoidal_profile(vehicle: Vehicle, length: float) -> None:
    v, a = V_FRACTION * vehicle.v_max, A_FRACTION * vehicle.a_max
    way = abs(length)
    expected = way / v + v / a if way > v * v / a else 2.0 * math.sqrt(way / a)
    trajectory = plan_speed(arcs((length, 0.0)), vehicle)
    h = trajectory.t[1]
    assert expected <= trajectory.duration <= expected + 3.0 * h + EXACT  # one interval at rest at either end
    np.testing.assert_array_equal(trajectory.column(State.PHI), 0.0)
    full = way / vehicle.v_max + vehicle.v_max / vehicle.a_max
    if way > vehicle.v_max**2 / vehicle.a_max:
        assert trajectory.duration <= SLOWER * full
        assert np.abs(trajectory.column(State.V)).max() >= 0.85 * vehicle.v_max


@pytest.mark.parametrize("length", [0.1, 5.0, -20.0])
def test_the_way_driven_is_the_exact_integral_of_the_speed(vehicle: Vehicle, length: float) -> None:
    trajectory = plan_speed(arcs((length, 0.0), start=(0.0, 0.0, 0.0)), vehicle)
    v, a, h = trajectory.column(State.V), trajectory.column(Input.A), trajectory.t[1]
    way = h * (v[1:] + v[:-1]) / 2 - h**2 * np.diff(a) / 12  # of a quadratic v, by Hermite's rule
    np.testing.assert_allclose(np.diff(trajectory.column(State.X)), way, atol=EXACT)


def test_a_share_of_the_limits_is_left_to_the_optimizer(vehicle: Vehicle) -> None:
    tight = 1.0 / vehicle.turning_radius
    trajectory = plan_speed(arcs((8.0, tight), (-5.0, -tight), (12.0, 0.0), (6.0, tight)), vehicle)
    limits: list[tuple[State | Input, float]] = [
        (State.V, V_FRACTION * vehicle.v_max),
        (Input.A, A_FRACTION * vehicle.a_max),
        (Input.W, W_FRACTION * vehicle.w_max),
    ]
    for column, limit in limits:
        # all of the share is used, and no more; the spline rounds the corner off a speed that is only just reached
        assert 0.9 * limit <= np.abs(trajectory.column(column)).max() <= limit * (1 + EXACT), column


def test_gear_changes_take_about_as_long_as_the_wheels_swing(vehicle: Vehicle) -> None:
    tight = 1.0 / vehicle.turning_radius
    trajectory = plan_speed(arcs((4.0, tight), (-4.0, -tight), (4.0, tight)), vehicle)
    drive = 4.0 / vehicle.v_max + vehicle.v_max / vehicle.a_max
    if vehicle.v_max**2 / vehicle.a_max > 4.0:
        drive = 2.0 * math.sqrt(4.0 / vehicle.a_max)
    swings = (1 + 2 + 2 + 1) * vehicle.phi_max / vehicle.w_max
    assert 3 * drive <= trajectory.duration <= SLOWER * (3 * drive + swings)


def test_a_path_of_no_length_gives_a_short_stand(vehicle: Vehicle) -> None:
    pose = np.array([[3.0, -2.0, 7.0]])
    for n in (1, 2, 5):
        path = GearedPath(np.repeat(pose, n, axis=0), np.ones(n), np.zeros(n))
        trajectory = plan_speed(path, vehicle)
        assert len(trajectory) == 120
        assert trajectory.duration == STANDING_TIME
        np.testing.assert_array_equal(trajectory.poses, np.repeat(pose, 120, axis=0))
        assert_legal(trajectory, vehicle)


@pytest.mark.parametrize("length", [1e-6, 1e-3, 0.02, 0.1])
def test_very_short_sections_are_driven(vehicle: Vehicle, length: float) -> None:
    tight = 1.0 / vehicle.turning_radius
    path = arcs((length, tight), (-3.0, 0.0), (length, -tight), (-length, tight))
    trajectory = plan_speed(path, vehicle)
    assert_legal(trajectory, vehicle)
    assert distances_to(path, trajectory.poses[:, :2]).max() <= EXACT
    np.testing.assert_allclose(trajectory.poses[-1], path.poses[-1], atol=EXACT)


def test_many_gear_changes_fit(vehicle: Vehicle) -> None:
    tight = 1.0 / vehicle.turning_radius
    path = arcs(*[(1.5 * (-1) ** i, tight * (-1) ** i) for i in range(11)])
    for n_knots in (120, 40):
        trajectory = plan_speed(path, vehicle, n_knots)
        assert len(trajectory) == n_knots
        assert_legal(trajectory, vehicle)
        v = trajectory.column(State.V)
        assert np.count_nonzero(np.diff(np.sign(v[v != 0.0]))) == 10
        for pose in stops(path):
            assert np.linalg.norm(trajectory.poses - pose, axis=1).min() <= EXACT


def test_too_few_knots_for_the_gear_changes_are_an_error(vehicle: Vehicle) -> None:
    path = arcs(*[(1.0 * (-1) ** i, 0.0) for i in range(11)])
    with pytest.raises(ValueError, match="30 knots are too few for a path of 11 sections"):
        plan_speed(path, vehicle, 30)


@pytest.mark.parametrize("n_knots", [4, 10, 30, 120, 500])
def test_any_number_of_knots(vehicle: Vehicle, n_knots: int) -> None:
    trajectory = plan_speed(arcs((10.0, 0.1), (5.0, -0.1)), vehicle, n_knots)
    assert len(trajectory) == n_knots
    assert_legal(trajectory, vehicle)


def test_repeated_poses_change_nothing(vehicle: Vehicle) -> None:
    path = arcs((5.0, 0.2), (-3.0, 0.0))
    twice = GearedPath(*(np.repeat(values, 2, axis=0) for values in (path.poses, path.gears, path.curvatures)))
    np.testing.assert_array_equal(plan_speed(twice, vehicle).states, plan_speed(path, vehicle).states)


def test_mirrored_and_reversed_gear_paths_give_mirrored_trajectories(vehicle: Vehicle) -> None:
    pieces = [(6.0, 0.2), (4.0, -0.1), (-5.0, 0.25)]
    plain = plan_speed(arcs(*pieces, start=(0.0, 0.0, 0.0)), vehicle)
    mirrored = plan_speed(arcs(*[(s, -k) for s, k in pieces], start=(0.0, 0.0, 0.0)), vehicle)
    np.testing.assert_allclose(mirrored.states, plain.states * [1, -1, -1, 1, -1], atol=EXACT)
    backwards = plan_speed(arcs(*[(-s, k) for s, k in pieces], start=(0.0, 0.0, 0.0)), vehicle)
    np.testing.assert_allclose(backwards.states, plain.states * [-1, 1, -1, -1, 1], atol=EXACT)
