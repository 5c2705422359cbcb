"""The map and the states: what is drawn, where, and what lands on the disk."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.image import imread
from matplotlib.patches import PathPatch, Polygon
from yard import FAR, FAR_ROUNDING, ROUNDING, left_turn, scenario

from drake_gnnocp.pictures import (
    draw_map,
    draw_states,
    plan_figure,
    save_plan_picture,
    save_states_picture,
    states_figure,
    style,
)
from drake_gnnocp.pictures.scene import extent
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import Vehicle

PIXELS = (500, 4000)  # a picture for a page: neither a thumbnail nor a poster


def labels(ax: Axes) -> list[str]:
    legend = ax.get_legend()
    assert legend is not None
    return [text.get_text() for text in legend.get_texts()]


# --- the map ---


def test_map_shows_every_part_of_a_plan() -> None:
    ax = Figure().add_subplot()
    assert draw_map(ax, scenario(), left_turn(), left_turn(5.0), "a title") is ax
    assert sum(isinstance(patch, PathPatch) for patch in ax.patches) == 2  # obstacles
    dashed = [line for line in ax.lines if line.get_linestyle() == "--"]
    assert [line.get_label() for line in dashed] == ["initial guess"]
    assert labels(ax) == ["obstacles", "bounds", "footprints", "initial guess", "optimised path", "start", "goal"]
    assert ax.get_title() == "a title"
    assert ax.get_aspect() == 1.0


def test_map_of_a_failure_shows_the_scenario_alone() -> None:
    ax = draw_map(Figure().add_subplot(), scenario())
    assert labels(ax) == ["obstacles", "bounds", "start", "goal"]


def test_map_without_obstacles_and_bounds() -> None:
    ax = draw_map(Figure().add_subplot(), scenario(obstacles=(), bounds=None), left_turn())
    assert labels(ax) == ["footprints", "optimised path", "start", "goal"]


def test_concave_obstacle_leaves_its_notch_free() -> None:
    ax = draw_map(Figure().add_subplot(), scenario())
    ell = next(patch for patch in ax.patches if isinstance(patch, PathPatch))
    assert ell.get_path().contains_point((9.0, 7.0))
    assert not ell.get_path().contains_point((11.0, 4.0))  # inside its convex hull


def test_footprints_are_evenly_spaced_along_the_path() -> None:
    plan = left_turn()
    slow_start = Trajectory(plan.t**2, plan.states, plan.inputs)  # the same places at other times
    ax = draw_map(Figure().add_subplot(), scenario(), slow_start)
    (footprints,) = (c for c in ax.collections if isinstance(c, PolyCollection))
    corners = np.array([np.asarray(path.vertices)[:4] for path in footprints.get_paths()])
    rear = (corners[:, 0] + corners[:, 3]) / 2
    steps = np.linalg.norm(np.diff(rear, axis=0), axis=1)
    assert len(steps) >= 4
    evenness = 1e-3  # chords of the interpolated circle against its arc
    np.testing.assert_allclose(steps, steps[0], rtol=evenness)


def test_far_away_map_is_drawn_near_zero_and_says_so() -> None:
    near = draw_map(Figure().add_subplot(), scenario(), left_turn())
    far = draw_map(Figure().add_subplot(), scenario().translated(*FAR), left_turn().translated(*FAR))
    assert far.get_xlabel() == "x \N{MINUS SIGN} 7000000000 [m]"
    assert far.get_ylabel() == "y + 8700000000 [m]"
    outlines = [next(patch for patch in ax.patches if isinstance(patch, Polygon)).get_xy() for ax in (near, far)]
    np.testing.assert_allclose(outlines[1] - outlines[0], np.tile([0.3, 0.0], (5, 1)), atol=FAR_ROUNDING)


def test_map_shows_the_whole_scene() -> None:
    ax = draw_map(Figure().add_subplot(), scenario(), left_turn())
    (left, right), (low, high) = ax.get_xlim(), ax.get_ylim()
    assert left < -5 and right > 25 and low < -5 and high > 12


def test_attempt_that_ran_away_does_not_shrink_the_map() -> None:
    plan = left_turn()
    states = plan.states.copy()
    states[-2:, 0] = 1e6, np.nan
    box = extent(scenario(), (Trajectory(plan.t, states, plan.inputs),), np.zeros(2))
    np.testing.assert_allclose(box, [[-5.0, -5.0], [55.0, 12.0]], atol=ROUNDING)  # the map is 30 m wide


# --- the states ---


def test_states_show_limits_plan_and_guess() -> None:
    axes = list(Figure().subplots(5, 1))
    vehicle = Vehicle()
    assert draw_states(axes, left_turn(), vehicle, left_turn(5.0)) is axes
    for ax, limit in zip(axes[:4], (vehicle.v_max, vehicle.phi_max, vehicle.a_max, vehicle.w_max), strict=True):
        assert [line.get_label() for line in ax.lines][:2] == ["initial guess", "optimised"]
        assert sorted(np.asarray(line.get_ydata())[0] for line in ax.lines[2:]) == [-limit, limit]
        assert len(ax.patches) == 2  # what is beyond the limits
        assert ax.get_ylim()[1] > limit
    assert len(axes[4].lines) == 2  # the heading has no limit
    assert all("[" in ax.get_ylabel() for ax in axes) and "[s]" in axes[4].get_xlabel()


def test_violated_limit_stays_in_the_picture() -> None:
    axes = list(Figure().subplots(5, 1))
    draw_states(axes, left_turn(), Vehicle(v_max=0.4))
    assert axes[0].get_ylim()[1] > 1.0


def test_states_of_a_failure_show_the_limits() -> None:
    axes = list(Figure().subplots(5, 1))
    draw_states(axes, None, Vehicle())
    assert [len(ax.lines) for ax in axes] == [2, 2, 2, 2, 0]


# --- files ---


@pytest.mark.parametrize("plan", [left_turn(), None])
def test_pictures_are_written_in_a_readable_size(tmp_path: Path, plan: Trajectory | None) -> None:
    save_plan_picture(tmp_path / "plan.png", scenario(), plan, left_turn(5.0), "title")
    save_states_picture(tmp_path / "states.png", plan, Vehicle(), left_turn(5.0), "title")
    for name in ("plan.png", "states.png"):
        height, width, _ = imread(tmp_path / name).shape
        assert PIXELS[0] < min(height, width) and max(height, width) < PIXELS[1]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["plan.png", "states.png"]


def test_failed_writing_keeps_the_old_picture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def breaks(_figure: Figure, path: Path, **_options: object) -> None:
        Path(path).write_bytes(b"half")
        raise OSError("disk full")

    (tmp_path / "plan.png").write_bytes(b"old")
    monkeypatch.setattr(Figure, "savefig", breaks)
    with pytest.raises(OSError, match="disk full"):
        style.save_figure(style.new_figure(3, 2), tmp_path / "plan.png")
    assert [path.name for path in tmp_path.iterdir()] == ["plan.png"]
    assert (tmp_path / "plan.png").read_bytes() == b"old"


def test_import_writes_nothing_and_leaves_pyplot_alone(tmp_path: Path) -> None:
    code = "import sys, drake_gnnocp.pictures; sys.exit('matplotlib.pyplot' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert not list(tmp_path.iterdir())


def test_figures_for_a_notebook_are_those_of_the_files(tmp_path: Path) -> None:
    task = scenario()
    for name, figure in (
        ("plan.png", plan_figure(task, left_turn(), left_turn(5.0), "a title")),
        ("states.png", states_figure(left_turn(), task.vehicle, left_turn(5.0), "a title")),
    ):
        style.save_figure(figure, tmp_path / name)
    save_plan_picture(tmp_path / "saved_plan.png", task, left_turn(), left_turn(5.0), "a title")
    save_states_picture(tmp_path / "saved_states.png", left_turn(), task.vehicle, left_turn(5.0), "a title")
    for name in ("plan.png", "states.png"):
        assert np.array_equal(imread(tmp_path / name), imread(tmp_path / f"saved_{name}"))
