"""The command `verify`: anyone's trajectory, a table of findings, a picture with the first fault."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from drake_gnnocp import Scenario, Trajectory, verify_command
from drake_gnnocp.vehicle import Input, State
from drake_gnnocp.verify_command import main

WORLD = np.array([5e5, -4e6])  # m, far from the origin


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    """A task with a wall 1 m beside the lane, and a drive of 6.1 m that solves it, with knots of two spacings."""
    t = np.concatenate([np.linspace(0.0, 4.0, 9), np.linspace(4.125, 8.0, 32)])
    a = 0.6 * np.sin(2 * np.pi * t / 8.0)
    v = np.append(0.0, np.cumsum(np.diff(t) * (a[1:] + a[:-1]) / 2))
    a[-2] -= 2 * v[-1] / (t[-1] - t[-3])  # at rest at the end
    v = np.append(0.0, np.cumsum(np.diff(t) * (a[1:] + a[:-1]) / 2))
    h, a0, a1 = np.diff(t), a[:-1], a[1:]
    x = np.append(0.0, np.cumsum(h * v[:-1] + h**2 * (a0 / 3 + a1 / 6)))
    states, inputs = np.zeros((len(t), 5)), np.zeros((len(t), 2))
    states[:, :2], states[:, State.V], inputs[:, Input.A] = WORLD + np.stack([x, 0 * x], axis=1), v, a
    wall = WORLD + np.array([[5.0, 1.95], [12.0, 1.95], [12.0, 3.0], [5.0, 3.0]])
    task = Scenario(
        "lane", states[0, :3], states[-1, :3], (wall,), bounds=(*(WORLD[0] + [-5, 20]), *(WORLD[1] + [-5, 5]))
    )
    task.save(tmp_path / "lane.json")
    Trajectory(t, states, inputs).save_csv(tmp_path / "mine.csv")
    return tmp_path / "lane.json", tmp_path / "mine.csv"


def test_a_clean_drive_is_verified_and_said_to_be(files: tuple[Path, Path], capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(path) for path in files]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["checked", "allowed", "found", "where", "when", "ok"]
    assert all(line.endswith("yes") for line in lines[1:-1]) and len(lines) > 10
    assert lines[-1].startswith("lane: verified, clearance 1.00 m at (5000")


def test_a_fault_is_in_the_table_the_data_and_the_picture(
    files: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    task = Scenario.load(files[0])
    post = task.start[:2] + np.array([[4.3, -0.1], [4.5, -0.1], [4.5, 0.1], [4.3, 0.1]])
    Scenario(task.name, task.start, task.goal, (*task.obstacles, post), task.bounds).save(files[0])
    assert main([*(str(path) for path in files), "--out", str(tmp_path / "out")]) == 3
    output = capsys.readouterr().out
    assert "lane: not verified: collides with an obstacle\n" in output
    assert [line.split()[0] for line in output.splitlines() if line.endswith("NO")] == ["distance"]
    data = json.loads((tmp_path / "out" / "verification.json").read_text())
    (fault,) = data["verification"]["faults"]
    assert not data["verified"] and len(data["findings"]) > 10
    assert [fault["x"], fault["y"]] == pytest.approx(WORLD + [4.3, 0.0], abs=0.15)
    with Image.open(tmp_path / "out" / "verification.png") as picture:
        red = np.asarray(picture.convert("RGB")).astype(int) - [0xC0, 0x00, 0x00]
    assert (np.abs(red).max(axis=2) < 8).sum() > 50  # the ring and the cross


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "No such file"),
        ("t,x\n", "header"),
        ("t,x,y,theta,v,phi,a,w\n0,0,0,0,0,0,0,0\n1,nan,0,0,0,0,0,0\n", "x of knot 1: must be finite"),
        ("t,x,y,theta,v,phi,a,w\n0,0,0,0,0,0,0,0\n0,0,0,0,0,0,0,0\n", "t of knot 1: must be larger"),
    ],
)
def test_bad_input_is_one_line(
    files: tuple[Path, Path], content: str | None, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    files[1].unlink()
    if content is not None:
        files[1].write_text(content)
    assert main([str(path) for path in files]) == 2
    captured = capsys.readouterr()
    assert (
        captured.out == "" and captured.err.count("\n") == 1 and "mine.csv" in captured.err and message in captured.err
    )


def test_the_picture_shows_what_is_driven_beside_what_the_table_says(
    files: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[Trajectory | None] = []
    monkeypatch.setattr(verify_command, "save_plan_picture", lambda *given, labels: shown.extend(given[2:4]))
    table = Trajectory.load_csv(files[1])
    table.states[5:, State.Y] += 3.0  # the car does not drive there: its inputs say straight ahead
    table.save_csv(files[1])
    assert main([*(str(path) for path in files), "--out", str(tmp_path)]) == 0
    driven, said = shown
    assert driven is not None and said is not None
    np.testing.assert_array_equal(said.poses, table.poses)
    np.testing.assert_allclose(driven.column(State.Y), WORLD[1], atol=1e-9)
    assert len(driven) > 10 * len(said) and driven.poses[-1, 0] == pytest.approx(table.poses[-1, 0], abs=1e-6)
    table.inputs[3] = 1e11
    table.save_csv(files[1])
    assert main([*(str(path) for path in files), "--out", str(tmp_path)]) == 3
    assert shown[2] is None and shown[3] is not None  # nothing is driven


def test_what_cannot_be_driven_is_not_verified(files: tuple[Path, Path], capsys: pytest.CaptureFixture[str]) -> None:
    wild = Trajectory.load_csv(files[1])
    wild.inputs[3] = 1e11
    wild.save_csv(files[1])
    assert main([str(path) for path in files]) == 3
    assert "too large" in capsys.readouterr().out
