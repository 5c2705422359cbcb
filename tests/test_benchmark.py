"""The benchmark of the methods: rows, no run made twice, and a summary whose numbers follow from the rows."""

import json
import math
import re
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from benchmark_runs import PATIENT, cells, refuse, run_of

from drake_gnnocp import Scenario, Trajectory
from drake_gnnocp.experiments.benchmark import tasks as tasks_module
from drake_gnnocp.experiments.benchmark.disparity import disparity
from drake_gnnocp.experiments.benchmark.engine import Engine
from drake_gnnocp.experiments.benchmark.methods import method_named, planned, run_planner
from drake_gnnocp.experiments.benchmark.paper_table import PAPER
from drake_gnnocp.experiments.benchmark.planning import Settings, planning_engine, planning_jobs
from drake_gnnocp.experiments.benchmark.runs import PLANNED, Run, RunFile, RunsError, table_of
from drake_gnnocp.experiments.benchmark.tasks import TEST_MAPS, Task, drawn_tasks, named_tasks
from drake_gnnocp.experiments.benchmark.worker import Worker, WorkerDied
from drake_gnnocp.experiments.dataset.records import split_of
from drake_gnnocp.experiments.reports.planning import main, summarise
from drake_gnnocp.experiments.tasks.draw import kind_of
from drake_gnnocp.experiments.tasks.place import WIDE_KINDS
from drake_gnnocp.guesses.learned import bundled_weights
from drake_gnnocp.ocp import refine
from drake_gnnocp.ocp.ipopt import IpoptSettings

PAPER_TEX = Path(__file__).parents[2] / "shared" / "paper" / "paper.tex"
ROUNDING = 1e-9  # relative, sums of 120 doubles
METHOD_NAMES = {"Hybrid A*-OCP": "hybrid_astar", "RRT*-OCP": "rrt_star", "GNN-OCP": "gnn"}


def engine_of(folder: Path, method: str, settings: Settings) -> Engine:
    return planning_engine(folder, settings.methods([method]), settings)


def runs_in(path: Path) -> RunFile:
    return RunFile(path, PLANNED)


@pytest.fixture
def two_files(tmp_path: Path) -> list[str]:
    """Two tiny scenarios."""
    paths = [tmp_path / f"{name}.json" for name in ("near", "far")]
    for path, distance in zip(paths, (6.0, 9.0), strict=True):
        block = np.array([[0.0, 4.0], [5.0, 4.0], [5.0, 6.0]])
        Scenario(path.stem, np.zeros(3), np.array([distance, 0.0, 0.0]), (block,)).save(path)
    return [str(path) for path in paths]


