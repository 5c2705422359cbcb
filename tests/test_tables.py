"""The paper's comparisons: numbers that follow from the runs, nothing made twice, and what is missing is said."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch
from benchmark_runs import MACHINE, PATIENT, cells, csv_row, here, refuse, run_of, small_task

from drake_gnnocp import Trajectory
from drake_gnnocp.experiments.benchmark.methods import Method, method_named, network_method
from drake_gnnocp.experiments.benchmark.planning import Settings
from drake_gnnocp.experiments.benchmark.runs import GUESSED, PLANNED, Run, RunFile, RunsError, table_of
from drake_gnnocp.experiments.benchmark.tasks import Task
from drake_gnnocp.experiments.benchmark.worker import Worker
from drake_gnnocp.experiments.reports import inference
from drake_gnnocp.experiments.reports import tables_command as command_line
from drake_gnnocp.experiments.reports.comparison import map_report, unseen_report
from drake_gnnocp.experiments.reports.raw_guesses import measure, nearest, raw_report
from drake_gnnocp.experiments.reports.report import Report
from drake_gnnocp.experiments.reports.tables_command import TABLES, main
from drake_gnnocp.learning.checkpoint import save_weights
from drake_gnnocp.learning.configs import PaperConfig
from drake_gnnocp.learning.paper_network import PaperNetwork
from drake_gnnocp.learning.trainable import trained

ROUNDING = 1e-9  # m, of sums of 120 doubles


@pytest.fixture
def task() -> Task:
    return small_task()


@pytest.fixture
def untrained(tmp_path: Path) -> Method:
    """The paper's network as it is before training."""
    torch.manual_seed(0)
    save_weights(tmp_path / "paper.safetensors", trained(PaperNetwork(PaperConfig(hidden=16))), {})
    return network_method("gnn_paper", tmp_path / "paper.safetensors", False)


def test_ratios_on_a_map_are_those_of_the_same_repeat_beside_the_papers() -> None:
    runs = [run_of("map_a", "gnn", total, kind="library", repeat=i) for i, total in enumerate((1.0, 2.0, 4.0))]
    others = [run_of("map_a", "rrt_star", t, kind="library", repeat=i) for i, t in enumerate((3.0, 10.0, 8.0))]
    made = map_report(table_of([*runs, replace(others[0], verified=False), *others[1:]]), MACHINE)
    row = csv_row(made, scenario="map_a", method="rrt_star")
    assert (row["runs"], row["verified"], row["total_s"], row["total_paper_s"]) == ("3", "2", "8", "23.808")
    assert float(row["total_ratio"]) == 3.0  # of 3, 5 and 2
    assert float(row["total_paper_ratio"]) == pytest.approx(23.808 / 8.347, rel=1e-4)
    assert cells(made.markdown, "map_a", "rrt_star")[6:9] == ["8.000", "23.808", "2/3"]
    assert csv_row(made, method="gnn")["planning_ratio"] == "1" and MACHINE in made.markdown


def test_unseen_tasks_are_compared_task_by_task_and_failures_are_counted() -> None:
    names = ("a", "b", "c")
    runs = [run_of(name, "gnn", total, cost=2.0) for name, total in zip(names, (1.0, 2.0, 9.0), strict=True)]
    runs += [run_of(name, "hybrid_astar", 4.0, cost=3.0) for name in names]
    runs[2] = replace(runs[2], verified=False, cost=math.nan)
    made = unseen_report(table_of(runs), MACHINE)
    row = csv_row(made, method="hybrid_astar")
    assert (row["all_pairs"], row["both_pairs"], row["both_cost_ratio_median"]) == ("3", "2", "1.5")
    assert float(row["all_total_ratio_median"]) == 2.0 and float(row["both_total_ratio_median"]) == 3.0
    assert float(row["both_total_ratio_p95"]) == pytest.approx(3.9)  # of 2 and 4
    steps = replace(run_of("a", "gnn", 1.0), convex_steps=3, first_iterations=4)
    assert csv_row(unseen_report(table_of([steps]), MACHINE), method="gnn")["first_steps_median"] == "7"
    row = csv_row(made, method="gnn")
    assert (row["attempted"], row["verified"], row["compared"]) == ("3", "2", "2")
    assert "3 tasks" in made.markdown and cells(made.markdown, "gnn")[2] == "2 (66.7 %)"


def test_a_guess_is_held_against_the_nearest_optimum() -> None:
    def line(y: float, knots: int) -> Trajectory:
        states = np.zeros((knots, 5))
        states[:, 0], states[:, 1] = np.linspace(0.0, 8.0, knots), y
        return Trajectory(np.linspace(0.0, 9.0, knots), states, np.zeros((knots, 2)))

    assert nearest(line(0.0, 120), [line(5.0, 240), line(-2.0, 60)]) == pytest.approx(2.0, abs=ROUNDING)
    assert math.isnan(nearest(line(0.0, 120), [])) and math.isnan(nearest(None, [line(1.0, 120)]))


def test_raw_guesses_are_measured_whether_or_not_they_lead_to_a_plan(
    task: Task, untrained: Method, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Worker, "call", here)
    methods = [method_named("hybrid_astar"), untrained]
    rows = measure(tmp_path, [task], methods, Settings(PATIENT))
    search, network = rows.itertuples()
    assert (search.method, network.method) == ("hybrid_astar", "gnn_paper")
    assert search.optima == network.optima >= 1
    assert 0 < search.position_error_m < 1.0 and search.guess_gap_m < 0.01 and search.guess_blocked == 0.0
    assert network.guess_gap_m > 5 * search.guess_gap_m  # nothing was learnt, and nothing of it is a motion of the car
    assert RunFile(tmp_path / "guesses.csv", GUESSED).table.equals(rows)
    monkeypatch.setattr(Worker, "call", refuse)
    assert measure(tmp_path, [task], methods, Settings(PATIENT)).equals(rows)
    with pytest.raises(RunsError, match=r"other settings \(methods\)"):  # with fewer of them, fewer optima are known
        measure(tmp_path, [task], methods[:1], Settings(PATIENT))


