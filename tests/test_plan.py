"""The planner and its command line: contracts on files, exit codes, budget and reasons."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import drake_gnnocp
from drake_gnnocp import PlanOptions, Scenario, Trajectory, Vehicle, pictures, plan
from drake_gnnocp.command_line import main
from drake_gnnocp.guesses.straight import straight_line
from drake_gnnocp.ocp import ipopt
from drake_gnnocp.ocp.costs import CostWeights
from drake_gnnocp.ocp.formulation import Formulation, formulate
from drake_gnnocp.ocp.ipopt import USUAL
from drake_gnnocp.ocp.nlp import build
from drake_gnnocp.ocp.refine import Refined, Solve
from drake_gnnocp.planner import attempt as attempt_module
from drake_gnnocp.scenario import bundled_scenarios
from drake_gnnocp.verification import verify

RESULT_KEYS = {
    "scenario", "status", "guess", "total_seconds", "budget_ended", "goal_reached", "t_final", "cost", "no_path",
    "attempts", "verification",
}  # fmt: skip
ATTEMPT_KEYS = {
    "guess", "goal", "guess_seconds", "guess_probability", "build_seconds", "solve_seconds", "iterations",
    "first_iterations", "convex_steps", "refinements", "solver_status", "cost", "verified", "reason",
}  # fmt: skip
VERIFICATION_KEYS = {
    "collision_free", "min_clearance_m", "terminal_position_error_m", "terminal_heading_error_rad",
    "max_dynamics_gap_m", "limits_ok", "bounds_ok",
}  # fmt: skip
TPCAP = Path(__file__).parents[2] / "shared" / "scenarios" / "tpcap"


@pytest.fixture
def nothing_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever is solved ends in an obstacle at once."""

    def collides(scenario: Scenario, formulation: Formulation, *_: object) -> Refined:
        check = replace(verify(scenario, formulation.reference), collision_free=False)
        solve = Solve(0.0, 0.0, 1, False, "Infeasible", (), 0, 0, formulation.reference, check)
        return Refined((solve,), 0, "collides with an obstacle")

    monkeypatch.setattr(attempt_module, "refine", collides)


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
    assert result["cost"].keys() == {"definition", "J", "J1", "J2", "lambda1", "lambda2"}

    scenario = Scenario.load(tmp_path / "scenario.json")
    trajectory = Trajectory.load_csv(tmp_path / "trajectory.csv")
    assert len(trajectory) == len(Trajectory.load_csv(tmp_path / "guess.csv")) == 120
    np.testing.assert_allclose(np.diff(trajectory.t), trajectory.duration / 119, rtol=1e-9)
    assert result["t_final"] == trajectory.duration
    assert verify(scenario, trajectory).verified


def test_no_verified_plan_exits_3_and_says_why(
    tmp_path: Path, nothing_is_found: None, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["empty_field", "--out", str(tmp_path / "out")]) == 3
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert result["status"] == "unverified" and result["no_path"] is None
    assert {attempt["guess"] for attempt in result["attempts"]} == {"gnn", "hybrid_astar"}
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


def test_a_straight_guess_that_fails_is_written_and_marked(tmp_path: Path, nothing_is_found: None) -> None:
    options = ["--guess", "straight", "--no-pictures", "--out", str(tmp_path / "out")]
    assert main(["map_a", *options]) == 3
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
    assert [attempt.source for attempt in result.attempts] == ["gnn", "hybrid_astar"]
    assert result.status == "failed"
    for attempt in result.attempts:
        assert "at v_max" in attempt.reason and attempt.solver_status == "" and not attempt.verified
    assert result.trajectory is None and result.guess is not None


def test_a_horizon_a_little_too_short_is_tried_and_given_up() -> None:
    scenario = Scenario("sprint", np.zeros(3), np.array([10.0, 0.0, 0.0]))  # 10 m take 5.25 s from rest to rest
    result = plan(scenario, horizon=4.5, max_seconds=10.0, options=PlanOptions(most_attempts=1))
    assert result.status == "unverified"
    assert all(attempt.reason and not attempt.verified for attempt in result.attempts)
    assert result.attempts[0].solver_status


def test_a_guess_that_was_never_optimised_is_failed_even_where_it_would_pass(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(attempt_module, "refine", lambda *_: Refined((), None, "too late"))
    pose = np.array([1.0, 2.0, 0.5])
    ahead = pose + [0.1 * np.cos(0.5), 0.1 * np.sin(0.5), 0.0]
    result = plan(Scenario("creep", pose, ahead), "hybrid_astar")
    assert result.guess is not None and verify(result.scenario, result.guess).verified
    assert result.status == "failed" and result.trajectory is None
    assert all(attempt.reason and not attempt.verified for attempt in result.attempts)
    result.save(tmp_path)
    names = {"scenario.json", "trajectory.csv", "guess.csv", "result.json"}
    assert {path.name for path in tmp_path.iterdir()} == names
    assert json.loads((tmp_path / "result.json").read_text())["attempts"][0]["cost"] is None


def test_the_picture_of_an_unsolved_plan_shows_a_guess_and_no_optimised_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = []
    monkeypatch.setattr(pictures, "save_plan_picture", lambda *given: drawn.append(given[2:4]))
    assert main(["empty_field", "--horizon", "3", "--out", str(tmp_path)]) == 3
    ((trajectory, guess),) = drawn
    assert trajectory is None and guess is not None
    assert not (tmp_path / "states.png").exists() and not (tmp_path / "replay.html").exists()


def test_ipopt_says_that_its_time_is_over_in_the_words_that_are_looked_for() -> None:
    scenario = Scenario.load("crowded_yard")
    nlp = build(formulate(scenario, straight_line(scenario, 120), CostWeights(), 0.1))
    solution = ipopt.solve(nlp.program, nlp.first_iterate, nlp.hessian, 0.0, USUAL)
    assert solution.status == ipopt.OUT_OF_TIME


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


def test_a_plan_is_short_in_print_and_a_picture_in_a_notebook() -> None:
    result = plan("empty_field")
    assert repr(result).startswith("<Plan empty_field: verified") and len(repr(result)) < 300
    assert "data:image/png;base64" in result._repr_html_()


def test_the_reported_attempt_is_the_one_the_plan_is_of(nothing_is_found: None) -> None:
    result = plan(Scenario.load("empty_field"))
    assert result.attempt is result.attempts[result.reported]
    assert result.trajectory is result.attempt.trajectory and result.guess is result.attempt.start


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


def test_without_comfort_a_verified_plan_is_left_as_it_is() -> None:
    comfortable = plan("parallel_out")
    quick = plan("parallel_out", options=PlanOptions(comfort=0.0))
    assert comfortable.verification is not None and quick.verification is not None
    assert comfortable.verified and quick.verified
    assert len(quick.attempt.solves) == 1 < len(comfortable.attempt.solves)
    assert quick.verification.min_clearance_m < 0.1 <= comfortable.verification.min_clearance_m
