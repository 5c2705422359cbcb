"""Arguments for poses, angles and vehicles, and the scenario that a command makes of them."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from drake_gnnocp import Scenario, command_line, verify_command
from drake_gnnocp.arguments import angle, pose
from drake_gnnocp.command_line import main
from drake_gnnocp.vehicle import Vehicle

ROUNDING = 1e-15
BAD_INPUT = 2  # exit code


class PlannedError(Exception):
    """Carries the scenario that would be planned."""


@pytest.fixture(autouse=True)
def nothing_is_planned(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work in an empty folder; a scenario that would be planned is raised."""

    def planned(scenario: Scenario, *_: object) -> None:
        raise PlannedError(scenario)

    monkeypatch.setattr(command_line, "plan", planned)
    monkeypatch.chdir(tmp_path)


def scenario_of(line: str) -> Scenario:
    """What a command line would plan."""
    with pytest.raises(PlannedError) as raised:
        main([*line.split(), "--out", "out"])
    return raised.value.args[0]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        *(("1.57", 1.57), ("1.57rad", 1.57), ("-.5 rad", -0.5), ("0", 0.0), ("2e-1", 0.2)),
        *(("90deg", math.pi / 2), ("-45 deg", -math.pi / 4), ("180°", math.pi), ("30DEG", math.pi / 6)),
    ],
)
def test_angles_are_in_rad_or_say_their_unit(text: str, expected: float) -> None:
    assert angle(text) == pytest.approx(expected, abs=ROUNDING)


@pytest.mark.parametrize("text", ["", "deg", "90grad", "90deg rad", "north", "1,5", "degdeg"])
def test_what_is_no_angle_is_refused(text: str) -> None:
    with pytest.raises(ValueError):
        angle(text)


@pytest.mark.parametrize(
    ("texts", "what"), [(("x", "0", "0"), "X"), (("0", "90deg", "0"), "Y"), (("0", "0", "inf"), "THETA")]
)
def test_a_pose_names_the_number_that_is_none(texts: tuple[str, ...], what: str) -> None:
    with pytest.raises(ValueError, match=f"^{what} must be"):
        pose(texts)


def test_negative_numbers_with_units_and_exponents_are_numbers() -> None:
    scenario = scenario_of("map_a --start -1e0 0 -.5rad --goal 14 -2.5e-1 -10deg --clearance 0.1")
    assert scenario.start.tolist() == [-1.0, 0.0, -0.5]
    assert scenario.goal.tolist() == pytest.approx([14.0, -0.25, math.radians(-10)])
    assert scenario.clearance == 0.1


@pytest.mark.parametrize(
    "line", ["--start 1 2", "--start 1 2 three", "--start -1 --goal 1 2 3", "--start 1 nan 0", "--vehicle none.json"]
)
def test_bad_arguments_are_one_line(line: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as exit_of:
        main(["map_a", *line.split()])
    err = capsys.readouterr().err
    assert exit_of.value.code == BAD_INPUT and len(err.splitlines()) == 1
    assert f"argument {line.split()[0]}: " in err


def test_a_start_takes_the_place_of_one_that_could_not_be_planned() -> None:
    block = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
    Path("yard.json").write_text(
        json.dumps({"name": "y", "start": [0, 0, 0], "goal": [20, 0, 0], "obstacles": [block]})
    )
    assert scenario_of("yard.json --start 8 0 0").start.tolist() == [8, 0, 0]


def test_a_vehicle_is_read_from_a_file(capsys: pytest.CaptureFixture[str]) -> None:
    Path("car.json").write_text('{"width": 1.5, "wheelbase": 2.5}')
    assert scenario_of("map_a --vehicle car.json").vehicle == Vehicle(width=1.5, wheelbase=2.5)
    for text, reason in (("[]", "vehicle: must be an object"), ('{"wide": 2}', "vehicle.wide: unknown key")):
        Path("car.json").write_text(text)
        with pytest.raises(SystemExit):
            main(["map_a", "--vehicle", "car.json"])
        assert f"argument --vehicle: car.json: {reason}" in capsys.readouterr().err


def test_unknown_cells_are_occupied_or_free_as_one_says(capsys: pytest.CaptureFixture[str]) -> None:
    pixels = np.full((40, 60), 254, dtype=np.uint8)
    pixels[:, 40:] = 205  # unknown
    Path("hall.yml").write_text(
        "image: hall.pgm\nresolution: 0.5\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    Path("hall.pgm").write_bytes(b"P5 60 40 255\n" + pixels.tobytes())
    line = "hall.yml --start 2 10 0 --goal 24 10 0"
    assert main([*line.split(), "--out", "out"]) == BAD_INPUT
    said = "hall.yml: goal: the car collides with an occupied (or unknown) cell near (23.07, 9.05)\n"
    assert capsys.readouterr().err == said
    scenario = scenario_of(f"{line} --unknown free")
    assert (scenario.name, scenario.bounds, scenario.obstacles) == ("hall", (0.0, 30.0, 0.0, 20.0), ())


def test_a_plan_on_a_map_is_checked_with_the_same_arguments(capsys: pytest.CaptureFixture[str]) -> None:
    hall = b"P5 60 40 255\n" + bytes([254] * 2400)
    Path("hall.pgm").write_bytes(hall)
    Path("hall.yaml").write_text(
        "image: hall.pgm\nresolution: 0.5\norigin: [-2, -10, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    Path("still.csv").write_text("t,x,y,theta,v,phi,a,w\n" + "".join(f"{t},0,0,0,0,0,0,0\n" for t in (0, 1)))
    assert verify_command.main(["hall.yaml", "still.csv", *"--start 0 0 -0deg --goal 0 0 0".split()]) == 0
    assert verify_command.main(["hall.yaml", "still.csv", *"--start 0 0 -0deg --goal -0.5 0 0".split()]) == 3
    assert "hall: verified, " in capsys.readouterr().out
    assert verify_command.main(["hall.yaml", "still.csv"]) == BAD_INPUT


def test_a_scenario_file_may_leave_start_and_goal_to_the_command(tmp_path: Path) -> None:
    Path("bare.json").write_text(json.dumps({"name": "bare", "obstacles": [], "goal": [9, 0, 0]}))
    scenario = scenario_of("bare.json --start 1 2 90deg --goal 9 5 0")
    assert scenario.start.tolist() == [1, 2, math.pi / 2] and scenario.goal.tolist() == [9, 5, 0]
    assert scenario_of("bare.json --start 1 2 0").goal.tolist() == [9, 0, 0]
