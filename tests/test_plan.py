"""The planner and its command line: contracts on files, exit codes, budget and reasons."""

import json
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import drake_gnnocp
from drake_gnnocp import Scenario, Trajectory, Vehicle, command_line, plan
from drake_gnnocp.command_line import main
from drake_gnnocp.guesses.sources import GuessOptions, GuessUnavailable, straight_guess
from drake_gnnocp.ocp.convex_step import ConvexOptions
from drake_gnnocp.ocp.cost import Cost
from drake_gnnocp.ocp.refine import Optimised, RefineOptions, Round, optimise
from drake_gnnocp.planner import planner
from drake_gnnocp.planner.result import OUT_OF_TIME
from drake_gnnocp.scenario import bundled_scenarios
from drake_gnnocp.verification import verify

BUDGET_OVERRUN = 2.0  # s: a verification and one iteration of Ipopt on a busy machine
RESULT_KEYS = {
    "scenario", "status", "guess", "total_seconds", "t_final", "cost", "attempts", "verification",
}  # fmt: skip
ATTEMPT_KEYS = {
    "guess", "guess_seconds", "build_seconds", "solve_seconds", "iterations", "first_iterations", "convex_steps",
    "refinements", "solver_status", "cost", "verified", "reason",
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
    assert result["status"] == "verified" and result["guess"] == "gnn"
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
    assert result["status"] == "unverified"
    assert [attempt["guess"] for attempt in result["attempts"]] == ["gnn", "hybrid_astar", "straight"]
    assert all(attempt["reason"] and not attempt["verified"] for attempt in result["attempts"])
    assert "unverified" in capsys.readouterr().out
    for name in ("trajectory.csv", "plan.png", "states.png", "replay.html"):
        assert (tmp_path / "out" / name).exists()


def test_a_run_that_solved_nothing_writes_its_guess_and_leaves_no_pictures_of_an_older_plan(tmp_path: Path) -> None:
    assert main(["empty_field", "--out", str(tmp_path)]) == 0
    assert main(["empty_field", "--out", str(tmp_path), "--max-seconds", "0.001"]) == 3
    assert json.loads((tmp_path / "result.json").read_text())["status"] == "failed"
    assert (tmp_path / "trajectory.csv").read_text() == (tmp_path / "guess.csv").read_text()
    for name in ("states.png", "replay.html"):
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


def test_a_horizon_the_path_is_too_long_for_is_refused_without_a_solve() -> None:
    result = plan(Scenario.load("empty_field"), horizon=3.0)
    assert [attempt.guess for attempt in result.attempts] == ["gnn", "hybrid_astar"]
    assert result.status == "failed"
    for attempt in result.attempts:
        assert "at v_max" in attempt.reason and attempt.solver_status == "" and not attempt.verified
    assert result.trajectory is None and result.guess is not None
    assert result.total_seconds < BUDGET_OVERRUN


def test_a_horizon_a_little_too_short_is_tried_and_given_up() -> None:
    scenario = Scenario("sprint", np.zeros(3), np.array([10.0, 0.0, 0.0]))  # 10 m take 5.25 s from rest to rest
    result = plan(scenario, horizon=4.5, max_seconds=3.0)
    assert result.status == "unverified"
    assert all(attempt.reason and not attempt.verified for attempt in result.attempts)
    assert result.attempts[0].solver_status


def test_early_attempts_leave_time_for_later_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    budget, shares = 20.0, []

    def nothing_found(
        scenario: Scenario, guess: Trajectory, _options: RefineOptions, deadline: float, _stepped: object
    ) -> Optimised:
        shares.append((deadline - time.monotonic()) / budget)
        check, cost = verify(scenario, guess), Cost(0.0, 0.0, 0.0)
        assert not check.verified
        solve = Round(0.0, 0.0, 1, False, "Wall time exceeded", (), 0, 0, check)
        return Optimised(guess, check, cost, (solve,), "nothing found")

    monkeypatch.setattr(planner, "optimise", nothing_found)
    plan(Scenario.load("empty_field"), "hybrid_astar", max_seconds=budget)
    plan(Scenario.load("empty_field"), "straight", max_seconds=budget)
    first, second, third, only = shares
    assert 0.3 < first <= 0.4
    assert 0.5 < second <= 0.6
    assert min(third, only) > 0.8  # the machine may be busy; the solver took no time


def test_a_guess_that_was_never_optimised_is_failed_even_where_it_would_pass(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def too_late(scenario: Scenario, guess: Trajectory, *_: object) -> Optimised:
        check = verify(scenario, guess)
        assert check.verified  # of a car that stays
        return Optimised(guess, check, Cost(0.0, 0.0, 0.0), (), "")

    monkeypatch.setattr(planner, "optimise", too_late)
    pose = np.array([1.0, 2.0, 0.5])
    result = plan(Scenario("stay", pose, pose), "hybrid_astar")
    assert result.status == "failed" and result.trajectory is None and result.guess is not None
    assert all(attempt.reason and not attempt.verified for attempt in result.attempts)
    result.save(tmp_path)
    names = {"scenario.json", "trajectory.csv", "guess.csv", "result.json"}
    assert {path.name for path in tmp_path.iterdir()} == names
    assert json.loads((tmp_path / "result.json").read_text())["attempts"][0]["cost"] is None


def test_the_picture_of_an_unsolved_plan_shows_a_guess_and_no_optimised_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = []
    monkeypatch.setattr(command_line, "save_plan_picture", lambda *given: drawn.append(given[2:4]))
    assert main(["empty_field", "--horizon", "3", "--out", str(tmp_path)]) == 3
    ((trajectory, guess),) = drawn
    assert trajectory is None and guess is not None
    assert not (tmp_path / "states.png").exists() and not (tmp_path / "replay.html").exists()


@pytest.mark.parametrize("status", ["Wall time exceeded", "Success"])
def test_a_verified_plan_cut_by_the_budget_is_said_to_be(
    status: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    made = plan(Scenario.load("empty_field"))
    made = replace(made, attempts=(replace(made.attempts[-1], solver_status=status),))
    monkeypatch.setattr(command_line, "plan", lambda *_: made)
    assert main(["empty_field", "--no-pictures", "--out", str(tmp_path)]) == 0
    cut = "stopped by the budget: not yet at its optimum" in capsys.readouterr().out
    assert cut == (status == "Wall time exceeded")


def test_a_folder_that_cannot_be_written_is_noticed_before_planning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refused(dir: Path) -> None:
        raise PermissionError(13, "Permission denied", str(dir))

    monkeypatch.setattr(command_line, "TemporaryFile", refused)
    monkeypatch.setattr(command_line, "plan", None)
    assert main(["map_a", "--out", str(tmp_path)]) == 2
    assert capsys.readouterr().err == f"--out: {tmp_path}: Permission denied\n"


def test_ipopt_says_that_its_time_is_over_in_the_words_the_plan_looks_for() -> None:
    scenario = Scenario.load("crowded_yard")
    guess = straight_guess(scenario, GuessOptions()).trajectory
    assert guess is not None
    options = RefineOptions(convex=ConvexOptions(most_steps=0), reserve=0.0)
    outcome = optimise(scenario, guess, options, time.monotonic() + 1.0)  # too little for a guess through obstacles
    assert outcome.rounds[-1].status == OUT_OF_TIME


def test_warnings_of_drake_do_not_reach_the_user(tmp_path: Path) -> None:
    code = "import logging, sys; from drake_gnnocp.command_line import main; main(sys.argv[1:])"
    code += "; logging.getLogger('drake').warning('IPOPT terminated')"
    command = [sys.executable, "-c", code, "--list"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=tmp_path)
    assert done.stderr == ""


def test_start_equal_to_goal_is_a_plan_that_stays() -> None:
    pose = np.array([1.0, 2.0, 0.5])
    result = plan(Scenario("stay", pose, pose), "hybrid_astar")
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


def test_an_unknown_guess_is_refused() -> None:
    with pytest.raises(GuessUnavailable, match="guess: must be one of"):
        plan(Scenario.load("empty_field"), "nonsense")


@pytest.mark.parametrize("seconds", [0.0, -1.0, float("nan")])
def test_an_illegal_budget_is_refused(seconds: float) -> None:
    with pytest.raises(ValueError, match="max_seconds"):
        plan(Scenario.load("empty_field"), max_seconds=seconds)


@pytest.mark.slow
@pytest.mark.parametrize("name", bundled_scenarios())
@pytest.mark.parametrize("guess", ["auto", "hybrid_astar"])
def test_every_bundled_scenario_is_verified(name: str, guess: str) -> None:
    result = plan(Scenario.load(name), guess)
    assert result.verified, [attempt.reason for attempt in result.attempts]


@pytest.mark.slow
@pytest.mark.skipif(not TPCAP.is_dir(), reason="the TPCAP cases are not beside this checkout")
@pytest.mark.parametrize("guess", ["auto", "hybrid_astar"])
def test_all_tpcap_cases_are_verified(guess: str) -> None:
    results = {path.name: plan(Scenario.load(path), guess) for path in sorted(TPCAP.glob("*.csv"))}
    assert [name for name, result in results.items() if not result.verified] == []
