"""Many scenarios in one command: rows for all, resumed, and no task that takes others with it."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys
import time
import types
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drake_gnnocp import Scenario, batch, command_line, plan
from drake_gnnocp.batch import DIED, MARK, Batch, Row, Task, mark, outcomes, sources_of, summary, table
from drake_gnnocp.command_line import main

BAD_INPUT, NOT_VERIFIED, NOT_WRITTEN, INTERRUPTED = 2, 3, 4, 130  # exit codes
FIELD = Scenario("field", np.zeros(3), np.array([6.0, 0.0, 0.0]))
PATIENT = 60.0  # s, for processes to start on a busy machine


@contextmanager
def threads(jobs: int, dask: str | None) -> Iterator[Executor]:
    """In place of processes."""
    assert dask is None
    with ThreadPoolExecutor(jobs) as executor:
        yield executor


@pytest.fixture
def in_threads(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Batches work in threads and plan straight lines; gives the names of the scenarios as they are planned."""
    planned: list[str] = []

    def straight(scenario: Scenario, *_: object) -> Any:
        planned.append(scenario.name)
        return plan(scenario, "straight")

    monkeypatch.setattr(batch, "workers", threads)
    monkeypatch.setattr(command_line, "plan", straight)
    return planned


@pytest.fixture
def yard_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder `yards` with two scenarios and a file that is none; work beside it."""
    folder = tmp_path / "yards"
    folder.mkdir()
    for name, x in (("north", 5.0), ("south", 7.0)):
        Scenario(name, np.zeros(3), np.array([x, 0.0, 0.0])).save(folder / f"{name}.json")
    (folder / "notes.txt").write_text("not a scenario")
    monkeypatch.chdir(tmp_path)
    return folder


def summary_of(folder: Path) -> list[dict[str, str]]:
    """The rows of summary.csv."""
    with (folder / "summary.csv").open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.usefixtures("in_threads")
def test_a_folder_is_planned_file_by_file_into_folders_of_their_names(
    yard_files: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(yard_files), "empty_field", "--no-pictures", "--out", "plans"]) == 0
    heading, *lines, last = capsys.readouterr().out.splitlines()
    assert heading.split() == ["name", "status", "seconds", "cost", "clearance", "guess"]
    assert [line.split()[:2] for line in lines] == [[name, "verified"] for name in ("north", "south", "empty_field")]
    assert last == "written to plans"
    files = {"scenario.json", "trajectory.csv", "guess.csv", "result.json", MARK}
    for row, x in zip(summary_of(Path("plans"))[:2], (5.0, 7.0), strict=True):
        folder = Path(row["folder"])
        assert {path.name for path in folder.iterdir()} == files
        assert json.loads((folder / "scenario.json").read_text())["goal"][0] == x
        result = json.loads((folder / "result.json").read_text())
        assert float(row["cost"]) == result["cost"]["J"] and row["guess"] == "straight"


def test_finished_scenarios_are_planned_again_only_where_something_has_changed(
    yard_files: Path, in_threads: list[str]
) -> None:
    def planned(*options: str) -> list[str]:
        in_threads.clear()
        assert main([str(yard_files), "--jobs", "1", "--no-pictures", "--out", "plans", *options]) == 0
        return in_threads

    assert planned() == ["north", "south"]
    before = (Path("plans") / "summary.csv").read_bytes()
    assert planned() == [] and (Path("plans") / "summary.csv").read_bytes() == before
    Scenario("south", np.zeros(3), np.array([7.5, 0.0, 0.0])).save(yard_files / "south.json")
    assert planned() == ["south"]
    (Path("plans") / "north" / "guess.csv").unlink()
    assert planned() == ["north"]
    (Path("plans") / "north" / "result.json").write_text('{"status": "veri')
    assert planned() == ["north"]
    assert planned("--clearance", "0.1") == ["north", "south"]
    assert planned("--rate", "20") == ["north", "south"] and planned("--rate", "20") == []
    assert planned("--again") == ["north", "south"]
    assert main(["empty_field", "--no-pictures", "--out", "plans/north"]) == 0  # which is not the batch's
    assert planned() == ["north"]


def test_bad_input_is_a_row_and_the_others_are_planned(
    yard_files: Path, in_threads: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    (yard_files / "middle.json").write_text('{"name": "middle", "goal": [9, 0, 0], "obstacles": []}')
    command = [str(yard_files), "nothing.json", "--jobs", "1", "--no-pictures", "--out", "plans"]
    assert main(command) == BAD_INPUT
    assert in_threads == ["north", "south"]
    rows = {row["name"]: row for row in summary_of(Path("plans"))}
    assert rows[f"{yard_files}/middle.json"]["reason"].startswith("start: missing")
    assert rows["nothing.json"]["status"] == "bad input" and rows["nothing.json"]["folder"] == ""
    assert "nothing.json" in capsys.readouterr().out


def test_what_cannot_be_written_is_a_row_and_exit_code_4(
    yard_files: Path, in_threads: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    Path("plans").mkdir()
    Path("plans/north").write_text("a file where the folder is to be")
    assert main([str(yard_files), "--jobs", "1", "--no-pictures", "--out", "plans"]) == NOT_WRITTEN
    assert in_threads == ["north", "south"]
    north, south = summary_of(Path("plans"))
    assert (north["status"], north["folder"], south["status"]) == ("not written", "", "verified")
    assert north["reason"] == "plans/north: File exists"
    assert main([str(yard_files), "nothing.json", "--no-pictures", "--out", "plans"]) == BAD_INPUT


def test_one_bad_name_among_several_is_no_reason_to_stop(in_threads: list[str], tmp_path: Path) -> None:
    assert main(["empty_field", "a_second_scenario", "--no-pictures", "--out", str(tmp_path)]) == BAD_INPUT
    assert in_threads == ["empty_field"]


def test_a_folder_without_scenarios_is_bad_input(in_threads: list[str], tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    assert main([str(tmp_path / "empty"), "empty_field", "--no-pictures", "--out", str(tmp_path)]) == BAD_INPUT
    assert in_threads == ["empty_field"]
    assert summary_of(tmp_path)[0]["reason"].startswith("scenario: neither a .json, .geojson, .dxf, .csv, .yaml")


def test_plans_that_are_not_verified_are_exit_code_3(
    yard_files: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(batch, "workers", threads)
    wall = np.array([[3.5, -90.0], [4.0, -90.0], [4.0, 90.0], [3.5, 90.0]]) + [3.0, 0.0]
    bounds = (-5.0, 20.0, -5.0, 5.0)
    Scenario("wall", np.zeros(3), np.array([14.0, 0.0, 0.0]), (wall,), bounds).save(yard_files / "wall.json")
    assert main([str(yard_files / "wall.json"), "empty_field", "--no-pictures", "--out", "plans"]) == NOT_VERIFIED
    row, other = summary_of(Path("plans"))
    assert row["status"] == "no_path" and "no path" not in other["status"]
    assert row["reason"] and row["reason"] in capsys.readouterr().out


@pytest.mark.usefixtures("in_threads")
def test_a_rate_that_is_not_verified_is_told_in_the_row_also_when_it_is_resumed(yard_files: Path) -> None:
    for _ in range(2):
        command = [str(yard_files), "--rate", "0.001", "--no-pictures", "--out", "plans"]
        assert main(command) == NOT_VERIFIED
        assert all(row["reason"].startswith("--rate: rows at 0.001 Hz") for row in summary_of(Path("plans")))


@pytest.mark.usefixtures("in_threads")
def test_scenarios_of_one_name_get_folders_of_their_own(yard_files: Path, capsys: pytest.CaptureFixture[str]) -> None:
    FIELD.save("one.json")
    FIELD.translated(3.0, 0.0).save("two.json")
    assert main(["one.json", "--no-pictures", "two.json", "--out", "plans"]) == 0
    assert capsys.readouterr().err == "field: the name is taken; this one is written to plans/field_2\n"
    assert [row["name"] for row in summary_of(Path("plans"))] == ["field", "field_2"]
    assert json.loads(Path("plans/field_2/scenario.json").read_text())["start"][0] == 3.0


@pytest.mark.usefixtures("in_threads")
def test_an_option_of_batches_makes_a_batch_of_one(yard_files: Path) -> None:
    """A pattern of the shell that matches one file writes what it writes for several."""
    assert main([str(yard_files / "north.json"), "--jobs", "2", "--no-pictures", "--out", "plans"]) == 0
    assert Path("plans/north/result.json").exists() and Path("plans/summary.csv").exists()


def test_bad_options_of_a_batch_are_refused_before_planning(
    in_threads: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["map_a", "map_b", "--max-seconds", "-1"]) == BAD_INPUT
    assert capsys.readouterr().err == "--max-seconds: must be positive, not -1\n"
    Path("taken").write_text("")
    assert main(["map_a", "map_b", "--out", "taken"]) == BAD_INPUT
    assert capsys.readouterr().err == "--out: taken: File exists\n"
    assert in_threads == [] and [path.name for path in tmp_path.iterdir()] == ["taken"]


def test_sources_are_in_the_order_given_and_folders_sorted(yard_files: Path) -> None:
    (yard_files / "a.CSV").write_text("")
    found = sources_of(["map_b", "yards", "x.json"])
    assert found == ["map_b", "yards/a.CSV", "yards/north.json", "yards/south.json", "x.json"]


def test_a_fault_of_one_task_is_its_row(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def plan_into(scenario: Scenario, folder: Path, options: Mapping[str, Any]) -> None:
        raise RuntimeError("two\nlines")

    monkeypatch.setattr(batch, "workers", threads)
    rows, interrupted = Batch(tmp_path, plan_into, {}).run(["x"], lambda _: FIELD)
    assert not interrupted
    assert rows == [Row("field", "error", reason="RuntimeError: two")]


def test_ctrl_c_keeps_what_is_finished(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    result = plan(FIELD, "straight")

    def plan_into(scenario: Scenario, folder: Path, options: Mapping[str, Any]) -> None:
        result.save(folder)
        (folder / MARK).write_text(mark(options, ["trajectory.csv"], ""))

    def interrupted_at_the_second(
        tasks: list[Task], job: Callable[[Task], str], *_: object
    ) -> Iterator[tuple[Task, str]]:
        yield tasks[0], job(tasks[0])
        (tasks[1].folder / ".tmp123").mkdir(parents=True)  # what a process that dies leaves
        raise KeyboardInterrupt

    monkeypatch.setattr(batch, "outcomes", interrupted_at_the_second)
    rows, interrupted = Batch(tmp_path, plan_into, {"a": (1, 2)}).run(["x", "y", "z"], lambda _: FIELD)
    assert interrupted and [(row.name, row.status) for row in rows] == [("field", "verified")]
    assert {path.name for path in tmp_path.iterdir()} == {".lock", "field", "summary.csv"}
    assert len(summary_of(tmp_path)) == 1


def test_another_batch_in_the_folder_is_not_disturbed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with batch.locked(tmp_path):
        assert main(["map_a", "map_b", "--out", str(tmp_path)]) == BAD_INPUT
    assert "another run is at work here" in capsys.readouterr().err


def test_a_table_leaves_out_what_is_not_known() -> None:
    rows = [Row("a", "verified", 1.234, 5.678, None, "gnn", "out/a"), Row("b.json", "bad input", reason="why")]
    heading, first, second = table(rows)
    assert first.split() == ["a", "verified", "1.23", "5.68", "gnn"]
    assert second.split() == ["b.json", "bad", "input", "why"]
    assert heading.index("guess") == first.index("gnn")
    assert summary(rows).splitlines()[2] == "b.json,bad input,,,,,,why"


def lasts_until_another_dies(task: Task) -> Row:
    """A job that ends its process where the task is called so, once the one called long is at work."""
    begun = task.folder.parent / "begun"
    if task.scenario.name == "deadly":
        while not begun.exists():
            time.sleep(0.01)
        os.kill(os.getpid(), signal.SIGKILL)
    if task.scenario.name == "long" and not begun.exists():
        begun.touch()
        time.sleep(PATIENT)
    return Row(task.scenario.name, "done", reason=f"by {os.environ['OMP_NUM_THREADS']}")


def test_a_process_that_dies_takes_no_other_task_with_it(tmp_path: Path) -> None:
    tasks = [Task(Scenario(name, FIELD.start, FIELD.goal), tmp_path / name) for name in ("long", "deadly", "b", "c")]
    rows = {task.scenario.name: row for task, row in outcomes(tasks, lasts_until_another_dies, 2, None)}
    found = {name: (row.status, row.reason) for name, row in rows.items() if row is not None}
    done = ("done", "by 1")
    assert found == {"long": done, "b": done, "c": done, "deadly": ("error", DIED)}


def test_a_cluster_does_the_same_tasks(yard_files: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    addresses: list[str] = []

    class Client:
        def __init__(self, address: str) -> None:
            if address != "tcp://here:1":
                raise OSError("no answer\nat all")
            addresses.append(address)

        def __enter__(self) -> Client:
            return self

        def __exit__(self, *_: object) -> None:
            pass

        def get_executor(self, pure: bool) -> Executor:
            assert not pure
            return ThreadPoolExecutor(1)

    monkeypatch.setitem(sys.modules, "distributed", types.SimpleNamespace(Client=Client))
    monkeypatch.setattr(command_line, "plan", lambda scenario, *_: plan(scenario, "straight"))
    assert main([str(yard_files), "--dask", "tcp://here:1", "--no-pictures", "--out", "plans"]) == 0
    assert addresses == ["tcp://here:1"]
    assert all(Path(row["folder"]).is_absolute() for row in summary_of(Path("plans")))  # workers may be elsewhere


def test_a_cluster_that_is_not_there_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)  # as if not installed
    assert main(["map_a", "map_b", "--dask", "tcp://x:1", "--out", str(tmp_path)]) == BAD_INPUT
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("--dask: tcp://x:1: ")


@pytest.mark.slow
def test_a_batch_in_processes_is_interrupted_and_goes_on(yard_files: Path) -> None:
    names = [f"field_{i}" for i in range(8)]
    for name in names:
        Scenario(name, np.zeros(3), np.array([12.0, 4.0, 0.4])).save(yard_files / f"{name}.json")
    command = [sys.executable, "-m", "drake_gnnocp.plan", "yards", "--jobs", "2", "--out", "plans"]
    running = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, process_group=0)
    begin = time.monotonic()
    while not list(Path("plans").glob("*/result.json")) and time.monotonic() - begin < PATIENT:
        time.sleep(0.05)
    running.send_signal(signal.SIGINT)  # to the command alone: it ends its processes
    _, err = running.communicate(timeout=PATIENT)
    assert running.returncode == INTERRUPTED
    (line,) = err.splitlines()
    done = len(summary_of(Path("plans")))
    assert line == f"interrupted: {done} of 10 are done; the same command goes on" and 1 <= done < 10
    assert not list(Path("plans").glob("*/.tmp*"))
    times = {path: path.stat().st_mtime_ns for path in Path("plans").glob("*/result.json")}
    again = subprocess.run(command, capture_output=True, text=True, timeout=2 * PATIENT, check=True)
    assert again.stderr == "" and len(summary_of(Path("plans"))) == 10
    assert all(path.stat().st_mtime_ns == before for path, before in times.items())
