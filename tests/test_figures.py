"""The paper's figures: every one is drawn, or skipped with a reason; made-up plans stand for the solver's."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from matplotlib.figure import Figure
from matplotlib.image import imread
from matplotlib.text import Text

from drake_gnnocp.experiments.benchmark.disparity import N_COMPARED
from drake_gnnocp.experiments.figures import command as command_line
from drake_gnnocp.experiments.figures import plans as plans_module
from drake_gnnocp.experiments.figures.command import FIGURES, main
from drake_gnnocp.experiments.figures.comparison import MISSING, UNVERIFIED, disparity_figure, distances
from drake_gnnocp.experiments.figures.interpolation import interpolation_figure, turns
from drake_gnnocp.experiments.figures.plans import ROUNDS, Plans, Skipped, Solved
from drake_gnnocp.experiments.figures.sheet import PAGE
from drake_gnnocp.guesses import learned, rrt_star
from drake_gnnocp.learning.checkpoint import save_weights
from drake_gnnocp.learning.configs import NetworkConfig
from drake_gnnocp.learning.modules import TrajectoryNetwork
from drake_gnnocp.learning.trainable import trained
from drake_gnnocp.pictures.style import DPI
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import Input, State

DIAGRAMS = ("framework", "network", "vectorisation", "vehicle", "triangle_area")
FROM_PLANS = tuple(name for name in FIGURES if name not in DIAGRAMS)
WIDEST = (PAGE + 0.3) * DPI  # pixels: the page, and what is put around a figure
QUICK_DPI = 60
LEAST_INK = 0.01  # share of pixels that are not white: less is an empty sheet
LEAST_LETTERS = 7.0  # points, in print
OFFSET = (0.3, 0.4)  # m, of made-up guesses: 0.5 m away
SUM_ERROR = 1e-9  # m (and rad), of sums of doubles
ARC = 1e-3  # relative: steps of an arc are chords


def make_network(path: Path, points: int) -> Path:
    """Weights of a small untrained network."""
    torch.manual_seed(0)
    network = TrajectoryNetwork(NetworkConfig(points=points, width=16, channels=16, encoder_layers=1, hypotheses=2))
    save_weights(path, trained(network), {})
    return path


@pytest.fixture
def untrained(tmp_path: Path) -> Path:
    return make_network(tmp_path / "untrained.safetensors", NetworkConfig().points)


@pytest.fixture
def without_weights(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(learned, "bundled_weights", lambda: tmp_path / "missing.safetensors")


def straight_line(scenario: Scenario) -> Trajectory:
    """The car slides from start to goal."""
    t = np.linspace(0.0, 10.0, 120)
    states = np.zeros((len(t), len(State)))
    states[:, : State.V] = scenario.start + np.outer(t / t[-1], scenario.goal - scenario.start)
    return Trajectory(t, states, np.zeros((len(t), len(Input))))


def made_up_plan(
    scenario: Scenario, status: str, optimum: Trajectory | None = None, guess: Trajectory | None = None
) -> SimpleNamespace:
    """What figures read of a plan."""
    return SimpleNamespace(scenario=scenario, status=status, trajectory=optimum, guess=guess, attempts=())


@pytest.fixture
def made_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """Plans along straight lines, without a solver. Those of map_d are not verified, and RRT* finds none of map_c."""

    def straight(scenario: Scenario, source: str, **_given: object) -> SimpleNamespace:
        found = straight_line(scenario)
        status = "unverified" if scenario.name == "map_d" else "verified"
        optimum = None if source == "rrt_star" and scenario.name == "map_c" else found
        return made_up_plan(scenario, status, optimum, found.translated(*OFFSET))

    monkeypatch.setattr(plans_module, "plan", straight)


def solved_line() -> Solved:
    scenario = Scenario.load("empty_field")
    line = straight_line(scenario)
    return Solved(scenario, "verified", line.translated(*OFFSET), line)


def texts(figure: Figure) -> list[Text]:
    return [text for text in figure.findobj(Text) if isinstance(text, Text) and text.get_text()]


def check_letters(figure: Figure) -> None:
    """They can be read in print, and the figure fits on a page."""
    assert figure.get_size_inches()[0] <= PAGE
    assert min(float(text.get_fontsize()) for text in texts(figure) if text.get_visible()) >= LEAST_LETTERS


def check_picture(path: Path) -> None:
    pixels = imread(path)[..., :3]
    assert pixels.shape[1] <= WIDEST
    assert (pixels.min(axis=2) < 0.9).mean() > LEAST_INK


@pytest.mark.usefixtures("without_weights")
@pytest.mark.parametrize("name", DIAGRAMS)
def test_diagrams_need_no_weights(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([name, "--out", str(tmp_path)]) == 0
    check_picture(tmp_path / f"{name}.png")
    check_letters(FIGURES[name](Plans()))
    assert (tmp_path / f"{name}.pdf").read_bytes().startswith(b"%PDF")
    assert sorted(path.name for path in tmp_path.iterdir()) == [f"{name}.pdf", f"{name}.png"]
    assert capsys.readouterr().err == ""


@pytest.mark.usefixtures("without_weights")
def test_figures_of_plans_are_skipped_without_weights_each_with_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*FROM_PLANS, "--out", str(tmp_path / "out")]) == 0
    lines = capsys.readouterr().err.splitlines()
    assert [line.split(":")[0] for line in lines] == list(FROM_PLANS)
    assert all("skipped" in line and "missing.safetensors" in line for line in lines)
    assert not list((tmp_path / "out").iterdir())


@pytest.mark.usefixtures("made_up")
def test_figures_of_plans_are_drawn_with_weights(
    untrained: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def save_quickly(figure: Figure, path: Path) -> None:
        check_letters(figure)
        figure.savefig(path, dpi=QUICK_DPI)

    monkeypatch.setattr(command_line, "FORMATS", ("png",))  # diagrams are written as usual
    monkeypatch.setattr(command_line, "save_figure", save_quickly)
    assert main([*FROM_PLANS, "--out", str(tmp_path / "out"), "--weights", str(untrained)]) == 0
    for name in FROM_PLANS:
        check_picture(tmp_path / "out" / f"{name}.png")
    assert f"{len(FROM_PLANS)} figures" in capsys.readouterr().out


def test_every_plan_is_made_once(untrained: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[tuple[str, str]] = []

    def count(scenario: Scenario, source: str, **_given: object) -> SimpleNamespace:
        made.append((scenario.name, source))
        return made_up_plan(scenario, "failed")

    monkeypatch.setattr(plans_module, "plan", count)
    plans = Plans(untrained)
    for _ in range(2):
        with pytest.raises(Skipped, match="no plan of map_a from GNN: failed"):
            plans.solved("map_a")
    assert made == [("map_a", "gnn")]


@pytest.mark.usefixtures("made_up")
def test_disparity_marks_plans_that_are_missing_or_not_verified(untrained: Path) -> None:
    pytest.importorskip("ompl")
    axes = disparity_figure(Plans(untrained)).axes
    written = [text.get_text() for text in axes[0].texts]  # source by source, map by map
    total = f"{0.5 * N_COMPARED:.0f}"
    gnn, rrt_star = [total] * 3 + [total + UNVERIFIED], [total] * 2 + [MISSING, total + UNVERIFIED]
    assert written == [*gnn, *rrt_star, *gnn]


@pytest.mark.usefixtures("made_up")
def test_disparity_without_ompl_compares_the_others_and_says_so(
    untrained: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(rrt_star, "is_available", lambda: False)
    figure = disparity_figure(Plans(untrained))
    assert len(figure.axes[0].containers) == 2
    assert "without RRT*" in caplog.text


@pytest.mark.usefixtures("made_up")
def test_interpolation_shows_a_denser_network_where_there_is_one(untrained: Path, tmp_path: Path) -> None:
    dense = make_network(tmp_path / "dense.safetensors", 120)
    shown = [text.get_text() for text in texts(interpolation_figure(Plans(untrained, dense)))]
    assert "120 predicted points" in shown
    assert f"{NetworkConfig().points} predicted points" in shown


def test_diagrams_read_their_sizes_from_the_configuration() -> None:
    config = NetworkConfig()
    shown = " ".join(text.get_text() for name in ("framework", "network") for text in texts(FIGURES[name](Plans())))
    for size in (f"{config.hypotheses} guesses", f"{config.refinements} refiners", f"{config.points} points, spline"):
        assert size in shown
    assert f"at most {ROUNDS} rounds" in shown


def test_triangle_areas_are_larger_than_the_polygon_outside_only() -> None:
    shown = [text.get_text() for text in texts(FIGURES["triangle_area"](Plans()))]
    outside, inside = (text for text in shown if "excess" in text)
    assert ">" in outside and "excess 0.00" not in outside
    assert "=" in inside.split("m²")[1] and "excess 0.00" in inside


def test_a_guess_moved_aside_is_that_far_away_everywhere() -> None:
    assert distances(solved_line()) == pytest.approx(np.full(N_COMPARED, 0.5), abs=SUM_ERROR)


def test_distances_do_not_depend_on_the_number_of_knots() -> None:
    solved = solved_line()
    finer = replace(solved, optimum=solved.optimum.resampled(301))
    assert distances(finer) == pytest.approx(distances(solved), abs=SUM_ERROR)


def test_turn_of_a_circle_is_its_curvature_and_a_cusp_has_none() -> None:
    angle = np.linspace(0.0, 3.0, 61)
    states = np.zeros((len(angle), 5))
    states[:, :2] = 5.0 * np.column_stack([np.sin(angle), 1.0 - np.cos(angle)])
    circle = Trajectory(angle, states, np.zeros((len(angle), 2)))
    assert turns(circle)[1:-1] == pytest.approx(1 / 5.0, rel=ARC)
    there_and_back = replace(circle, states=np.concatenate([states[:31], states[29::-1]]))
    assert np.isnan(turns(there_and_back)[30])


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["frameworks"], "must be one of framework, network"),
        (["--max-seconds", "0"], "--max-seconds"),
        (["vehicle", "--weights", "no_such.safetensors"], "no_such.safetensors"),
        (["vehicle", "--out", "/dev/null/out"], "--out"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(
    arguments: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code: object
    try:
        code = main(["--out", str(tmp_path), *arguments])
    except SystemExit as exit_of_parser:
        code = exit_of_parser.code
    error = capsys.readouterr().err
    assert code == 2
    assert said in error
    assert error.count("\n") == 1


def test_list_names_every_figure(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--list"]) == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == list(FIGURES)
