"""The benchmark's runs: guesses on disk, numbers that add up, no run made twice."""

import os
import signal
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from benchmark_runs import PATIENT, cells, here, refuse

from drake_gnnocp import Trajectory
from drake_gnnocp.experiments.benchmark.engine import Engine, Job
from drake_gnnocp.experiments.benchmark.guesses import MadeGuess, load_guess, save_guess, with_noise
from drake_gnnocp.experiments.benchmark.runs import SOLVED, Run, RunFile, RunsError, table_of
from drake_gnnocp.experiments.benchmark.solving import NO_METHOD, Settings, solving_engine, solving_jobs
from drake_gnnocp.experiments.benchmark.tasks import random_tasks
from drake_gnnocp.experiments.benchmark.worker import Worker, WorkerDied, WorkerNotStarted
from drake_gnnocp.experiments.reports.solving import PEER, main, summarise
from drake_gnnocp.workers import single_threaded_children

GUESS = "hybrid_astar"


def test_noise_has_the_amplitude_asked_for_and_keeps_the_ends() -> None:
    t = np.linspace(0.0, 9.0, 120)
    plan = Trajectory(t, np.zeros((120, 5)), np.zeros((120, 2)))
    noisy = with_noise(plan, 0.6, np.random.default_rng(0))
    np.testing.assert_allclose(np.sqrt(np.mean(noisy.states[:, :2] ** 2, axis=0)), 0.6, rtol=1e-9)
    np.testing.assert_array_equal(noisy.states[[0, -1]], 0.0)
    np.testing.assert_array_equal(noisy.states[:, 2:], 0.0)


def test_guesses_come_back_from_disk(tmp_path: Path) -> None:
    t = np.linspace(0.0, 1.0, 3)
    trajectory = Trajectory(t, np.arange(15.0).reshape(3, 5), np.ones((3, 2)))
    save_guess(tmp_path / "new" / "a.npz", MadeGuess(trajectory, "", 0.5))
    back = load_guess(tmp_path / "new" / "a.npz")
    assert back.trajectory is not None and back.seconds == 0.5
    np.testing.assert_array_equal(back.trajectory.states, trajectory.states)
    save_guess(tmp_path / "b.npz", MadeGuess(None, "no path", 5.0))
    assert load_guess(tmp_path / "b.npz") == MadeGuess(None, "no path", 5.0)


def run_of(task: str, method: str, seconds: float, **changes: Any) -> Run:
    """A run of which `seconds` went to building and solving."""
    times = {"build_s": 0.25 * seconds, "solve_s": 0.75 * seconds, "total_s": 1.1 * seconds}
    counts = {"convex_steps": 5, "first_iterations": 20, "iterations": 30, "rounds": 2, "rows": 900}
    run = Run(task, "random, seed 0", GUESS, method, 0, **times, **counts, clearance_m=0.1)  # type: ignore[arg-type]
    return replace(run, **changes)


@pytest.fixture
def runs() -> list[Run]:
    """Two tasks with a guess and one without; the peer is faster once, and once not verified."""
    found = [run_of(task, NO_METHOD, 1.0, converged=True) for task in ("a", "b")]
    return [
        *found,
        run_of("c", NO_METHOD, 5.0, converged=False, status="out of time"),
        run_of("a", "drake", 1.0, cost=3.0, converged=True, verified=True),
        run_of("a", "casadi_mx", 2.0, cost=2.0, converged=True, verified=True),
        run_of("a", "casadi_sx", 4.0, cost=2.0, converged=True, verified=True),
        run_of("b", "drake", 3.2, cost=3.0, converged=True, verified=True, iterations=50),
        run_of("b", "casadi_mx", 1.0, cost=9.0, converged=False, verified=False),
        run_of("b", "casadi_sx", 1.5, cost=4.0, converged=True, verified=False, reason="collides with an obstacle"),
    ]


