"""What others read of a plan: tables for a reference point, ROS 2 messages, films."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from drake_gnnocp import Plan, Scenario, Trajectory, Vehicle, command_line, plan, verify
from drake_gnnocp.command_line import main
from drake_gnnocp.exports import Exports, save_json, save_mcap
from drake_gnnocp.exports.ros import BEGIN
from drake_gnnocp.pictures import animation
from drake_gnnocp.pictures.animation import LONGEST, PAUSE, _outlines, save_gif, save_mp4
from drake_gnnocp.verify_command import main as verify_main

BAD_INPUT, NOT_VERIFIED, NOT_WRITTEN = 2, 3, 4  # exit codes
CENTRE = 1.4155  # m, of the paper's car ahead of its rear axle: half of 2.8 + 0.96 - 0.929
LARGEST_GIF = 2e6  # bytes


@pytest.fixture(scope="module")
def made(gate: Scenario) -> Plan:
    """A plan through a gate, with bounds."""
    result = plan(gate)
    assert result.verified
    return result


@pytest.fixture(scope="module")
def short() -> Plan:
    """A plan of a few seconds."""
    result = plan(Scenario("short", np.zeros(3), np.array([3.0, 0.0, 0.0])))
    assert the_trajectory(result).duration < LONGEST
    return result


@pytest.fixture
def with_plan(made: Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    """The command plans nothing and writes this plan."""
    monkeypatch.setattr(command_line, "plan", lambda *_: made)


def the_trajectory(result: Plan) -> Trajectory:
    """The trajectory of a plan, which has one."""
    assert result.trajectory is not None
    return result.trajectory


@pytest.mark.usefixtures("with_plan")
def test_rows_at_a_rate_are_written_with_the_verification_of_them(made: Plan, tmp_path: Path) -> None:
    assert main(["--rate", "20", "--no-pictures", "--out", str(tmp_path)]) == 0
    rows = Trajectory.load_csv(tmp_path / "trajectory.csv")
    np.testing.assert_array_equal(rows.t, np.arange(len(rows)) / 20)
    result = json.loads((tmp_path / "result.json").read_text())
    found = verify(made.scenario, rows)
    assert result["status"] == "verified" and result["t_final"] == rows.t[-1]
    assert result["verification"]["min_clearance_m"] == pytest.approx(found.min_clearance_m, abs=1e-12)
    assert verify_main([str(tmp_path / "scenario.json"), str(tmp_path / "trajectory.csv")]) == 0


@pytest.mark.usefixtures("with_plan")
def test_a_rate_that_cannot_be_verified_leaves_the_plan_as_it_is(
    made: Plan, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--rate", "0.3", "--no-pictures", "--out", str(tmp_path)]) == NOT_VERIFIED
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("--rate: rows at 0.3 Hz are not verified (")
    np.testing.assert_array_equal(Trajectory.load_csv(tmp_path / "trajectory.csv").states, the_trajectory(made).states)
    assert json.loads((tmp_path / "result.json").read_text())["status"] == "verified"


@pytest.mark.usefixtures("with_plan")
def test_a_table_of_the_centre_says_so_and_is_not_mistaken_for_the_rear_axle(
    made: Plan, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--reference", "centre", "--no-pictures", "--out", str(tmp_path)]) == 0
    header, *lines = (tmp_path / "trajectory.csv").read_text().splitlines()
    assert header == "t,x_centre,y_centre,theta,v,phi,a,w"
    rows = np.array([line.split(",") for line in lines], dtype=float)
    corners = made.scenario.vehicle.footprints(the_trajectory(made).poses)
    np.testing.assert_allclose(rows[:, 1:3], corners.mean(axis=1), atol=1e-12)
    assert Trajectory.load_csv(tmp_path / "guess.csv")
    capsys.readouterr()
    assert verify_main([str(tmp_path / "scenario.json"), str(tmp_path / "trajectory.csv")]) == BAD_INPUT
    assert "header: must be t,x,y,theta,v,phi,a,w, not t,x_centre" in capsys.readouterr().err


@pytest.mark.parametrize(("reference", "ahead"), [("rear_axle", 0.0), ("centre", CENTRE)])
def test_json_says_what_its_numbers_mean(made: Plan, reference: str, ahead: float, tmp_path: Path) -> None:
    rows = the_trajectory(made.resampled(25.0))
    save_json(tmp_path / "trajectory.json", made.scenario, rows, "verified", reference)
    data = json.loads((tmp_path / "trajectory.json").read_text())
    assert (data["status"], data["reference_point"], data["rate_hz"]) == ("verified", reference, 25.0)
    assert data["reference_ahead_of_rear_axle_m"] == pytest.approx(ahead)
    assert data["vehicle"] == made.scenario.vehicle.to_dict()
    columns = dict(zip([column["name"] for column in data["columns"]], zip(*data["rows"], strict=True), strict=True))
    assert [column["unit"] for column in data["columns"]] == ["s", "m", "m", "rad", "m/s", "rad", "m/s^2", "rad/s"]
    x = columns["x_centre" if ahead else "x"]
    np.testing.assert_allclose(x, rows.states[:, 0] + ahead * np.cos(rows.states[:, 2]), atol=1e-12)
    np.testing.assert_array_equal(columns["w"], rows.inputs[:, 1])


@pytest.mark.usefixtures("with_plan")
def test_only_the_formats_that_are_named_are_written(tmp_path: Path) -> None:
    assert main(["--format", "json,mcap", "--no-pictures", "--out", str(tmp_path)]) == 0
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"scenario.json", "guess.csv", "result.json", "trajectory.json", "plan.mcap"}
    assert main(["--no-pictures", "--out", str(tmp_path)]) == 0  # and the next plan takes away what is not its own
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"scenario.json", "guess.csv", "result.json", "trajectory.csv"}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--rate", "0"], "--rate: must be above 0 and at most 1000 Hz, not '0'"),
        (["--rate", "nan"], "--rate: must be above 0 and at most 1000 Hz, not 'nan'"),
        (["--format", "csv,xml"], "--format: must be of csv, json, mcap, not 'xml'"),
        (["--reference", "front"], "--reference: invalid choice: 'front'"),
    ],
)
def test_bad_options_are_one_line(options: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(["empty_field", *options])
    assert stopped.value.code == BAD_INPUT
    (line,) = capsys.readouterr().err.splitlines()
    assert message in line


def test_what_is_not_installed_is_named_before_planning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(command_line, "plan", None)
    monkeypatch.setattr("drake_gnnocp.exports.ros.find_spec", lambda _: None)
    monkeypatch.setenv("PATH", "")
    out = str(tmp_path / "out")
    assert main(["empty_field", "--format", "mcap", "--out", out]) == BAD_INPUT
    expected = "--format: mcap needs rosbags, which is not installed: pip install -e .[ros]\n"
    assert capsys.readouterr().err == expected
    assert main(["empty_field", "--mp4", "--out", out]) == BAD_INPUT
    assert capsys.readouterr().err == "--mp4: needs ffmpeg on the PATH; --gif needs nothing\n"
    assert not Path(out).exists()


def test_no_library_of_an_extra_is_loaded_without_need() -> None:
    code = "import sys, drake_gnnocp.command_line; print(*({'rosbags', 'distributed'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


def messages_of(path: Path) -> list[tuple[str, int, Any]]:
    """Topic, time [ns] and message of all messages in a file, read with the types that are written in it."""
    from rosbags.rosbag2 import Reader
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.EMPTY)
    with Reader(path) as reader:
        for topic in reader.connections:
            store.register(get_types_from_msg(topic.msgdef.data, topic.msgtype))
        return [(c.topic, time, store.deserialize_cdr(data, c.msgtype)) for c, time, data in reader.messages()]


def heading(rotation: Any) -> float:
    """The heading of a quaternion that turns about z [rad]."""
    assert rotation.x == rotation.y == 0
    return 2 * math.atan2(rotation.z, rotation.w)


def test_ros_messages_say_what_the_plan_does(made: Plan, tmp_path: Path) -> None:
    rows = the_trajectory(made.resampled(10.0))
    save_mcap(tmp_path / "plan.mcap", made.scenario, rows)
    assert [path.name for path in tmp_path.iterdir()] == ["plan.mcap"]
    messages = messages_of(tmp_path / "plan.mcap")
    n = len(rows)
    assert Counter(topic for topic, _, _ in messages) == {
        "/plan": 1, "/scene": 1, "/start": 1, "/goal": 1, "/tf": n, "/cmd": n,
    }  # fmt: skip
    kinds = {topic: message.__msgtype__ for topic, _, message in messages}
    assert kinds["/plan"] == "nav_msgs/msg/Path" and kinds["/tf"] == "tf2_msgs/msg/TFMessage"
    times = np.array([time for topic, time, _ in messages if topic == "/tf"])
    np.testing.assert_allclose(times / 1e9 - BEGIN, rows.t, atol=1e-9)
    for (_, time, message), state in zip((m for m in messages if m[0] == "/tf"), rows.states, strict=True):
        (transform,) = message.transforms
        stamp, moved = transform.header.stamp, transform.transform
        assert stamp.sec * 10**9 + stamp.nanosec == time
        assert (transform.header.frame_id, transform.child_frame_id) == ("map", "base_link")
        found = (moved.translation.x, moved.translation.y, heading(moved.rotation))
        np.testing.assert_allclose(found, state[:3], atol=1e-12)
    (path,) = (message for topic, _, message in messages if topic == "/plan")
    np.testing.assert_array_equal([[p.pose.position.x, p.pose.position.y] for p in path.poses], rows.poses[:, :2])
    assert [p.header.stamp.nanosec for p in path.poses[:3]] == [0, 100_000_000, 200_000_000]
    v, phi = rows.states[n // 2, 3:]
    (command,) = [message for topic, _, message in messages if topic == "/cmd"][n // 2 : n // 2 + 1]
    assert command.twist.linear.x == v
    assert command.twist.angular.z == pytest.approx(v * math.tan(phi) / 2.8)


def test_markers_show_obstacles_and_a_car_that_goes_with_its_frame(made: Plan, tmp_path: Path) -> None:
    save_mcap(tmp_path / "plan.mcap", made.scenario, the_trajectory(made))
    (scene,) = (message for topic, _, message in messages_of(tmp_path / "plan.mcap") if topic == "/scene")
    markers = {(marker.ns, marker.id): marker for marker in scene.markers}
    assert {name for name, _ in markers} == {"obstacles", "bounds", "start", "goal", "footprints", "car"}
    corners = np.array([[p.x, p.y] for p in markers["obstacles", 0].points])
    assert len(corners) % 3 == 0  # a list of triangles
    rings = np.concatenate([ring for ring in made.scenario.obstacles if isinstance(ring, np.ndarray)])
    np.testing.assert_array_equal(np.unique(corners, axis=0), np.unique(rings, axis=0))
    car = markers["car", 0]
    assert (car.header.frame_id, car.frame_locked) == ("base_link", True)
    assert car.pose.position.x == pytest.approx(CENTRE)
    assert (car.scale.x, car.scale.y) == (pytest.approx(4.689), 1.9)


def test_markers_show_bounds_that_are_a_ring(made: Plan, tmp_path: Path) -> None:
    ring = np.array([[-9.0, -9.0], [30.0, -9.0], [25.0, 12.0], [-9.0, 12.0]])
    save_mcap(tmp_path / "plan.mcap", replace(made.scenario, bounds=ring), the_trajectory(made))
    (scene,) = (message for topic, _, message in messages_of(tmp_path / "plan.mcap") if topic == "/scene")
    (bounds,) = (marker for marker in scene.markers if marker.ns == "bounds")
    assert {(p.x, p.y) for p in bounds.points} == {(x, y) for x, y in ring.tolist()}


def test_the_same_plan_gives_the_same_messages(made: Plan, tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        save_mcap(tmp_path / name / "plan.mcap", made.scenario, the_trajectory(made))
    assert (tmp_path / "a/plan.mcap").read_bytes() == (tmp_path / "b/plan.mcap").read_bytes()


def test_a_gif_is_small_repeats_and_shows_the_car_from_start_to_goal(made: Plan, tmp_path: Path) -> None:
    save_gif(tmp_path / "plan.gif", made.scenario, the_trajectory(made))
    assert (tmp_path / "plan.gif").stat().st_size < LARGEST_GIF
    with Image.open(tmp_path / "plan.gif") as film:
        assert film.info["loop"] == 0  # for ever
        shown, cars = 0.0, []
        for frame in range(film.n_frames):  # type: ignore[attr-defined]
            film.seek(frame)
            shown += film.info["duration"] / 1000
            red, _, blue = np.asarray(film.convert("RGB"), dtype=int).transpose(2, 0, 1)
            body = (blue > 140) & (red < 60)  # pixels of the car, and few of the line
            cars.append(np.argwhere(body)[:, 1].mean())
    seconds = min(the_trajectory(made).duration, LONGEST)
    assert shown == pytest.approx(seconds + PAUSE, abs=0.1) and shown < 10.1
    assert cars[-1] - cars[0] > 100  # pixels to the right


def test_a_film_begins_at_the_start_and_ends_at_the_goal(
    made: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    poses: list[np.ndarray] = []

    def seen(vehicle: Vehicle, pose: np.ndarray, phi: float) -> list[np.ndarray]:
        poses.append(pose)
        return _outlines(vehicle, pose, phi)

    monkeypatch.setattr(animation, "_outlines", seen)
    save_gif(tmp_path / "plan.gif", made.scenario, the_trajectory(made))
    np.testing.assert_array_equal(poses[0], made.scenario.start)
    np.testing.assert_allclose(poses[-1], made.scenario.goal, atol=0.01)
    with Image.open(tmp_path / "plan.gif") as film:
        assert film.n_frames == len(poses)  # type: ignore[attr-defined]


def test_a_short_plan_is_shown_as_fast_as_it_is(short: Plan, tmp_path: Path) -> None:
    trajectory = the_trajectory(short)
    save_gif(tmp_path / "plan.gif", short.scenario, trajectory)
    with Image.open(tmp_path / "plan.gif") as film:
        n = film.n_frames  # type: ignore[attr-defined]
    assert n == math.ceil(trajectory.duration * 12.5) + 1


def test_a_car_in_a_film_is_drawn_at_its_scale() -> None:
    pose = np.array([1.0, 2.0, 0.5])
    full, small = (_outlines(Vehicle().scaled(scale), pose * (scale, scale, 1.0), 0.3) for scale in (1.0, 0.1))
    for one, other in zip(full, small, strict=True):
        np.testing.assert_allclose(other, 0.1 * one, rtol=1e-9)


@pytest.fixture
def ffmpeg(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A program of that name that writes what it was given, its arguments and how many bytes of pictures."""
    folder = tmp_path / "bin"
    folder.mkdir()
    program = folder / "ffmpeg"
    program.write_text(
        f"#!{sys.executable}\nimport sys\nfrom pathlib import Path\n"
        "pixels = len(sys.stdin.buffer.read())\nPath(sys.argv[-1]).write_text(f'{pixels} ' + ' '.join(sys.argv))\n"
    )
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH']}")
    return program