def test_from_files_to_a_summary_and_nothing_is_run_twice(
    two_files: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    arguments = ["--methods", "hybrid_astar", "--max-seconds", "600", "--jobs", "2", "--out", str(out)]
    assert main([*two_files, *arguments]) == 0
    rows = runs_in(out / "runs.csv").table
    assert list(rows.scenario) == ["near", "far"] or list(rows.scenario) == ["far", "near"]  # whichever ends first
    assert set(rows.kind) == {"file"} and set(rows.method) == {"hybrid_astar"} and set(rows.repeat) == {0}
    assert rows.verified.all() and not rows.fallback.any() and set(rows.reason) == {""}
    spent = rows.guess_s + rows.build_s + rows.solve_s
    assert (spent > 0).all() and (spent <= rows.total_s).all()
    assert (rows.iterations >= rows.first_iterations).all() and rows.first_iterations.min() > 0 < rows.rounds.min()
    assert rows[["disparity_position", "duration_s", "clearance_m"]].min().min() > 0
    assert cells((out / "summary.md").read_text(), "near", "hybrid_astar")[8:10] == ["1/1", "0"]
    before = (out / "runs.csv").read_bytes()
    monkeypatch.setattr(Worker, "call", refuse)
    assert main([*two_files, *arguments]) == 0
    assert (out / "runs.csv").read_bytes() == before


def test_a_repeat_adds_runs_and_a_crash_is_a_row(
    two_files: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def crash(*_: object, **__: object) -> Run:
        raise WorkerDied("the process ended")

    monkeypatch.setattr(Worker, "call", crash)
    settings = Settings(7.0)
    for repeats in (1, 2):
        engine = engine_of(tmp_path, "hybrid_astar", settings)
        engine.run(planning_jobs(named_tasks(two_files[:1]), settings.methods(["hybrid_astar"]), repeats, settings))
        runs = engine.file.table
        assert list(runs.repeat) == list(range(repeats))
    assert set(runs.status) == {"crashed"} and not runs.verified.any() and set(runs.total_s) == {7.0}
    assert runs_in(tmp_path / "runs.csv").table.equals(runs)


def test_a_folder_keeps_its_settings_and_weights_by_their_content(tmp_path: Path) -> None:
    weights = tmp_path / "weights.safetensors"
    weights.write_bytes(b"1")
    engine_of(tmp_path, "hybrid_astar", Settings())
    engine_of(tmp_path, "gnn", Settings(weights=weights))  # another method is no other setting
    with pytest.raises(RunsError, match=r"other settings \(seed\)"):
        engine_of(tmp_path, "rrt_star", Settings(seed=1))
    weights.write_bytes(b"2")
    engine_of(tmp_path, "hybrid_astar", Settings(weights=weights))
    with pytest.raises(RunsError, match=r"other settings \(weights of gnn\)"):
        engine_of(tmp_path, "gnn", Settings(weights=weights))
    assert json.loads((tmp_path / "settings.json").read_text())["seed"] == 0


@pytest.mark.parametrize("method", ["gnn_direct", "hybrid_astar_direct"])
def test_a_direct_method_gives_its_first_guess_to_ipopt_without_sqp_steps(method: str) -> None:
    task = named_tasks(["map_c"])[0]
    run = run_planner(task, method_named(method), 0, PATIENT)
    assert run.verified and not run.fallback and run.convex_steps == 0 and run.first_iterations > 5
    assert run_planner(task, method_named(method.removesuffix("_direct")), 0, PATIENT).convex_steps > 0


def test_every_method_has_its_network() -> None:
    names = ("gnn", "gnn_paper", "gnn_direct", "auto", "hybrid_astar", "hybrid_astar_direct")
    methods = Settings(weights=Path("mine.safetensors")).methods(names)
    found = [(method.kind, method.source, method.weights) for method in methods]
    mine, paper = Path("mine.safetensors"), bundled_weights("paper")
    assert found[:3] == [("gnn", "gnn", mine), ("gnn", "gnn", paper), ("gnn", "gnn", mine)]
    assert found[3:] == [("auto", "gnn", mine), *(("hybrid_astar", "hybrid_astar", None),) * 2]


def test_a_direct_method_makes_one_attempt(monkeypatch: pytest.MonkeyPatch) -> None:
    solve = refine.solve_once
    given_up = IpoptSettings(max_iterations=1)
    monkeypatch.setattr(refine, "solve_once", lambda task, problem, _, budget: solve(task, problem, given_up, budget))
    monkeypatch.setattr(refine, "MOST_ANSWERS", 0)
    result = planned(named_tasks(["map_b"])[0], method_named("hybrid_astar_direct"), PATIENT)
    assert not result.verified and len(result.attempts) == 1


# ------------------------------------------------------------------------------------------------------------ the tasks


def test_random_tasks_are_on_test_maps_one_of_each_before_a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    assert len(TEST_MAPS) == 80 and {split_of(index) for index in TEST_MAPS} == {"test"}
    assert Counter(map(kind_of, TEST_MAPS)) == {"open": 54, "car_park": 13, "yard": 13}
    assert set(map(kind_of, TEST_MAPS[:7])) == set(WIDE_KINDS)
    monkeypatch.setattr(tasks_module, "TEST_MAPS", (9, 19, 29))
    tasks = drawn_tasks(4)
    maps_and_pairs = [task.scenario.name.split("_")[-2:] for task in tasks]
    assert maps_and_pairs == [["0009", "00"], ["0019", "00"], ["0029", "00"], ["0009", "01"]]
    assert all(task.scenario.name.startswith(task.kind) for task in tasks)
    assert len(drawn_tasks(1000)) <= 45


def test_two_files_of_one_name_are_refused(two_files: list[str], tmp_path: Path) -> None:
    other = tmp_path / "other.json"
    other.write_text(Path(two_files[0]).read_text())
    with pytest.raises(ValueError, match="other.json: name: another file's scenario is called 'near'"):
        named_tasks([two_files[0], two_files[0], str(other)])


# ---------------------------------------------------------------------------------------------------------- the numbers


def test_disparities_are_sums_over_the_knots_and_headings_wrap() -> None:
    t, n = np.linspace(0.0, 9.0, 120), 120
    optimum = Trajectory(t, np.zeros((n, 5)), np.zeros((n, 2)))
    guess = Trajectory(t, np.tile([3.0, 4.0, 2 * math.pi - 0.1, -0.5, 0.2], (n, 1)), np.zeros((n, 2)))
    off = disparity(guess, optimum)
    expected = [5.0 * n, 0.1 * n, 0.5 * n, 0.2 * n]
    np.testing.assert_allclose([off.position, off.theta, off.v, off.phi], expected, rtol=ROUNDING)
    assert math.isnan(disparity(guess, None).position)


def test_the_summary_of_random_tasks_counts_failures_and_compares_pairwise() -> None:
    nan = math.nan
    runs = [
        run_of("a", "hybrid_astar", 2.0, cost=2.0),
        run_of("b", "hybrid_astar", 4.0, kind="yard", cost=9.0),
        run_of("c", "hybrid_astar", 60.0, verified=False, iterations=0, first_iterations=0, cost=nan),
        run_of("a", "gnn", 1.0, iterations=15),
        run_of("b", "gnn", 4.0, kind="yard", fallback=True),
        run_of("c", "gnn", 3.0),
    ]
    summary = summarise(table_of(runs))
    ours = cells(summary, "all", "gnn")
    assert ours[2:5] == ["3", "3 (100 %)", "2 (67 %)"]
    assert ours[8] == "3.00 / 3.90"  # of 1, 3 and 4
    assert cells(summary, "all", "hybrid_astar")[2:5] == ["3", "2 (67 %)", "2 (67 %)"]
    # totals 1/2, 4/4, 3/60, the last of them not verified; iterations 15/30, 30/30; costs 3/2, 3/9
    found = cells(summary, "all", "gnn / hybrid_astar")
    assert [found[i] for i in (2, 4, 5, 6, 8, 9)] == ["3", "0.50", "0.75", "2", "0.75", "0.92"]
    yards = cells(summary, "yard", "gnn / hybrid_astar")
    assert [yards[i] for i in (2, 4, 5, 6, 8, 9)] == ["1", "1.00", "1.00", "1", "1.00", "0.33"]
    assert cells(summary, "random tasks", "gnn")[2:] == ["2", "4.00", "3.00", "2.00", "1.00", "0.10", "0.01"]


def test_the_papers_numbers_stand_beside_those_of_its_maps() -> None:
    runs = [run_of("map_a", "gnn", total, kind="library", repeat=i) for i, total in enumerate((1.0, 2.0, 6.0))]
    others = [run_of("map_a", "auto", 1.0, kind="library"), run_of("map_a", "gnn", 1.0, kind="file")]
    summary = summarise(table_of([*runs, *others]))
    row = cells(summary, "map_a", "gnn")
    assert row[2:9] == ["0.200", "0.695", "1.600", "6.652", "2.000", "8.347", "3/3"]
    assert cells(summary, "map_a", "auto")[3] == "-"


def test_the_papers_numbers_are_the_papers() -> None:
    if not PAPER_TEX.exists():
        pytest.skip("the paper is not here")
    found: dict[str, dict[str, tuple[float, ...]]] = {}
    for line in PAPER_TEX.read_text(encoding="utf-8").splitlines():
        if name := re.search(r"\{map\((.)\)\}", line):
            rows = found.setdefault(f"map_{name.group(1)}", {})
        if row := re.search(r"& *(\S.*?-OCP) *((?:&[^&]*\d\.\d+[^&]*){3})$", line):
            rows[METHOD_NAMES[row.group(1)]] = tuple(map(float, re.findall(r"\d+\.\d+", row.group(2))))
    assert found == PAPER


# ------------------------------------------------------------------------------------------------------------ bad input


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "SCENARIO, --tasks or --tight: nothing to plan"),
        (["map_z"], "map_z: scenario: neither a .json, .geojson, .dxf, .csv, .yaml or .yml file nor a bundled name"),
        (
            ["map_a", "--methods", "gnn", "--weights", "missing.safetensors"],
            "'gnn' needs trained weights: missing.safetensors: No such",
        ),
        (
            ["map_a", "--methods", "auto", "--weights", "missing.safetensors"],
            "'gnn' needs trained weights: missing.safetensors: No such",
        ),
        (["map_a", "--methods", "magic"], "invalid choice: 'magic'"),
        (["map_a", "--tasks", "-1"], "--tasks: must be a number of 0 or more, not '-1'"),
        (["map_a", "--repeat", "0"], "--repeat: must be a number of 1 or more, not '0'"),
        (["map_a", "--jobs", "two"], "--jobs: must be a number of 0 or more, not 'two'"),
        (["map_a", "--max-seconds", "nan"], "--max-seconds: must be 0 to 100000 seconds, not 'nan'"),
        (["map_a", "--methods", "hybrid_astar", "--out", "taken"], "--out: taken: File exists"),
        (["map_a", "--methods", "hybrid_astar", "--out", "foreign"], "runs.csv: is not a file of runs"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(
    arguments: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(Engine, "run", refuse)
    monkeypatch.chdir(tmp_path)
    Path("taken").write_text("a file")
    Path("foreign").mkdir()
    Path("foreign/runs.csv").write_text("t,x,y\n")
    try:
        code: object = main(arguments)
    except SystemExit as stop:  # argparse's way
        code = stop.code
    out, err = capsys.readouterr()
    assert code == 2 and out == ""
    assert err.count("\n") == 1 and message in err


def test_tasks_are_told_apart_by_where_they_are_from() -> None:
    scenario = named_tasks(["map_a"])[0].scenario
    assert Task(scenario, "library").key != Task(scenario, "file").key