def test_the_summary_counts_failures_and_takes_the_peers_best(runs: list[Run]) -> None:
    summary = summarise(table_of(runs))
    assert "3 tasks; Hybrid A* found no guess in 1, which are left out (c)" in summary
    drake, peer = cells(summary, "drake"), cells(summary, PEER)
    assert drake[1:4] == ["2", "2", "2 (100 %)"] and drake[6] == "40 / 49"
    assert drake[11] == "2.10 / 3.09"  # build + solve of 1 s and 3.2 s
    assert peer[1:4] == ["2", "2", "1 (50 %)"] and peer[11] == "1.75 / 1.98"  # 2 s and 1.5 s: 1 s did not converge
    # 1 / 2 and 3.2 / 1.5; the percentiles are 3.09 and 1.975
    assert cells(summary, "attempted by both")[1:] == ["2", "1.32", "2.05", "1.56", "-"]
    assert cells(summary, "verified by both")[1:] == ["1", "0.50", "0.50", "0.50", "1.500"]


def test_the_kept_runs_lead_to_the_kept_summary() -> None:
    folder = Path(__file__).parents[1] / "artifacts" / "ocp_benchmark"
    summary, kept = summarise(RunFile(folder / "runs.csv", SOLVED).table), (folder / "summary.md").read_text()
    assert summary.split("## Tasks")[1] == kept.split("## Tasks")[1]


def test_the_summary_lists_bad_guesses_apart(runs: list[Run]) -> None:
    bad = [run_of(task, "drake", 2.0, verified=task == "a") for task in ("a", "b")]
    summary = summarise(table_of([*runs, *(replace(run, guess="noise 0.6 m") for run in bad)]))
    assert cells(summary, "noise 0.6 m")[1:4] == ["2", "0", "1 (50 %)"]
    assert cells(summary, "drake")[1] == "2"


def test_rows_come_back_from_the_file_and_a_torn_one_is_dropped(tmp_path: Path, runs: list[Run]) -> None:
    path = tmp_path / "runs.csv"
    file = RunFile(path, SOLVED)
    for run in [*runs, replace(runs[3], scenario="NA", total_s=0.1 + 0.2, reason='said "no", twice')]:
        file.add(run)
    with path.open("a") as text:
        text.write('"random, seed 0",d,hybr')
    again = RunFile(path, SOLVED)
    pd.testing.assert_frame_equal(again.table, file.table, check_exact=True)
    again.add(replace(runs[3], scenario="d"))
    assert list(RunFile(path, SOLVED).table.scenario)[-2:] == ["NA", "d"]


@pytest.mark.parametrize("text", ["t,x,y\n1,2,3\n", "t,x,y\n1,2,3", "of something else"])
def test_another_file_is_not_taken_for_runs_and_stays_as_it_is(tmp_path: Path, text: str) -> None:
    path = tmp_path / "runs.csv"
    path.write_text(text)
    with pytest.raises(RunsError, match="not a file of runs"):
        RunFile(path, SOLVED)
    assert path.read_text() == text


@pytest.mark.parametrize("cell", ["many", "1,2"])
def test_a_row_that_is_none_is_refused_in_one_line(tmp_path: Path, runs: list[Run], cell: str) -> None:
    path = tmp_path / "runs.csv"
    file = RunFile(path, SOLVED)
    for run in runs[:2]:
        file.add(run)
    path.write_text(path.read_text().replace(",20,30,", f",{cell},30,"))
    with pytest.raises(RunsError, match="runs.csv: ") as error:
        RunFile(path, SOLVED)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("length", [0, 5])
def test_a_header_that_was_cut_off_is_a_file_without_runs(tmp_path: Path, length: int) -> None:
    (tmp_path / "runs.csv").write_text(",".join(SOLVED)[:length])
    assert RunFile(tmp_path / "runs.csv", SOLVED).table.empty


# ------------------------------------------------------------------------------------------------------ the whole thing


def test_a_worker_raises_what_its_function_raises_and_survives_a_crash() -> None:
    with Worker(int) as worker:
        assert worker.call(max, 1, 2, timeout=PATIENT) == 2
        with pytest.raises(ValueError, match="invalid literal"):
            worker.call(int, "x", timeout=PATIENT)
        with pytest.raises(WorkerDied):
            worker.call(os._exit, 11, timeout=PATIENT)
        assert worker.call(os.getenv, "OMP_NUM_THREADS", timeout=PATIENT) == "1"
        # an interrupted benchmark finishes the runs under way
        assert worker.call(signal.getsignal, signal.SIGINT, timeout=PATIENT) == signal.SIG_IGN


def test_a_process_that_is_not_made_ready_is_no_crash_of_a_run() -> None:
    for first in (partial(os._exit, 11), partial(int, "x")):
        with Worker(first) as worker:
            for _ in range(2):  # and no call is ever made without it
                with pytest.raises(WorkerNotStarted):
                    worker.call(max, 1, 2, timeout=PATIENT)


