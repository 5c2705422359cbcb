"""Reeds-Shepp paths against OMPL, against closed forms, and against a drive along the path by other formulas."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import pytest

from drake_gnnocp.search.moves import Move, length_of, poses_along
from drake_gnnocp.search.reeds_shepp import all_paths, path_length

RADIUS = 5.0  # m
ENDS_AT_GOAL = 1e-9  # m and rad: rounding over 100 m is near 1e-13, and segments under 1e-12 radii are dropped
SAME_LENGTH = 1e-9  # m: two orders of the same sums; poses 0.01 m apart lose four digits to a square root
OMPL_LENGTH = 1e-6  # m: where poses are equal but for rounding, lengths are its square root; 3e-12 m elsewhere
GOLDEN_LENGTH = 1e-11  # turning radii: digits kept below
ON_PATH = 1e-9  # m and rad: as ENDS_AT_GOAL

# One goal for each word that can be shortest, from the origin with radius 1; lengths from OMPL 2.0.1.
GOLDEN = {
    "LSL": ((-5.8, -6.0, 1.6), 8.510351002786),
    "LSR": ((-5.4, -4.4, 0.0), 7.087559846706),
    "LRL": ((1.6, 0.5, -1.5), 2.609241543743),
    "LRLR, middle arcs alike": ((-0.4, 1.5, 0.0), 2.972209481338),
    "LRLR, middle arcs opposed": ((-0.2, -0.6, -0.6), 1.840263621927),
    "LRSL": ((1.1, 3.2, -1.4), 4.337179498043),
    "LSRL": ((-3.0, -1.9, -1.3), 4.499073808691),
    "LRSR": ((0.8, 2.5, -2.6), 3.552385632219),
    "LSLR": ((-2.2, 1.7, -2.6), 3.730151799950),
    "LRSLR": ((0.4, 3.2, -0.1), 4.656875660697),
}


def random_pairs(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Starts and goals, (count, 3) each, from 0.01 m to 100 m apart; in a third the headings differ little too."""
    rng = np.random.default_rng(seed)
    apart = 10 ** rng.uniform(-2, 2, (count, 1))  # m
    starts = rng.uniform([-50, -50, -np.pi], [50, 50, np.pi], (count, 3))
    goals = starts + np.hstack([rng.uniform(-apart, apart, (count, 2)), rng.uniform(-np.pi, np.pi, (count, 1))])
    goals[::3, 2] = starts[::3, 2] + 0.05 * apart[::3, 0] * rng.normal(size=len(goals[::3]))
    return starts, goals


def degenerate_pairs(count: int, seed: int) -> list[tuple[np.ndarray, np.ndarray, float]]:
    """Start, goal and the length driven between them along words whose segments vanish or are a special angle."""
    rng = np.random.default_rng(seed)
    curvatures = {"L": 1 / RADIUS, "S": 0.0, "R": -1 / RADIUS}
    words = ["L", "R", "S", "LS", "LR", "LSL", "LSR", "RSR", "RLR", "RLRL", "LRSL", "LSRL", "LRSR", "RSRL", "LRSLR"]
    angles = [0.0, math.pi / 6, math.pi / 3, math.pi / 2, math.pi, -math.pi / 4, -math.pi / 2, -math.pi, 1.0, -2.0]
    pairs = []
    for k in range(count):
        start = np.zeros(3) if k % 2 else rng.uniform([-30, -30, -3], [30, 30, 3])
        path = [Move(curvatures[turn], RADIUS * rng.choice(angles)) for turn in words[k % len(words)]]
        pairs.append((start, end_of(start, path), length_of(path)))
    return pairs


def end_of(start: Sequence[float] | np.ndarray, path: list[Move], distance: float = math.inf) -> np.ndarray:
    """The pose after a distance along the path, by rotating about the centre of each arc's circle."""
    position, theta = complex(start[0], start[1]), float(start[2])
    for move in path:
        length = math.copysign(min(abs(move.length), distance), move.length)
        distance -= abs(length)
        if move.curvature == 0:
            position += length * complex(math.cos(theta), math.sin(theta))
        else:
            centre = position + complex(-math.sin(theta), math.cos(theta)) / move.curvature
            turn = move.curvature * length
            position = centre + (position - centre) * complex(math.cos(turn), math.sin(turn))
            theta += turn
    return np.array([position.real, position.imag, theta])


def distance_between(pose: np.ndarray, other: np.ndarray) -> float:
    """Largest of |dx|, |dy| and |dtheta|, headings compared modulo one turn."""
    dx, dy, dtheta = np.abs(pose - other)
    return float(max(dx, dy, abs(math.remainder(dtheta, 2 * math.pi))))


