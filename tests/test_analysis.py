"""The analysis of the parameters: one thing varied at a time, the same tasks, and what is missing is said."""

from __future__ import annotations

import csv
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from benchmark_runs import MACHINE, cells, here, refuse, run_of, small_task

from drake_gnnocp.experiments.benchmark.methods import PAPER_PLAN, Method, planned
from drake_gnnocp.experiments.benchmark.runs import PLANNED, RunFile, table_of
from drake_gnnocp.experiments.benchmark.tasks import Task
from drake_gnnocp.experiments.benchmark.worker import Worker
from drake_gnnocp.experiments.reports import analysis_command as command_line
from drake_gnnocp.experiments.reports.analysis_command import NAMES, available, main
from drake_gnnocp.experiments.reports.curves import curve_rows, summary
from drake_gnnocp.experiments.reports.curves_picture import analysis_figure
from drake_gnnocp.experiments.reports.parameters import BASE, Parameter, Point, parameters
from drake_gnnocp.experiments.reports.report import Report
from drake_gnnocp.learning.checkpoint import save_weights
from drake_gnnocp.learning.configs import NetworkConfig
from drake_gnnocp.learning.modules import TrajectoryNetwork
from drake_gnnocp.learning.trainable import trained

TINY = NetworkConfig(width=16, heads=1, encoder_layers=1, proposer_layers=1, refinements=1, channels=8)
SOLVER = ("hypotheses", "knots", "lambda2", "gamma")  # parameters of the planner's options


@pytest.fixture
def task() -> Task:
    return small_task()


def parameter_of(*values: float, changes_cost: bool = False) -> Parameter:
    points = tuple(Point(value, "gnn", Method(f"m{value:g}", "gnn")) for value in values)
    return Parameter("knots", "knots", values[0], points, changes_cost)


def test_every_parameter_has_the_planners_default_and_changes_nothing_else() -> None:
    for name in SOLVER:
        parameter = parameters(Path())[name]
        usual = [point for point in parameter.points if point.value == parameter.default]
        assert usual and all(point.method.options == PAPER_PLAN for point in usual)
        assert len({(point.series, repr(point.method.options)) for point in parameter.points}) == len(parameter.points)
    by_value = {(p.series, p.value): p.method.options for p in parameters(Path())["lambda2"].points}
    options = by_value["gnn", 0.0]
    assert options.cost.lambda2 == 0.0 and replace(options, cost=PAPER_PLAN.cost) == PAPER_PLAN


def test_methods_of_one_name_are_one_method() -> None:
    seen: dict[str, Method] = {}
    for parameter in parameters(Path("training")).values():
        for point in parameter.points:
            assert seen.setdefault(point.method.name, point.method) == point.method
    assert seen["gnn default"].options.weights is None
    assert seen[BASE].weights == Path("training") / BASE / "best.safetensors"
    assert seen[f"{BASE} direct"].options.sqp is False


def test_a_plan_has_the_knots_that_are_asked_for(task: Task) -> None:
    point = next(p for p in parameters(Path())["knots"].points if p.value == 40 and p.series == "hybrid_astar")
    found = planned(task, point.method, 600.0)
    assert found.verified and found.trajectory is not None and len(found.trajectory) == 40


def test_curves_are_of_the_tasks_that_all_values_have_and_count_failures() -> None:
    runs = [run_of(name, "m30", total, cost=2.0) for name, total in (("a", 1.0), ("b", 3.0), ("only here", 50.0))]
    runs += [run_of("a", "m60", 2.0, cost=3.0, iterations=10), run_of("a", "another", 9.0)]
    runs.append(run_of("b", "m60", 4.0, verified=False, cost=math.nan, rounds=0, iterations=0))
    table = table_of(runs)
    usual, other = curve_rows(parameter_of(30, 60), table).itertuples()
    assert (usual.tasks, usual.verified, usual.total_s_median) == (2, 2, 2.0)
    assert (other.tasks, other.verified, other.solved, other.total_s_median) == (2, 1, 1, 3.0)
    assert other.iterations_median == 10  # what was never solved took no iterations, which is no merit
    assert (usual.cost_ratio_median, other.cost_ratio_median) == (1.0, 1.5)
    assert curve_rows(parameter_of(30, 60, changes_cost=True), table).cost_ratio_median.isna().all()
    assert curve_rows(parameter_of(30, 60, 120), table).empty


@pytest.mark.parametrize("name", NAMES)
def test_the_kept_runs_lead_to_the_kept_curves(name: str) -> None:
    folder = Path(__file__).parents[1] / "artifacts" / "paper" / "analysis"
    parameter = parameters(Path())[name]
    rows = curve_rows(parameter, RunFile(folder / "runs.csv", PLANNED).table)
    assert Report("", rows).csv == (folder / f"{name}.csv").read_text(encoding="utf-8")
    text = summary({name: (parameter, rows)}, MACHINE)
    assert text.split(MACHINE)[1].strip() in (folder / "summary.md").read_text(encoding="utf-8")