def test_children_of_several_threads_have_one_thread_each_and_leave_the_environment(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "7")

    def child(_: int) -> str:
        with single_threaded_children():
            for _ in range(20):
                os.sched_yield()  # the others have their chance, as while a process is started
            return os.environ["OMP_NUM_THREADS"]

    with ThreadPoolExecutor(8) as threads:
        assert set(threads.map(child, range(40))) == {"1"}
    assert os.environ["OMP_NUM_THREADS"] == "7"


def test_from_tasks_to_a_summary_and_nothing_is_run_twice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    arguments = ["--tasks", "1", "--knots", "24", "--out", str(tmp_path)]
    arguments += ["--max-seconds", "600", "--search-seconds", "600"]
    assert main([*arguments, "--methods", "drake", "casadi_mx"]) == 0
    rows = RunFile(tmp_path / "runs.csv", SOLVED).table
    assert list(rows.method) == [NO_METHOD, "drake", "casadi_mx"]
    assert rows.converged[0] and rows.iterations[1:].min() > 0 and (rows.build_s + rows.solve_s)[1:].min() > 0
    assert cells((tmp_path / "summary.md").read_text(), "drake")[1] == "1"
    before = (tmp_path / "runs.csv").read_bytes()
    monkeypatch.setattr(Worker, "call", refuse)
    assert main([*arguments, "--methods", "drake"]) == 0
    assert (tmp_path / "runs.csv").read_bytes() == before


def test_a_crash_is_a_row_and_other_settings_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def crash(*_: object, **__: object) -> Run:
        raise WorkerDied("the process ended")

    monkeypatch.setattr(Worker, "call", crash)
    settings = Settings()
    engine = solving_engine(tmp_path, settings)
    engine.run([solving_jobs(random_tasks(0, 1)[0], ["drake"], False, settings, tmp_path)])
    (run,) = engine.file.table.itertuples()  # without a guess there is nothing to solve
    assert (run.status, run.converged, run.verified, run.method) == ("crashed", False, False, NO_METHOD)
    with pytest.raises(RunsError, match="other settings"):
        solving_engine(tmp_path, Settings(n_knots=60))


def test_runs_are_left_out_where_the_run_that_they_need_failed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Worker, "call", here)
    keys = [("a", "open", "", method, 0) for method in ("first", "second", "third")]
    made = [Run(*keys[0], converged=True), Run(*keys[1], converged=True), Run(*keys[2])]
    needs = [None, (keys[0], "converged"), (keys[1], "verified")]
    jobs = [Job(run.key, partial(replace, run), need) for run, need in zip(made, needs, strict=True)]
    engine = Engine(RunFile(tmp_path / "runs.csv", SOLVED), int, 1.0)
    engine.run([jobs])
    assert list(engine.file.table.method) == ["first", "second"]


def test_bad_guesses_need_our_verified_plan(tmp_path: Path) -> None:
    (task,) = random_tasks(0, 1)
    jobs = solving_jobs(task, ["casadi_mx"], True, Settings(), tmp_path)
    ours = (*task.key, GUESS, "drake", 0)
    assert [job.key[3] for job in jobs[:3]] == [NO_METHOD, "casadi_mx", "drake"] and jobs[2].key == ours
    assert {job.needs for job in jobs[3:]} == {(ours, "verified")} and len({job.key for job in jobs}) == len(jobs)


@pytest.mark.parametrize("make", ["file", "foreign"])
def test_a_folder_that_cannot_hold_runs_is_one_line_and_exit_code_2(
    make: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    if make == "file":
        out.write_text("not a folder")
    else:
        out.mkdir()
        (out / "runs.csv").write_text("t,x,y\n")
    assert main(["--tasks", "1", "--out", str(out)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and str(out) in error


def test_bad_options_are_one_line_and_exit_code_2(capsys: pytest.CaptureFixture[str]) -> None:
    for bad in (["--tasks", "-1"], ["--max-seconds", "0"], ["--knots", "2"], ["--methods", "magic"]):
        with pytest.raises(SystemExit) as stop:
            main(bad)
        assert stop.value.code == 2 and capsys.readouterr().err.count("\n") == 1
