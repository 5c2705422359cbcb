"""The planner and its command line: contracts on files, exit codes, budget and reasons."""

import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import drake_gnnocp
from drake_gnnocp import Scenario, Trajectory, Vehicle, plan
from drake_gnnocp.plan.__main__ import main
from drake_gnnocp.plan.guess import GuessUnavailable
from drake_gnnocp.scenario import bundled_scenarios
from drake_gnnocp.verification import verify

BUDGET_OVERRUN = 2.0  # s: a verification and one iteration of Ipopt on a busy machine
RESULT_KEYS = {
    "scenario", "status", "guess", "total_seconds", "t_final", "cost", "attempts", "verification",
}  # fmt: skip
ATTEMPT_KEYS = {
    "guess", "guess_seconds", "build_seconds", "solve_seconds", "iterations", "refinements", "solver_status", "cost",
    "verified", "reason",
}  # fmt: skip
VERIFICATION_KEYS = {
    "collision_free", "min_clearance_m", "terminal_position_error_m", "terminal_heading_error_rad",
    "max_dynamics_gap_m", "limits_ok", "bounds_ok",
}  # fmt: skip
TPCAP = Path(__file__).parents[2] / "shared" / "scenarios" / "tpcap"


@pytest.fixture
def walled_in() -> dict[str, object]:
    """A goal inside a closed ring of walls."""
    walls = [
        [[10, -6], [22, -6], [22, -5], [10, -5]],
        [[10, 5], [22, 5], [22, 6], [10, 6]],
        [[10, -5], [11, -5], [11, 5], [10, 5]],
        [[21, -5], [22, -5], [22, 5], [21, 5]],
    ]
    return {"name": "walled_in", "start": [0, 0, 0], "goal": [14, 0, 0], "obstacles": walls}