def test_the_summary_marks_the_default() -> None:
    parameter = parameter_of(30, 60)
    rows = curve_rows(parameter, table_of(run_of("a", f"m{value}", 2.0) for value in (30, 60)))
    text = summary({"knots": (parameter, rows)}, MACHINE)
    assert cells(text, "**30**")[1:6] == ["gnn", "1 (100 %)", "1", "30 / 30", "5 / 5"]
    assert cells(text, "60")[8:] == ["2.00 / 2.00", "0.10", "1.00"]
    assert MACHINE in text and "1 tasks." in text


def test_the_picture_shows_medians_and_shares_at_equal_distances() -> None:
    parameter = parameter_of(30, 60, 240)
    runs = [run_of(name, f"m{value}", value / 10.0) for name in ("a", "b") for value in (30, 60, 240)]
    runs[0] = replace(runs[0], verified=False)
    axes = analysis_figure([(parameter, curve_rows(parameter, table_of(runs)))]).axes
    lines = [[np.asarray(line.get_xydata()) for line in ax.lines] for ax in axes]
    times, shares = (next(line for line in of_panel if len(line) == 3) for of_panel in lines[1:])
    assert times.tolist() == [[0, 3.0], [1, 6.0], [2, 24.0]]
    assert shares.tolist() == [[0, 50.0], [1, 100.0], [2, 100.0]]
    assert axes[2].get_ylim()[0] <= 47.0


def test_values_without_their_network_are_skipped_with_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / BASE).mkdir()
    torch.manual_seed(0)
    save_weights(tmp_path / BASE / "best.safetensors", trained(TrajectoryNetwork(TINY)), {})
    found = available(parameters(tmp_path), ["points"])
    assert [(point.value, point.series) for point in found["points"].points] == [(30, "gnn"), (30, "gnn_direct")]
    assert len(found["share"].points) == 2 and len(found["knots"].points) == 12
    lines = capsys.readouterr().err.splitlines()
    assert lines[0].startswith(f"points 60: skipped: guess: 'gnn' needs trained weights: {tmp_path / 'points_60'}")
    assert {line.split(":")[0] for line in lines} == {"points 60", "points 120"}  # nobody asked for the others


def test_the_command_writes_curves_and_makes_nothing_twice(
    task: Task, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Worker, "call", here)
    monkeypatch.setattr(command_line, "drawn_tasks", lambda n: [task][:n])
    monkeypatch.setattr(command_line, "FORMATS", ("png",))
    arguments = ["hypotheses", "--training", str(tmp_path / "none"), "--max-seconds", "600", "--out", str(tmp_path)]
    assert main(arguments) == 0
    rows = list(csv.DictReader((tmp_path / "hypotheses.csv").read_text(encoding="utf-8").splitlines()))
    looked_at = ("1", "2", "4", "8", "12")
    assert [(row["value"], row["tasks"], row["verified"]) for row in rows] == [(n, "1", "1") for n in looked_at]
    assert {path.name for path in tmp_path.iterdir()} >= {"summary.md", "analysis.png", "runs.csv"}
    assert not (tmp_path / "knots.csv").exists()  # of which there is only the default
    before = (tmp_path / "runs.csv").read_bytes()
    monkeypatch.setattr(Worker, "call", refuse)
    assert main(arguments) == 0
    assert (tmp_path / "runs.csv").read_bytes() == before


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["magic"], f"must be one of {', '.join(NAMES)}, not 'magic'"),
        (["--tasks", "0"], "--tasks: must be a number of 1 or more, not '0'"),
        (["hypotheses", "--max-seconds", "-1"], "--max-seconds: must be 0 to 100000 seconds, not '-1'"),
        (["hypotheses", "--out", "taken"], "--out: taken"),
        (["hypotheses", "--out", "foreign"], "runs.csv: is not a file of runs"),
        (["points"], "points: nothing to vary"),
        (["knots", "--weights", "missing.safetensors"], "'gnn' needs trained weights: missing.safetensors: No such"),
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
    Path("foreign").mkdir()
    Path("foreign/runs.csv").write_text("t,x,y\n")
    try:
        code: object = main(arguments)
    except SystemExit as stop:  # argparse's way
        code = stop.code
    out, err = capsys.readouterr()
    last = [line for line in err.splitlines() if "skipped" not in line]
    assert code == 2 and out == "" and len(last) == 1 and message in last[0]
