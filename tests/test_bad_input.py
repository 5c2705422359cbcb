"""Bad input through the command line: exit code 2 and one line that names the file, the field and what is wrong."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from drake_gnnocp.command_line import main
from drake_gnnocp.guesses import learned as guess_module

BAD_INPUT = 2  # exit code
TRIANGLE = [[8, 8], [9, 8], [8, 9]]
SQUARE = [[20, 20], [24, 20], [24, 24], [20, 24]]
GOOD: dict[str, Any] = {"name": "task", "start": [0, 0, 0], "goal": [12, 0, 0], "obstacles": [TRIANGLE]}
BOX = [[-50, -50], [50, -50], [50, 50], [-50, 50]]
AT_GOAL = [[11, -5], [17, -5], [17, 5], [11, 5]]
PRISON = [[5, -9], [30, -9], [30, 9], [5, 9]]  # the car at the goal is wholly inside


def without(key: str) -> dict[str, Any]:
    return {name: value for name, value in GOOD.items() if name != key}


def obstacle(ring: Any) -> dict[str, Any]:
    return {**GOOD, "obstacles": [TRIANGLE, ring]}


def vehicle(**parameters: Any) -> dict[str, Any]:
    return {**GOOD, "vehicle": parameters}


# what the file holds (a dict is written as JSON), and how the message goes on after the file's name
JSON_FILES: list[tuple[Any, str]] = [
    *((without(key), f"{key}: missing") for key in GOOD),
    (
        {key: GOOD[key] for key in ("name", "obstacles")},
        "start and goal: missing; where the file has none, give --start",
    ),
    ({**GOOD, "obstacle": []}, "obstacle: unknown key; allowed are name, start, goal, obstacles, bounds, vehicle"),
    # numbers
    ({**GOOD, "start": [0, float("nan"), 0]}, "start[1]: must be finite and at most 1e+12, not nan"),
    ({**GOOD, "goal": [float("inf"), 0, 0]}, "goal[0]: must be finite and at most 1e+12, not inf"),
    ('{"name": "a", "start": [0, 0, 1e999], "goal": [9, 0, 0], "obstacles": []}', "start[2]: must be finite"),
    (json.dumps(GOOD).replace("12", "9" * 5000), "goal[0]: must be finite"),
    ({**GOOD, "goal": [1e17, 0, 0]}, "goal[0]: must be finite and at most 1e+12, not 1e+17"),
    ({**GOOD, "start": ["0", 0, 0]}, "start[0]: must be a number, not '0'"),
    ({**GOOD, "goal": [12, True, 0]}, "goal[1]: must be a number, not True"),
    ({**GOOD, "goal": [12, None, 0]}, "goal[1]: must be a number, not None"),
    # shapes
    ({**GOOD, "start": [0, 0]}, "start: must be 3 numbers [x, y, theta], not [0.0, 0.0]"),
    ({**GOOD, "goal": [12, 0, 0, 0]}, "goal: must be 3 numbers [x, y, theta], not [12.0, 0.0, 0.0, 0.0]"),
    ({**GOOD, "goal": {"x": 12}}, "goal: must be 3 numbers [x, y, theta], not {'x': 12.0}"),
    ({**GOOD, "start": None}, "start: must be 3 numbers [x, y, theta], not None"),
    ({**GOOD, "obstacles": None}, "obstacles: must be a list of polygons, not None"),
    ({**GOOD, "obstacles": {"a": TRIANGLE}}, "obstacles: must be a list of polygons, not {"),
    ({**GOOD, "obstacles": TRIANGLE}, "obstacles[0]: must be a list of at least 3 vertices [x, y], not [8.0, 8.0]"),
    (obstacle([[8, 8], [9, 9]]), "obstacles[1]: must be a list of at least 3 vertices [x, y], not [[8.0, 8.0], ["),
    (obstacle([[8, 8], [9, 9, 0], [9, 8]]), "obstacles[1][1]: must be 2 numbers [x, y], not [9.0, 9.0, 0.0]"),
    (obstacle([[8, 8], [9, "9"], [9, 8]]), "obstacles[1][1][1]: must be a number, not '9'"),
    (obstacle([[8, 8], 9, [9, 8]]), "obstacles[1][1]: must be 2 numbers [x, y], not 9.0"),
    ({**GOOD, "bounds": [-9, 30, -9]}, "bounds: must be 4 numbers [xmin, xmax, ymin, ymax], not [-9.0, 30.0, -9.0]"),
    ({**GOOD, "bounds": [30, -9, -9, 9]}, "bounds: must be [xmin, xmax, ymin, ymax] with min < max, not [30.0, -9.0"),
    ({**GOOD, "bounds": [-9, 30, 9, 9]}, "bounds: must be [xmin, xmax, ymin, ymax] with min < max"),
    ({**GOOD, "bounds": [-9, 30, -9, float("nan")]}, "bounds[3]: must be finite"),
    # polygons
    (obstacle([[20, 20], [24, 24], [24, 20], [20, 24]]), "obstacles[1]: crosses itself"),
    (obstacle([[2, 2], [2, -2], [2, 2]]), "start: the car collides with obstacles[1]"),
    (obstacle({"ring": [[20, 20], [24, 20], [24, 24]], "hole": []}), "obstacles[1].hole: unknown key; allowed"),
    (obstacle({"holes": []}), "obstacles[1].ring: missing"),
    (obstacle({"ring": [[20, 20], [24, 20], [24, 24]], "holes": [[[0, 0]]]}), "obstacles[1].holes[0]: must be a list"),
    (obstacle({"ring": SQUARE, "holes": [SQUARE]}), "obstacles[1]: its holes leave no area"),
    ({**GOOD, "lines": [[[20, 20]]]}, "lines[0]: must be a list of at least 2 vertices [x, y], not [[20.0"),
    ({**GOOD, "lines": [[[2, 3], [2, -3]]]}, "start: the car collides with lines[0]"),
    ({**GOOD, "points": [[20, 20], [3, 0]]}, "start: the car collides with points[1]"),
    ({**GOOD, "points": [[20, 20, -1]]}, "points[0]: must have a radius of 0 or more, not -1"),
    ({**GOOD, "points": [[20]]}, "points[0]: must be 3 numbers [x, y, r], not [20.0]"),
    ({**GOOD, "bounds": [[-9, -9], [30, -9], [30, 9], [-9, 8], [0, 0]]}, "start: the car leaves the bounds, or"),
    ({**GOOD, "bounds": [[-9, -9], [30, 9], [30, -9], [-9, 8]]}, "bounds: crosses itself"),
    (obstacle([[20, 20], [26, 20], [24, 20], [24, 24]]), "obstacles[1]: has no area, or runs back along one"),
    # poses
    (obstacle([[2, 0], [3, 0], [3, 5]]), "start: the car collides with obstacles[1]"),
    (obstacle(BOX), "start: the car collides with obstacles[1]"),
    (obstacle(AT_GOAL), "goal: the car collides with obstacles[1]"),
    (obstacle(PRISON), "goal: the car collides with obstacles[1]"),
    ({**GOOD, "bounds": [0, 30, -9, 9]}, "start: the car leaves the bounds [0.0, 30.0, -9.0, 9.0]"),
    ({**GOOD, "bounds": [-9, 15, -9, 9]}, "goal: the car leaves the bounds [-9.0, 15.0, -9.0, 9.0]"),
    # clearance
    ({**GOOD, "clearance": -0.1}, "clearance: must be 0 to 100 m, not -0.1"),
    ({**GOOD, "clearance": float("nan")}, "clearance: must be 0 to 100 m, not nan"),
    ({**GOOD, "clearance": [0.1]}, "clearance: must be a number in m, not [0.1]"),
    # goals
    ({**GOOD, "goals": [[9, 0, 0]]}, "goals: give either goal or goals, not both"),
    ({**without("goal"), "goals": []}, "goals: must be a list of at least one pose [x, y, theta], not []"),
    ({**without("goal"), "goals": [[9, 0, 0], [9, 0]]}, "goals[1]: must be 3 numbers [x, y, theta], not [9.0, 0.0]"),
    ({**without("goal"), "goals": [[9, None, 0]]}, "goals[0][1]: must be a number, not None"),
    (
        {**without("goal"), "goals": [[1, 0, 0], [8, 9, None]], "points": [[4, 0], [8, 9]]},
        "goals: the car can stand at none: goals[0]: the car collides with points[0]; goals[1]: the car collides or",
    ),
    ({**GOOD, "goal": [12, 0, None], "points": [[12, 0]]}, "goal: the car collides or leaves the bounds in all headin"),
    ({**GOOD, "start": [0, 0, None]}, "start[2]: must be a number, not None"),
    ({**GOOD, "goal_tolerance": 0.1}, "goal_tolerance: must be an object with x, y, heading, not 0.1"),
    ({**GOOD, "goal_tolerance": {"theta": 0.1}}, "goal_tolerance.theta: unknown key; allowed are x, y, heading"),
    ({**GOOD, "goal_tolerance": {"heading": 90}}, "goal_tolerance.heading: must be 0 to 3.14 rad, not 90"),
    ({**GOOD, "goal_tolerance": {"x": -1}}, "goal_tolerance.x: must be 0 to 100 m, not -1"),
    # vehicle
    (vehicle(hight=2), "vehicle.hight: unknown key; allowed are wheelbase, front_hang"),
    (vehicle(width=-1.9), "vehicle.width: must be between 0.001 and 10000, not -1.9"),
    (vehicle(front_hang=-0.1), "vehicle.front_hang: must be between 0 and 10000, not -0.1"),
    (vehicle(phi_max=2), "vehicle.phi_max: must be below pi/2, not 2"),
    (vehicle(v_max="fast"), "vehicle.v_max: must be a number, not 'fast'"),
    (vehicle(a_max=False), "vehicle.a_max: must be a number, not False"),
    (vehicle(width=1e300), "vehicle.width: must be between 0.001 and 10000, not 1e+300"),
    ({**GOOD, "vehicle": "van"}, "vehicle: must be an object, not 'van'"),
    # name
    ({**GOOD, "name": "a/b"}, "name: must have no slashes or unprintable characters, unlike 'a/b'"),
    ({**GOOD, "name": "..\\a"}, "name: must have no slashes"),
    ({**GOOD, "name": "a\nb"}, "name: must have no slashes or unprintable characters, unlike 'a\\nb'"),
    ({**GOOD, "name": "\ud800"}, "name: must have no slashes or unprintable characters"),
    ({**GOOD, "name": ""}, "name: must be a text that can name a folder, not ''"),
    ({**GOOD, "name": ".."}, "name: must be a text that can name a folder, not '..'"),
    ({**GOOD, "name": 7}, "name: must be a text that can name a folder, not 7"),
    ({**GOOD, "name": "ü" * 90}, "name: must be at most 100 bytes long, unlike 'üüü"),
    # not the JSON that is asked for
    ("start = 0, 0, 0", "line 1, column 1: is not JSON: Expecting value"),
    ('{\n "name": "a",\n}', "line 3, column 1: is not JSON: "),
    ("", "file: is empty"),
    ("\ufeff \n", "file: is empty"),
    (
        "[]",
        "scenario: must be an object with the keys name, start, goal, obstacles, bounds, vehicle, clearance, lines, "
        "points, goals, goal_tolerance, not []",
    ),
    ("3", "scenario: must be an object with the keys"),
    ('{"name": "a", "name": "b"}', "name: appears twice"),
    ('{"name": "a", "vehicle": {"width": 2, "width": 3}}', "width: appears twice"),
    ("[" * 100_000, "file: is nested too deeply"),
    ('{"start": ' * 100_000, "file: is nested too deeply"),
    (obstacle(json.loads("[" * 300 + "]" * 300)), "obstacles[1]: must be a list of at least 3 vertices"),
    (b"\x89PNG\r\n\x1a\n\x00\xff", "file: is not UTF-8 text"),
    (json.dumps(GOOD).encode("utf-16"), "file: is not UTF-8 text"),
]
CSV_FILES: list[tuple[str | bytes, str]] = [
    ("", "file: is empty"),
    (",,,\n,,", "number 1 of the row: must be a number, not ''"),
    ("x0,y0,th0\n0,0,0", "number 1 of the row: must be a number, not 'x0'"),
    ("0,0,0,12,0,0,zero", "number 7 of the row: must be a number, not 'zero'"),
    ("0,0,,12,0,0,0", "number 3 of the row: must be a number, not ''"),
    ("0;0;0;12;0;0;0", "number 1 of the row: must be a number, not '0;0;0;12;0;0;0'"),
    ("0,0,inf,12,0,0,0", "number 3 of the row: must be finite, not inf"),
    ("0,0,0,12,0,nan,0", "number 6 of the row: must be finite, not nan"),
    ("0,0,0,1e300,0,0,0", "goal[0]: must be finite and at most 1e+12, not 1e+300"),
    ("0,0,0,12,0", "start, goal, number of obstacles: needs 7 numbers, has 5"),
    ("0,0,0,12,0,0,-1", "number of obstacles: must be a whole number of at least 0, not -1"),
    ("0,0,0,12,0,0,1.5", "number of obstacles: must be a whole number of at least 0, not 1.5"),
    ("0,0,0,12,0,0,3,4,4", "vertex counts: there must be 3, there are 2"),
    ("0,0,0,12,0,0,1e30", "vertex counts: there must be 1e+30, there are 0"),
    ("0,0,0,12,0,0,1,2,8,8,9,9", "vertex count of obstacles[0]: must be a whole number of at least 3, not 2"),
    ("0,0,0,12,0,0,1,3.5,8,8,9,8,8,9", "vertex count of obstacles[0]: must be a whole number of at least 3, not 3.5"),
    ("0,0,0,12,0,0,1,3,8,8,9,8,8", "vertices: the counts ask for 6 numbers, there are 5"),
    ("0,0,0,12,0,0,1,3,8,8,9,8,8,9,9,9", "vertices: the counts ask for 6 numbers, there are 8"),
    ("0,0,0,12,0,0,0,8,8", "vertices: the counts ask for 0 numbers, there are 2"),
    ("0,0,0,12,0,0,1,4,20,20,24,24,24,20,20,24", "obstacles[0]: crosses itself"),
    ("0,0,0,12,0,0,1,3,2,0,3,0,3,5", "start: the car collides with obstacles[0]"),
    (b"\xff\xfe0,0", "file: is not UTF-8 text"),
]
OPTIONS: list[tuple[list[str], str]] = [
    (["--guess", "nonsense"], "--guess: invalid choice: 'nonsense'"),
    (["--horizon", "-3"], "--horizon: must be guess, free or 0 to 1000 seconds, not '-3'"),
    (["--horizon", "0"], "--horizon: must be guess, free or 0 to 1000 seconds, not '0'"),
    (["--horizon", "nan"], "--horizon: must be guess, free or 0 to 1000 seconds, not 'nan'"),
    (["--horizon", "inf"], "--horizon: must be guess, free or 0 to 1000 seconds, not 'inf'"),
    (["--horizon", "soon"], "--horizon: must be guess, free or 0 to 1000 seconds, not 'soon'"),
    (["--max-seconds", "0"], "--max-seconds: must be positive, not 0"),
    (["--max-seconds", "-1"], "--max-seconds: must be positive, not -1"),
    (["--max-seconds", "nan"], "--max-seconds: must be positive, not nan"),
    (["--max-seconds", "soon"], "--max-seconds: invalid float value: 'soon'"),
    (["--max-seconds"], "--max-seconds: expected one argument"),
    (["--speed", "3"], "unrecognized arguments: --speed"),
]


@pytest.fixture(autouse=True)
def nothing_is_planned(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work in an empty folder, and fail where bad input gets as far as the planner."""

    def refuse(*arguments: object) -> None:
        raise AssertionError("bad input was planned")

    monkeypatch.setattr(sys.modules[main.__module__], "plan", refuse)
    monkeypatch.chdir(tmp_path)