def test_raw_guesses_are_summed_up_by_method_without_those_that_were_not_made() -> None:
    def guess(name: str, method: str, optima: int, error: float, blocked: float, gap: float) -> Run:
        run = Run(name, "open", "", method, 0, optima=optima)
        return replace(run, position_error_m=error, guess_blocked=blocked, guess_gap_m=gap)

    nan = math.nan
    rows = [guess(name, "gnn", 2, error, 0.0, 0.5) for name, error in (("a", 1.0), ("b", 3.0))]
    rows += [guess("c", "gnn", 0, nan, 0.5, 0.5), guess("d", "hybrid_astar", 1, nan, nan, nan)]
    made = raw_report(table_of(rows), MACHINE)
    assert cells(made.markdown, "gnn")[1:] == ["3", "3", "2", "2.00 / 2.90", "0.00 / 0.45", "2", "0.500 / 0.500"]
    assert cells(made.markdown, "hybrid_astar")[1:5] == ["1", "0", "0", "-"]
    assert csv_row(made, method="gnn")["position_error_m_mean"] == "2"
    assert csv_row(made, method="hybrid_astar")["gap_m_median"] == ""


@pytest.mark.parametrize("name", ["table", "test_tasks", "raw_guesses"])
def test_the_tables_are_of_the_weights_that_come_with_the_package_and_can_be_gone_on_with(name: str) -> None:
    folder = Path(__file__).parents[1] / "artifacts" / "paper" / "runs" / name
    found = json.loads((folder / "settings.json").read_text(encoding="utf-8"))
    settings = Settings(TABLES[name].max_seconds)
    wanted = settings.to_dict(settings.methods(TABLES[name].methods))
    assert {key: found.get(key) for key in wanted} == wanted


@pytest.mark.parametrize(
    ("name", "file", "report"),
    [
        ("table", ("runs.csv", PLANNED), map_report),
        ("test_tasks", ("runs.csv", PLANNED), unseen_report),
        ("raw_guesses", ("guesses.csv", GUESSED), raw_report),
    ],
)
def test_the_kept_runs_lead_to_the_kept_tables(
    name: str, file: tuple[str, list[str]], report: Callable[[pd.DataFrame, str], Report]
) -> None:
    folder = Path(__file__).parents[1] / "artifacts" / "paper"
    made = report(RunFile(folder / "runs" / name / file[0], file[1]).table, MACHINE)
    assert made.csv == (folder / f"{name}.csv").read_text(encoding="utf-8")
    kept = (folder / f"{name}.md").read_text(encoding="utf-8")
    assert made.markdown.split(MACHINE)[1] == kept.split(" cores.\n")[1]


def test_inference_is_timed_from_the_scenario_to_the_first_guess(
    task: Task, untrained: Method, monkeypatch: pytest.MonkeyPatch
) -> None:
    now, waits = [0.0], iter((0.03, 0.001, 0.03))

    def guess(*_: object) -> None:
        now[0] += next(waits)

    monkeypatch.setattr(Worker, "call", here)
    monkeypatch.setattr(inference, "network_guess", guess)
    monkeypatch.setattr(inference, "first_guesses", partial(inference.first_guesses, clock=lambda: now[0]))
    runs = inference.measure([task], [untrained], 3)
    row = csv_row(inference.inference_report(runs, MACHINE), method="gnn_paper")
    assert [row[name] for name in ("tasks", "runs", "ms_median", "quickest_ms_median")] == ["1", "3", "30", "1"]


def test_the_command_leaves_out_methods_without_weights_and_makes_nothing_twice(
    task: Task, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    missing = network_method("gnn_paper", tmp_path / "missing.safetensors", False)
    monkeypatch.setattr(Worker, "call", here)
    monkeypatch.setattr(command_line, "drawn_tasks", lambda n: [task][:n])
    monkeypatch.setattr(Settings, "methods", lambda *_: [method_named("hybrid_astar"), missing])
    arguments = ["test_tasks", "raw_guesses", "--max-seconds", "600", "--out", str(tmp_path)]
    assert main(arguments) == 0
    assert "gnn_paper: left out: guess: 'gnn' needs trained weights" in capsys.readouterr().err
    for name in ("test_tasks", "raw_guesses"):
        assert "hybrid_astar" in (tmp_path / f"{name}.md").read_text(encoding="utf-8")
        assert (tmp_path / f"{name}.csv").read_text(encoding="utf-8").count("\n") == 2
    before = (tmp_path / "test_tasks.csv").read_bytes()
    assert main(arguments) == 0
    assert (tmp_path / "test_tasks.csv").read_bytes() == before


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["magic"], f"must be one of {', '.join(TABLES)}, not 'magic'"),
        (["--tasks", "0"], "--tasks: must be a number of 1 or more, not '0'"),
        (["table", "--weights", "missing.safetensors"], "'gnn' needs trained weights: missing.safetensors: No such"),
        (["table", "--out", "taken"], "--out: taken"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(
    arguments: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("taken").write_text("a file")
    try:
        code: object = main(arguments)
    except SystemExit as stop:  # argparse's way
        code = stop.code
    out, err = capsys.readouterr()
    assert code == 2 and out == "" and err.count("\n") == 1 and message in err
