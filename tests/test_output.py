"""What a command leaves behind: all of a plan or nothing, one line, and an exit code."""

from __future__ import annotations

import errno
import logging
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydrake.common import _drake_logger

from drake_gnnocp import Guess, NoGuess, Plan, Scenario, Straight, command_line, plan
from drake_gnnocp.budget import Budget
from drake_gnnocp.command_line import main, run_command
from drake_gnnocp.drake_log import drake_lines
from drake_gnnocp.files import replaced_together
from drake_gnnocp.pictures import save_plan_picture, save_states_picture
from drake_gnnocp.planner import planner
from drake_gnnocp.planner.planner import PlanInterrupted

NOT_WRITTEN, INTERRUPTED = 4, 130  # exit codes
FIELD = Scenario("field", np.zeros(3), np.array([12.0, 4.0, 0.4]))  # no obstacles


def contents(folder: Path) -> dict[str, bytes]:
    """The files of a folder by name; whatever else is in it, with nothing in it."""
    return {path.name: path.read_bytes() if path.is_file() else b"" for path in folder.iterdir()}


def write_that_fails_for(name: str, number: int) -> Callable[..., int]:
    """`Path.write_bytes`, but the disk is full, or what else an errno says, when a file of some name is written."""
    write = Path.write_bytes

    def write_bytes(path: Path, data: bytes) -> int:
        if name in path.name:
            write(path, data[: len(data) // 2])
            raise OSError(number, os.strerror(number), str(path))
        return write(path, data)

    return write_bytes


@pytest.fixture(scope="module")
def planned() -> Plan:
    """A plan in the field."""
    return plan(FIELD, "straight")


@pytest.mark.parametrize("name", ["scenario.json", "trajectory.csv", "result.json", "replay.html"])
def test_a_disk_that_is_full_leaves_the_older_plan_as_it_was(
    name: str, planned: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["empty_field", "--no-pictures", "--out", str(tmp_path)]) == 0
    (tmp_path / "replay.html").write_text("older")
    before = contents(tmp_path)
    capsys.readouterr()
    monkeypatch.setattr(command_line, "plan", lambda *_: planned)
    monkeypatch.setattr(Path, "write_bytes", write_that_fails_for(name, errno.ENOSPC))
    assert main(["empty_field", "--out", str(tmp_path)]) == NOT_WRITTEN
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("--out: ") and line.endswith("No space left on device")
    assert contents(tmp_path) == before


def test_a_folder_that_is_named_like_an_output_is_noticed_before_planning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(command_line, "plan", None)
    for name in ("result.json", "plan.png"):
        (tmp_path / name).mkdir()
        assert main(["empty_field", "--out", str(tmp_path)]) == NOT_WRITTEN
        assert capsys.readouterr().err == f"--out: {tmp_path / name}: Is a directory\n"
        (tmp_path / name).rmdir()
    assert contents(tmp_path) == {}


def test_a_folder_that_cannot_be_written_is_noticed_before_planning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refused(folder: Path, _: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied", str(folder))

    monkeypatch.setattr(command_line, "check_writable", refused)
    monkeypatch.setattr(command_line, "plan", None)
    assert main(["map_a", "--out", str(tmp_path)]) == NOT_WRITTEN
    assert capsys.readouterr().err == f"--out: {tmp_path}: Permission denied\n"


def test_files_that_belong_together_are_replaced_together_or_not_at_all(tmp_path: Path) -> None:
    for name in ("a", "b", "other"):
        (tmp_path / name).write_text("old")
    before = contents(tmp_path)
    with pytest.raises(KeyboardInterrupt), replaced_together(tmp_path, ("a", "b")) as stage:
        (stage / "a").write_text("new")
        raise KeyboardInterrupt
    assert contents(tmp_path) == before
    with replaced_together(tmp_path, ("a", "b")) as stage:
        (stage / "a").write_text("new")
    assert contents(tmp_path) == {"a": b"new", "other": b"old"}


def test_a_name_with_dollar_signs_is_drawn_as_it_is(planned: Plan, tmp_path: Path) -> None:
    for title in ("a$x^$b", r"$\frac{$", "$"):
        save_plan_picture(tmp_path / "plan.png", FIELD, planned.trajectory, None, title)
        assert planned.trajectory is not None
        save_states_picture(tmp_path / "states.png", planned.trajectory, FIELD.vehicle, None, title)


class PressesCtrlC:
    """A source whose second guess is Ctrl-C."""

    name = "own"
    proposes_many = False

    def __init__(self, first: Any) -> None:
        self._first = first

    def check_available(self) -> None:
        """Nothing is needed."""

    def guesses(self, scenario: Scenario, budget: Budget) -> Iterator[Guess | NoGuess]:
        """The first guess, and then none."""
        yield from self._first(scenario, budget)
        signal.raise_signal(signal.SIGINT)


def a_guess_that_fails(scenario: Scenario, budget: Budget) -> Iterator[Guess | NoGuess]:
    """A line through a wall that the next attempt would have gone around."""
    yield from Straight(60).guesses(scenario, budget)


@pytest.fixture
def heeding_ctrl_c() -> Iterator[None]:
    """Ctrl-C as in a terminal: jobs in the background are started without."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("heeding_ctrl_c")
def test_an_interrupted_plan_has_the_best_attempt_so_far(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(PlanInterrupted) as interruption:
        plan(FIELD, PressesCtrlC(lambda *_: iter([])))
    assert interruption.value.plan is None
    monkeypatch.setattr(planner.Schedule, "_is_done", False)
    with pytest.raises(PlanInterrupted) as interruption:
        plan(FIELD.translated(5.0, 0.0), PressesCtrlC(a_guess_that_fails))
    found = interruption.value.plan
    assert found is not None and found.trajectory is not None and found.trajectory.states[0, 0] == 5.0


def test_ctrl_c_writes_the_best_plan_so_far_or_says_that_there_is_none(
    planned: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted_with(found: Plan | None) -> Callable[..., Plan]:
        def interrupted(*_: object) -> Plan:
            raise PlanInterrupted(found)

        return interrupted

    command = ["empty_field", "--out", str(tmp_path)]
    monkeypatch.setattr(command_line, "plan", interrupted_with(planned))
    assert main(command) == INTERRUPTED
    assert capsys.readouterr().err == "interrupted: this is the best plan so far\n"
    assert {path.name for path in tmp_path.iterdir()} == {"scenario.json", "trajectory.csv", "guess.csv", "result.json"}
    before = contents(tmp_path)
    monkeypatch.setattr(command_line, "plan", interrupted_with(None))
    assert run_command(lambda: main(command)) == INTERRUPTED
    assert capsys.readouterr().err == "interrupted\n"
    assert contents(tmp_path) == before


def test_ctrl_c_while_ipopt_solves_ends_the_command_with_one_line(tmp_path: Path) -> None:
    code = """
import os, signal, sys, tempfile
signal.signal(signal.SIGINT, signal.default_int_handler)  # which jobs in the background are started without
from drake_gnnocp.command_line import main, run_command
from drake_gnnocp.ocp import nlp, rows
from drake_gnnocp.ocp.ipopt import IpoptSolver
tempfile.tempdir = sys.argv[1]
class Interrupted(IpoptSolver):
    def Solve(self, *arguments):
        signal.setitimer(signal.ITIMER_REAL, 0.02)
        signal.signal(signal.SIGALRM, lambda *_: os.kill(os.getpid(), signal.SIGINT))
        return super().Solve(*arguments)
from drake_gnnocp.ocp import ipopt
ipopt.IpoptSolver = Interrupted
sys.exit(run_command(lambda: main(["crowded_yard", "--guess", "straight", "--out", sys.argv[2]])))
"""
    scratch, out = tmp_path / "scratch", tmp_path / "out"
    scratch.mkdir()
    command = [sys.executable, "-c", code, str(scratch), str(out)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert (done.returncode, done.stderr) == (INTERRUPTED, "interrupted\n")
    assert contents(scratch) == {} and contents(out) == {}


def test_plans_of_several_threads_are_those_of_one(gate: Scenario) -> None:
    tasks = [gate.translated(10.0 * i, 0.0) for i in range(3)]
    alone = [plan(task).trajectory for task in tasks]
    with ThreadPoolExecutor(3) as threads:
        together = [result.trajectory for result in threads.map(plan, tasks)]
    for one, other in zip(alone, together, strict=True):
        assert one is not None and other is not None
        np.testing.assert_array_equal(one.states, other.states)


def test_a_thread_waits_for_the_plan_of_another_one(monkeypatch: pytest.MonkeyPatch) -> None:
    inside, most = [], []

    class Counted(planner.Schedule):
        def automatic(self) -> None:
            inside.append(self)
            most.append(len(inside))
            threading.Event().wait(0.02)
            super().try_source(Straight(30))
            inside.remove(self)

    monkeypatch.setattr(planner, "Schedule", Counted)
    with ThreadPoolExecutor(4) as threads:
        assert all(result.trajectory is not None for result in threads.map(plan, [FIELD] * 4))
    assert max(most) == 1


def test_lines_of_drake_go_to_the_logger_of_the_library(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.DEBUG), caplog.at_level(logging.DEBUG, "drake"):
        with drake_lines():
            _drake_logger.warning("a limit was hit")
        _drake_logger.warning("not of a plan")
    assert [(record.name, record.levelname) for record in caplog.records] == [
        ("drake_gnnocp.drake_log", "DEBUG"),
        ("drake", "WARNING"),
    ]


def test_a_folder_of_the_packages_name_hides_none_of_its_files(tmp_path: Path) -> None:
    (tmp_path / "drake_gnnocp").mkdir()
    command = [sys.executable, "-m", "drake_gnnocp.plan", "--list"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and "map_a" in done.stdout, done.stderr


def test_a_pipe_that_is_closed_is_no_traceback() -> None:
    command = f"{sys.executable} -m drake_gnnocp.plan --list | true; echo ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False, timeout=60)
    assert (done.stdout, done.stderr) == ("141\n", "")