def test_ffmpeg_gets_pictures_of_the_size_it_is_told(short: Plan, ffmpeg: Path, tmp_path: Path) -> None:
    save_mp4(tmp_path / "plan.mp4", short.scenario, the_trajectory(short))
    pixels, *arguments = (tmp_path / "plan.mp4").read_text().split()
    width, height = map(int, arguments[arguments.index("-s") + 1].split("x"))
    assert width % 2 == height % 2 == 0 and int(pixels) % (3 * width * height) == 0
    frames = int(pixels) // (3 * width * height)
    seconds = min(the_trajectory(short).duration, LONGEST) + PAUSE
    assert frames == pytest.approx(seconds * 25, abs=2)


def test_a_film_that_fails_is_one_line_and_leaves_nothing(
    short: Plan, ffmpeg: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(command_line, "plan", lambda *_: short)
    ffmpeg.write_text("#!/bin/sh\ncat >/dev/null\necho cannot code >&2\nexit 1\n")
    out = tmp_path / "out"
    assert main(["--mp4", "--no-pictures", "--out", str(out)]) == NOT_WRITTEN
    assert capsys.readouterr().err == f"--out: {out}: ffmpeg: cannot code\n"
    assert list(out.iterdir()) == []


def test_a_plan_that_is_not_verified_keeps_its_knots(made: Plan) -> None:
    spoiled = made.resampled(0.3)
    assert spoiled.status == "unverified"
    same, note = Exports(20.0).resampled(spoiled)
    assert same is spoiled and note.startswith("--rate: the plan is not verified")


def test_nothing_of_the_choice_is_made_where_there_is_no_trajectory(gate: Scenario, tmp_path: Path) -> None:
    closed = (*gate.obstacles, np.array([[6.0, -1.0], [8.0, -1.0], [8.0, 4.0], [6.0, 4.0]]))
    result = plan(Scenario("closed", gate.start, gate.goal, closed, gate.bounds))
    assert result.status == "no_path"
    result.save(tmp_path)
    exports = Exports(20.0, "centre", ("json", "mcap"), gif=True)
    same, note = exports.resampled(result)
    exports.save(same, tmp_path)
    assert same is result and note == ""
    assert {path.name for path in tmp_path.iterdir()} == {"scenario.json", "result.json"}