@pytest.fixture(scope="module")
def ompl_length() -> Callable[[np.ndarray, np.ndarray], float]:
    """Length of the shortest path by OMPL's ReedsSheppStateSpace."""
    base = pytest.importorskip("ompl.base", reason="OMPL, the independent implementation, is not installed")
    space = base.ReedsSheppStateSpace(RADIUS)
    bounds = base.RealVectorBounds(2)
    bounds.setLow(-1000)
    bounds.setHigh(1000)
    space.setBounds(bounds)
    states = space.allocState(), space.allocState()

    def length(start: np.ndarray, goal: np.ndarray) -> float:
        for state, pose in zip(states, (start, goal), strict=True):
            state.setX(float(pose[0]))
            state.setY(float(pose[1]))
            state.setYaw(float(pose[2]))
        return float(space.distance(*states))

    return length


def test_lengths_equal_those_of_ompl(ompl_length: Callable[[np.ndarray, np.ndarray], float]) -> None:
    for start, goal in zip(*random_pairs(2000, seed=0), strict=True):
        assert path_length(start, goal, RADIUS) == pytest.approx(ompl_length(start, goal), abs=OMPL_LENGTH)


def test_degenerate_pairs_are_no_longer_than_in_ompl(ompl_length: Callable[[np.ndarray, np.ndarray], float]) -> None:
    # Not equal: OMPL may refuse a word whose last arc is -1e-13 rad by rounding, and then its path is too long.
    for start, goal, _ in degenerate_pairs(1000, seed=1):
        assert path_length(start, goal, RADIUS) <= ompl_length(start, goal) + OMPL_LENGTH


@pytest.mark.parametrize("word", GOLDEN)
def test_each_word_has_its_golden_length(word: str) -> None:
    goal, length = GOLDEN[word]
    assert path_length((0, 0, 0), goal, 1.0) == pytest.approx(length, abs=GOLDEN_LENGTH)


@pytest.mark.parametrize(
    ("goal", "length"),
    [
        ((0.0, 0.0, 0.0), 0.0),
        ((7.0, 0.0, 0.0), 7.0),
        ((-7.0, 0.0, 0.0), 7.0),
        ((0.0, 0.0, math.pi), math.pi * RADIUS),  # three arcs of 60 degrees
        ((0.0, 0.0, -math.pi), math.pi * RADIUS),
        ((0.0, 0.0, 2 * math.pi), 0.0),
        ((RADIUS * math.sin(1.2), RADIUS * (1 - math.cos(1.2)), 1.2), 1.2 * RADIUS),  # on the left circle
        ((RADIUS * math.sin(1.2), -RADIUS * (1 - math.cos(1.2)), -1.2), 1.2 * RADIUS),  # on the right circle
        ((-RADIUS * math.sin(1.2), RADIUS * (1 - math.cos(1.2)), -1.2), 1.2 * RADIUS),  # left, in reverse
        ((RADIUS, RADIUS + 3.0, math.pi / 2), math.pi / 2 * RADIUS + 3.0),  # a left quarter, then straight on
    ],
)
def test_special_goals_have_their_closed_form(goal: tuple[float, float, float], length: float) -> None:
    at_origin = path_length((0, 0, 0), goal, RADIUS)
    c, s = math.cos(0.7), math.sin(0.7)
    moved = (3 + c * goal[0] - s * goal[1], -2 + s * goal[0] + c * goal[1], 0.7 + goal[2])
    assert at_origin == pytest.approx(length, abs=SAME_LENGTH)
    assert path_length((3, -2, 0.7), moved, RADIUS) == pytest.approx(length, abs=SAME_LENGTH)


def test_the_shortest_path_ends_at_the_goal_and_has_the_length_stated() -> None:
    for start, goal in zip(*random_pairs(1000, seed=2), strict=True):
        path = all_paths(start, goal, RADIUS)[0]
        assert distance_between(end_of(start, path), goal) < ENDS_AT_GOAL
        assert length_of(path) == pytest.approx(path_length(start, goal, RADIUS), abs=SAME_LENGTH)


def test_all_paths_end_at_the_goal_and_are_sorted() -> None:
    for start, goal in zip(*random_pairs(300, seed=3), strict=True):
        paths = all_paths(start, goal, RADIUS)
        lengths = [length_of(path) for path in paths]
        assert max(distance_between(end_of(start, path), goal) for path in paths) < ENDS_AT_GOAL
        assert np.all(np.diff(lengths) > -SAME_LENGTH)
        assert lengths[0] == pytest.approx(path_length(start, goal, RADIUS), abs=SAME_LENGTH)


def test_all_paths_end_at_the_goal_where_segments_vanish() -> None:
    for start, goal, driven in degenerate_pairs(1000, seed=4):
        paths = all_paths(start, goal, RADIUS)
        assert max(distance_between(end_of(start, path), goal) for path in paths) < ENDS_AT_GOAL
        assert length_of(paths[0]) <= driven + SAME_LENGTH


def test_quarter_turns_keep_their_gear_where_the_straight_between_them_vanishes() -> None:
    goal = (0.0, -2.0, math.pi)  # radius 1: its right circle touches the start's left one, rho = 2
    ends = [end_of((0, 0, 0), path) for path in all_paths((0, 0, 0), goal, 1.0)]
    assert max(distance_between(end, np.array(goal)) for end in ends) < ENDS_AT_GOAL