def write(path: Path, content: Any) -> str:
    """Write a scenario file and return its name."""
    if isinstance(content, dict):
        content = json.dumps(content)
    path.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8"))
    return path.name


def complaint(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """The line on stderr of a command line that is refused as bad input."""
    try:
        code: int | str | None = main(arguments)
    except SystemExit as stopped:  # argparse's way
        code = stopped.code
    out, err = capsys.readouterr()
    assert code == BAD_INPUT
    assert out == ""
    assert err.endswith("\n")
    (line,) = err.splitlines()
    assert "Traceback" not in line
    return line


@pytest.mark.parametrize(("content", "message"), JSON_FILES)
def test_a_bad_json_file_is_named_with_the_field_and_the_fault(
    content: Any, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name = write(tmp_path / "bad.json", content)
    assert complaint([name], capsys).startswith(f"bad.json: {message}")
    assert [path.name for path in tmp_path.iterdir()] == ["bad.json"]  # nothing is written for bad input


@pytest.mark.parametrize(("content", "message"), CSV_FILES)
def test_a_bad_tpcap_file_is_named_with_the_field_and_the_fault(
    content: str | bytes, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name = write(tmp_path / "bad.csv", content)
    assert complaint([name], capsys).startswith(f"bad.csv: {message}")


@pytest.mark.parametrize(("options", "message"), OPTIONS)
def test_a_bad_option_is_named_with_the_fault(
    options: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name = write(tmp_path / "good.json", GOOD)
    assert message in complaint([name, *options], capsys)


def test_a_network_without_weights_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    name = write(tmp_path / "good.json", GOOD)
    monkeypatch.setattr(guess_module, "bundled_weights", lambda *_: Path("nowhere.safetensors"))
    line = complaint([name, "--guess", "gnn"], capsys)
    assert line == "guess: 'gnn' needs trained weights: nowhere.safetensors: No such file or directory"


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("missing.json", "missing.json: file: cannot be read: No such file or directory"),
        ("nowhere/missing.csv", "nowhere/missing.csv: file: cannot be read: No such file or directory"),
        (
            "folder",
            "folder: scenario: neither a .json, .geojson, .dxf, .csv, .yaml or .yml file nor a bundled name (angled",
        ),
        ("folder.json", "folder.json: file: is a folder"),
        ("folder.csv", "folder.csv: file: is a folder"),
        ("map.xml", "map.xml: scenario: neither a .json, .geojson, .dxf, .csv, .yaml or .yml file nor a bundled name"),
        ("map_z", "map_z: scenario: neither a .json, .geojson, .dxf, .csv, .yaml or .yml file nor a bundled name"),
        ("", "'': scenario: neither a .json, .geojson, .dxf, .csv, .yaml or .yml file nor a bundled name"),
        ("x" * 300 + ".json", "x" * 300 + ".json: file: cannot be read: File name too long"),
    ],
)
def test_a_source_that_is_no_scenario_is_named(
    source: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("folder", "folder.json", "folder.csv"):
        (tmp_path / name).mkdir()
    write(tmp_path / "map.xml", GOOD)
    assert complaint([source], capsys).startswith(message)


def test_a_file_that_may_not_be_read_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*arguments: object, **options: object) -> None:
        raise PermissionError(13, "Permission denied")  # chmod would not keep root out

    name = write(tmp_path / "good.json", GOOD)
    monkeypatch.setattr(Path, "read_text", refuse)
    assert complaint([name], capsys) == "good.json: file: cannot be read: Permission denied"


@pytest.mark.parametrize(("out", "reason"), [("taken", "File exists"), ("taken/plans", "Not a directory")])
def test_an_out_folder_that_cannot_be_made_is_named(
    out: str, reason: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name = write(tmp_path / "good.json", GOOD)
    (tmp_path / "taken").write_text("a file")
    line = complaint([name, "--out", out], capsys)
    assert "taken" in line
    assert "--out" in line
    assert reason in line
    assert (tmp_path / "taken").read_text() == "a file"


@pytest.mark.parametrize("arguments", [["bad.json"], ["map_a", "--horizon", "-3"]], ids=["file", "option"])
def test_a_user_sees_one_line_and_no_traceback(arguments: list[str], tmp_path: Path) -> None:
    write(tmp_path / "bad.json", {**GOOD, "start": [0, 0]})
    done = subprocess.run(
        [sys.executable, "-m", "drake_gnnocp.plan", *arguments],
        cwd=tmp_path,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == BAD_INPUT
    assert done.stdout == ""
    assert len(done.stderr.splitlines()) == 1
    assert arguments[-1] in done.stderr
