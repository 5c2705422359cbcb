"""The benchmark's runs: guesses on disk, numbers that add up, no run made twice."""

import math
import os
import re
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields, replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from drake_gnnocp import Trajectory
from drake_gnnocp.experiments.ocp_benchmark import benchmark
from drake_gnnocp.experiments.ocp_benchmark.benchmark import NO_METHOD, Job, Settings, random_tasks, run_benchmark
from drake_gnnocp.experiments.ocp_benchmark.command import main
from drake_gnnocp.experiments.ocp_benchmark.guesses import MadeGuess, load_guess, save_guess, with_noise
from drake_gnnocp.experiments.ocp_benchmark.runs import Run, RunsError, append_run, read_runs
from drake_gnnocp.experiments.ocp_benchmark.summary import PEER, summarise
from drake_gnnocp.experiments.ocp_benchmark.worker import Worker, WorkerDied, WorkerNotStarted
from drake_gnnocp.experiments.single_thread import single_threaded_children

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


def run_of(task: str, method: str, seconds: float, **changes: object) -> Run:
    times = (0.25 * seconds, 0.75 * seconds, 1.1 * seconds)
    run = Run("random, seed 0", task, GUESS, method, *times, 5, 20, 30, 2, 900, math.nan, 0.1, False, False, "", "")
    return replace(run, **changes)  # type: ignore[arg-type]


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
        run_of("b", "casadi_sx", 1.5, cost=4.0, converged=True, verified=False, faults="collides with an obstacle"),
    ]


def cells(summary: str, first: str) -> list[str]:
    line = re.search(rf"^\| {re.escape(first)} \|.*$", summary, re.MULTILINE)
    assert line is not None, summary
    return [cell.strip() for cell in line.group().strip("|").split("|")]


def test_the_summary_counts_failures_and_takes_the_peers_best(runs: list[Run]) -> None:
    summary = summarise(runs)
    assert "3 tasks; Hybrid A* found no guess in 1, which are left out (c)" in summary
    drake, peer = cells(summary, "drake"), cells(summary, PEER)
    assert drake[1:4] == ["2", "2", "2 (100 %)"] and drake[6] == "40 / 49"
    assert drake[11] == "2.10 / 3.09"  # build + solve of 1 s and 3.2 s
    assert peer[1:4] == ["2", "2", "1 (50 %)"] and peer[11] == "1.75 / 1.98"  # 2 s and 1.5 s: 1 s did not converge
    # 1 / 2 and 3.2 / 1.5; the percentiles are 3.09 and 1.975
    assert cells(summary, "attempted by both")[1:] == ["2", "1.32", "2.05", "1.56", "-"]
    assert cells(summary, "verified by both")[1:] == ["1", "0.50", "0.50", "0.50", "1.500"]


def test_the_summary_lists_bad_guesses_apart(runs: list[Run]) -> None:
    bad = [run_of(task, "drake", 2.0, verified=task == "a") for task in ("a", "b")]
    summary = summarise([*runs, *(replace(run, guess="noise 0.6 m") for run in bad)])
    assert cells(summary, "noise 0.6 m")[1:4] == ["2", "0", "1 (50 %)"]
    assert cells(summary, "drake")[1] == "2"


def test_rows_come_back_from_the_file_and_a_torn_one_is_dropped(tmp_path: Path, runs: list[Run]) -> None:
    path = tmp_path / "runs.csv"
    for run in runs:
        append_run(path, run)
    with path.open("a") as file:
        file.write('"random, seed 0",d,hybr')
    assert read_runs(path)[3:] == runs[3:]
    append_run(path, replace(runs[3], task="d"))
    assert [run.task for run in read_runs(path)[-2:]] == ["b", "d"]


@pytest.mark.parametrize("text", ["t,x,y\n1,2,3\n", "t,x,y\n1,2,3", "of something else"])
def test_another_file_is_not_taken_for_runs_and_stays_as_it_is(tmp_path: Path, text: str) -> None:
    path = tmp_path / "runs.csv"
    path.write_text(text)
    with pytest.raises(RunsError, match="not a file of runs"):
        read_runs(path)
    assert path.read_text() == text


@pytest.mark.parametrize("length", [0, 5])
def test_a_header_that_was_cut_off_is_a_file_without_runs(tmp_path: Path, length: int) -> None:
    (tmp_path / "runs.csv").write_text(",".join(field.name for field in fields(Run))[:length])
    assert read_runs(tmp_path / "runs.csv") == []


# ------------------------------------------------------------------------------------------------------ the whole thing


def test_a_worker_raises_what_its_function_raises_and_survives_a_crash() -> None:
    with Worker(int) as worker:
        assert worker.call(max, 1, 2, timeout=30.0) == 2
        with pytest.raises(ValueError, match="invalid literal"):
            worker.call(int, "x", timeout=30.0)
        with pytest.raises(WorkerDied):
            worker.call(os_exit, timeout=30.0)
        assert worker.call(threads, timeout=30.0) == "1"


def test_a_process_that_is_not_made_ready_is_no_crash_of_a_run() -> None:
    for first in (os_exit, partial(int, "x")):
        with Worker(first) as worker:
            for _ in range(2):  # and no call is ever made without it
                with pytest.raises(WorkerNotStarted):
                    worker.call(max, 1, 2, timeout=30.0)


def test_children_of_several_threads_have_one_thread_each_and_leave_the_environment(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "7")

    def child(_: int) -> str:
        with single_threaded_children():
            time.sleep(0.002)  # as starting one takes its time
            return os.environ["OMP_NUM_THREADS"]

    with ThreadPoolExecutor(8) as threads:
        assert set(threads.map(child, range(40))) == {"1"}
    assert os.environ["OMP_NUM_THREADS"] == "7"


def os_exit() -> None:
    import os

    os._exit(11)


def threads() -> str | None:
    import os

    return os.environ.get("OMP_NUM_THREADS")


def test_from_tasks_to_a_summary_and_nothing_is_run_twice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    arguments = ["--tasks", "1", "--knots", "24", "--max-seconds", "5", "--out", str(tmp_path)]
    assert main([*arguments, "--methods", "drake", "casadi_mx"]) == 0
    rows = read_runs(tmp_path / "runs.csv")
    assert [run.method for run in rows] == [NO_METHOD, "drake", "casadi_mx"]
    assert rows[0].converged and all(run.iterations > 0 and run.seconds > 0 for run in rows[1:])
    assert cells((tmp_path / "summary.md").read_text(), "drake")[1] == "1"

    def no_run(*_: object) -> Run:
        raise AssertionError("a run that is there was made again")

    monkeypatch.setattr(benchmark, "_in_worker", no_run)
    assert main([*arguments, "--methods", "drake"]) == 0
    assert read_runs(tmp_path / "runs.csv") == rows


def test_a_crash_is_a_row_and_other_settings_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def crash(*_: object, **__: object) -> Run:
        raise WorkerDied("the process ended")

    monkeypatch.setattr(Worker, "call", crash)
    (run,) = run_benchmark(random_tasks(0, 1), lambda _: ["drake"], False, Settings(), tmp_path)
    assert (run.status, run.converged, run.verified, run.method) == ("crashed", False, False, NO_METHOD)
    with pytest.raises(RunsError, match="other settings"):
        run_benchmark(random_tasks(0, 1), lambda _: ["drake"], False, Settings(n_knots=60), tmp_path)


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


def test_jobs_and_runs_have_the_same_keys(runs: list[Run]) -> None:
    (task,) = random_tasks(0, 1)
    assert Job(task, GUESS, "drake").key == replace(runs[3], task=task.name).key