def test_no_move_is_empty() -> None:
    assert all_paths((1, 2, 3), (1, 2, 3), RADIUS)[0] == []
    assert all_paths((0, 0, 0), (4, 0, 0), RADIUS)[0] == [Move(0.0, 4.0)]
    for start, goal, _ in degenerate_pairs(300, seed=5):
        for path in all_paths(start, goal, RADIUS):
            assert all(abs(move.length) > 1e-12 * RADIUS for move in path)


def test_samples_lie_on_the_path_no_further_apart_than_the_step() -> None:
    step = 0.7
    for start, goal in zip(*random_pairs(200, seed=6), strict=True):
        path = all_paths(start, goal, RADIUS)[0]
        sampled = poses_along(start, path, step)
        poses, gears = sampled.poses, sampled.gears
        corners = np.cumsum([0.0] + [abs(move.length) for move in path])
        along = np.concatenate(
            [[0.0]]
            + [np.linspace(a, b, math.ceil((b - a) / step) + 1)[1:] for a, b in zip(corners, corners[1:], strict=False)]
        )
        assert poses.shape == (len(along), 3) and gears.shape == (len(along),)
        assert np.all(np.diff(along) > 0) and np.all(np.diff(along) <= step + SAME_LENGTH)
        for pose, distance in zip(poses, along, strict=True):
            assert distance_between(pose, end_of(start, path, distance)) < ON_PATH
        assert distance_between(poses[0], start) == 0.0
        assert distance_between(poses[-1], goal) < ENDS_AT_GOAL


def test_sample_gears_are_the_direction_of_motion() -> None:
    for start, goal in zip(*random_pairs(200, seed=7), strict=True):
        sampled = poses_along(start, all_paths(start, goal, RADIUS)[0], 0.5)
        poses, gears = sampled.poses, sampled.gears
        heading = 0.5 * (poses[1:, 2] + poses[:-1, 2])  # theta is continuous, so the mean is the chord's direction
        ahead = np.diff(poses[:, 0]) * np.cos(heading) + np.diff(poses[:, 1]) * np.sin(heading)
        assert np.array_equal(gears[1:], np.sign(ahead))
        assert gears[0] == gears[1]


def test_a_path_without_moves_stays_at_its_start() -> None:
    sampled = poses_along(np.array([1.0, 2.0, 3.0]), [], 0.5)
    assert sampled.poses.tolist() == [[1.0, 2.0, 3.0]] * 2 and sampled.gears.tolist() == [1, 1]


def test_a_move_of_whole_steps_is_not_divided_further() -> None:
    sampled = poses_along(np.zeros(3), [Move(0.0, 2.0), Move(0.0, -1.0)], 0.5)
    assert sampled.poses[:, 0].tolist() == [0.0, 0.5, 1.0, 1.5, 2.0, 1.5, 1.0]
    assert sampled.gears.tolist() == [1, 1, 1, 1, 1, -1, -1]


def test_length_is_the_same_from_goal_to_start() -> None:
    for start, goal in zip(*random_pairs(500, seed=8), strict=True):
        there = path_length(start, goal, RADIUS)
        assert path_length(goal, start, RADIUS) == pytest.approx(there, abs=SAME_LENGTH)


def test_length_is_invariant_to_rigid_motions_and_whole_turns() -> None:
    rng = np.random.default_rng(9)
    for start, goal in zip(*random_pairs(500, seed=9), strict=True):
        turn, shift = rng.uniform(-np.pi, np.pi), rng.uniform(-20, 20, 2)
        rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        moved_start, moved_goal = (np.r_[rotation @ pose[:2] + shift, pose[2] + turn] for pose in (start, goal))
        moved_goal[2] += 2 * np.pi
        length = path_length(start, goal, RADIUS)
        assert path_length(moved_start, moved_goal, RADIUS) == pytest.approx(length, abs=SAME_LENGTH)


def test_length_scales_with_the_radius() -> None:
    scale = np.array([2.5, 2.5, 1.0])
    for start, goal in zip(*random_pairs(300, seed=10), strict=True):
        length = path_length(start, goal, RADIUS)
        assert path_length(scale * start, scale * goal, 2.5 * RADIUS) == pytest.approx(2.5 * length, abs=SAME_LENGTH)


@pytest.mark.parametrize("length", [path_length, all_paths])
def test_bad_arguments_are_named(length: Callable[..., object]) -> None:
    start = np.zeros(3)
    with pytest.raises(ValueError, match="turning_radius"):
        length(start, (1, 0, 0), 0.0)
    with pytest.raises(ValueError, match="finite"):
        length(start, (math.nan, 0, 0), RADIUS)
    with pytest.raises(ValueError, match="finite"):
        length(start + math.inf, (0, 0, 0), RADIUS)