def test_a_plan_of_the_default_scenario_writes_all_files_and_exits_0(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--out", str(tmp_path)]) == 0
    names = {"scenario.json", "trajectory.csv", "guess.csv", "result.json", "plan.png", "states.png", "replay.html"}
    assert {path.name for path in tmp_path.iterdir()} == names
    assert "map_a: verified" in capsys.readouterr().out

    result = json.loads((tmp_path / "result.json").read_text())
    assert result.keys() == RESULT_KEYS
    assert result["status"] == "verified" and result["guess"] == "hybrid_astar"
    assert all(attempt.keys() == ATTEMPT_KEYS for attempt in result["attempts"])
    assert result["attempts"][-1]["verified"] and result["attempts"][-1]["iterations"] > 0
    assert result["verification"].keys() >= VERIFICATION_KEYS
    assert result["cost"].keys() == {"J", "J1", "J2"}

    scenario = Scenario.load(tmp_path / "scenario.json")
    trajectory = Trajectory.load_csv(tmp_path / "trajectory.csv")
    assert len(trajectory) == len(Trajectory.load_csv(tmp_path / "guess.csv")) == 120
    np.testing.assert_allclose(np.diff(trajectory.t), trajectory.duration / 119, rtol=1e-9)
    assert result["t_final"] == trajectory.duration
    assert verify(scenario, trajectory).verified


def test_no_verified_plan_exits_3_and_says_why(
    tmp_path: Path, walled_in: dict[str, object], capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "walled_in.json"
    path.write_text(json.dumps(walled_in))
    begin = time.monotonic()
    assert main([str(path), "--out", str(tmp_path / "out"), "--max-seconds", "3"]) == 3
    assert time.monotonic() - begin < 3 + 2 * BUDGET_OVERRUN  # pictures as well
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert result["status"] == "failed"
    assert all(attempt["reason"] and not attempt["verified"] for attempt in result["attempts"])
    assert "failed" in capsys.readouterr().out
    assert (tmp_path / "out" / "plan.png").exists()


def test_a_failed_run_leaves_nothing_of_an_older_plan(tmp_path: Path, walled_in: dict[str, object]) -> None:
    assert main(["empty_field", "--out", str(tmp_path)]) == 0
    path = tmp_path / "walled_in.json"
    path.write_text(json.dumps(walled_in))
    assert main([str(path), "--out", str(tmp_path), "--max-seconds", "2"]) == 3
    for name in ("trajectory.csv", "guess.csv", "states.png", "replay.html"):
        assert not (tmp_path / name).exists()


def test_a_straight_guess_that_fails_is_written_and_marked(tmp_path: Path, walled_in: dict[str, object]) -> None:
    path = tmp_path / "walled_in.json"
    path.write_text(json.dumps(walled_in))
    options = ["--guess", "straight", "--max-seconds", "4", "--no-pictures", "--out", str(tmp_path / "out")]
    assert main([str(path), *options]) == 3
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert result["status"] == "unverified" and result["attempts"][0]["reason"]
    assert len(Trajectory.load_csv(tmp_path / "out" / "trajectory.csv")) == 120
    assert not (tmp_path / "out" / "plan.png").exists()


def test_list_prints_the_bundled_scenarios(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--list"]) == 0
    assert capsys.readouterr().out.split() == bundled_scenarios()


def test_the_module_runs_as_a_command_and_the_function_stays_importable(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "drake_gnnocp.plan", "empty_field", "--no-pictures", "--out", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and done.stderr == "", done.stderr
    assert callable(drake_gnnocp.plan)


@pytest.mark.parametrize("seconds", [12.0, 20.0])
def test_a_constant_horizon_is_kept(seconds: float) -> None:
    result = plan(Scenario.load("empty_field"), horizon=seconds)
    assert result.verified and result.trajectory is not None
    assert result.trajectory.duration == pytest.approx(seconds)


def test_a_horizon_too_short_for_the_limits_is_not_verified() -> None:
    result = plan(Scenario.load("empty_field"), horizon=3.0, max_seconds=5.0)
    assert result.status == "unverified"
    assert all(attempt.reason for attempt in result.attempts)


def test_start_equal_to_goal_is_a_plan_that_stays() -> None:
    pose = np.array([1.0, 2.0, 0.5])
    result = plan(Scenario("stay", pose, pose))
    assert result.verified and result.trajectory is not None
    assert np.ptp(result.trajectory.states[:, 0]) < 0.01


def test_plans_far_from_the_origin_and_turned_headings_are_verified_there() -> None:
    far = np.array([7e9, -8e9, 0.0])
    wall = np.array([[4.0, -3.0], [6.0, -3.0], [6.0, 0.5], [4.0, 0.5]]) + far[:2]
    start, goal = far + [-6.0, 0.0, 4 * np.pi], far + [12.0, 0.0, -2 * np.pi]
    result = plan(Scenario("far", start, goal, (wall,)))
    assert result.verified and result.trajectory is not None
    np.testing.assert_allclose(result.trajectory.states[0, :3], start, rtol=1e-15)


def test_another_vehicle_plans_within_its_own_limits() -> None:
    slow = Vehicle(v_max=1.0, a_max=0.5, phi_max=0.5, w_max=0.3, wheelbase=3.5)
    result = plan(Scenario("slow", np.zeros(3), np.array([10.0, 3.0, 0.3]), vehicle=slow))
    assert result.verified and result.trajectory is not None
    assert np.abs(result.trajectory.states[:, 3]).max() <= 1.001


@pytest.mark.parametrize("guess", ["gnn", "rrt_star", "nonsense"])
def test_guesses_that_cannot_be_made_are_refused(guess: str) -> None:
    with pytest.raises(GuessUnavailable, match="guess"):
        plan(Scenario.load("empty_field"), guess)


@pytest.mark.parametrize("seconds", [0.0, -1.0, float("nan")])
def test_an_illegal_budget_is_refused(seconds: float) -> None:
    with pytest.raises(ValueError, match="max_seconds"):
        plan(Scenario.load("empty_field"), max_seconds=seconds)


@pytest.mark.slow
@pytest.mark.parametrize("name", bundled_scenarios())
def test_every_bundled_scenario_is_verified(name: str) -> None:
    result = plan(Scenario.load(name), "hybrid_astar")
    assert result.verified, [attempt.reason for attempt in result.attempts]


@pytest.mark.slow
@pytest.mark.skipif(not TPCAP.is_dir(), reason="the TPCAP cases are not beside this checkout")
def test_most_tpcap_cases_are_verified() -> None:
    verified = [plan(Scenario.load(path), "hybrid_astar").verified for path in sorted(TPCAP.glob("*.csv"))]
    assert sum(verified) >= 7
