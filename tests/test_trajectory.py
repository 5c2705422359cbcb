"""Trajectories: shapes, resampling, moving, and CSV files that keep every digit."""

from pathlib import Path

import numpy as np
import pytest

from drake_gnnocp.files import write_atomically
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import Input, State

EXACT = 1e-12  # a few float operations on numbers of order one
HEADER = "t,x,y,theta,v,phi,a,w"


def trajectory(n: int = 5, seed: int = 0) -> Trajectory:
    rng = np.random.default_rng(seed)
    return Trajectory(np.cumsum(rng.uniform(0.1, 1, n)), rng.normal(size=(n, 5)), rng.normal(size=(n, 2)))


def test_columns_are_found_by_name() -> None:
    given = trajectory()
    np.testing.assert_array_equal(given.column(State.V), given.states[:, 3])
    np.testing.assert_array_equal(given.column(Input.W), given.inputs[:, 1])
    np.testing.assert_array_equal(given.poses, given.states[:, :3])
    assert len(given) == 5
    assert given.duration == given.t[4] - given.t[0]


@pytest.mark.parametrize(
    ("t", "states", "inputs"),
    [
        ((4,), (5, 5), (5, 2)),
        ((5,), (5, 4), (5, 2)),
        ((5,), (5, 5), (5, 3)),
        ((1,), (1, 5), (1, 2)),
        ((5, 1), (5, 5), (5, 2)),
    ],
)
def test_arrays_that_do_not_belong_together_are_refused(
    t: tuple[int, ...], states: tuple[int, ...], inputs: tuple[int, ...]
) -> None:
    with pytest.raises(ValueError, match="trajectory: t, states, inputs must be"):
        Trajectory(np.zeros(t), np.zeros(states), np.zeros(inputs))


def test_resampling_is_linear_in_time_and_keeps_both_ends() -> None:
    given = trajectory()
    finer = given.resampled(41)
    np.testing.assert_allclose(np.diff(finer.t), given.duration / 40, rtol=EXACT)
    for column in [*State, *Input]:
        expected = np.interp(finer.t, given.t, given.column(column))
        np.testing.assert_allclose(finer.column(column), expected, rtol=EXACT)
    np.testing.assert_array_equal(finer.states[[0, -1]], given.states[[0, -1]])


@pytest.mark.parametrize(
    ("v", "expected"),
    [
        ([0, 1, 1, 0], 0),
        ([0, -1, -1, 0], 0),
        ([0, 1, 0, -1, 0, 1, 0], 2),
        ([0, 1, 0, 1e-4, -1e-4, 0, 1, 0], 0),  # it trembles where it stops
        ([0, 1, 0, -1e-4, 1e-4, 0, -1, 0], 1),
        ([0, 0, 0], 0),
    ],
)
def test_changes_of_gear_are_counted_where_the_car_really_moves(v: list[float], expected: int) -> None:
    states = np.zeros((len(v), 5))
    states[:, State.V] = v
    for size in (0.05, 1.0):
        assert Trajectory(np.arange(len(v)), size * states, np.zeros((len(v), 2))).gear_changes == expected


def test_translating_moves_x_and_y_only() -> None:
    given = trajectory()
    moved = given.translated(3.0, -4.0)
    np.testing.assert_allclose(moved.states - given.states, np.tile([3.0, -4.0, 0, 0, 0], (5, 1)), atol=EXACT)
    np.testing.assert_array_equal(moved.inputs, given.inputs)
    np.testing.assert_array_equal(given.states, trajectory().states)  # the given one is untouched


def test_a_csv_file_keeps_every_digit(tmp_path: Path) -> None:
    given = trajectory(20)
    given.states[3, State.X] = 1e9 + 1 / 3
    given.inputs[4, Input.A] = 5e-324
    given.save_csv(tmp_path / "a.csv")
    read = Trajectory.load_csv(tmp_path / "a.csv")
    for ours, theirs in [(read.t, given.t), (read.states, given.states), (read.inputs, given.inputs)]:
        np.testing.assert_array_equal(ours, theirs)
    lines = (tmp_path / "a.csv").read_text().splitlines()
    assert lines[0] == HEADER
    assert len(lines) == 21


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "file: is empty"),
        ("t,x,y\n1,2,3\n", "header: must be t,x,y,theta,v,phi,a,w, not t,x,y"),
        (f"{HEADER}\n", "needs at least 2 rows, has 0"),
        (f"{HEADER}\n0,0,0,0,0,0,0,0\n", "needs at least 2 rows, has 1"),
        (f"{HEADER}\n0,0,0,0,0,0,0,0\n1,2,3\n", "line 3: must be 8 numbers, not 1,2,3"),
        (f"{HEADER}\n0,0,0,0,0,0,0,0\n1,2,3,4,5,6,7,8,9\n", "line 3: must be 8 numbers"),
        (f"{HEADER}\n0,0,zero,0,0,0,0,0\n", "line 2: must be 8 numbers, not 0,0,zero"),
    ],
)
def test_a_csv_file_that_is_no_trajectory_is_named_with_the_fault(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(ValueError) as raised:
        Trajectory.load_csv(path)
    assert str(raised.value).startswith(f"{path}: {message}")


def test_writing_replaces_the_file_and_leaves_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old and longer")
    write_atomically(path, "new")
    assert path.read_text() == "new"
    assert list(tmp_path.iterdir()) == [path]


def test_a_failed_write_keeps_the_old_file_and_leaves_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")
    with pytest.raises(UnicodeEncodeError):
        write_atomically(path, "\ud800")
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
