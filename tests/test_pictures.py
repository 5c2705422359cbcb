"""The map and the states: what is drawn, where, and what lands on the disk."""

from __future__ import annotations

import math
import re
import subprocess
import sys
from base64 import b64decode
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PathCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.image import imread
from matplotlib.patches import Polygon

from drake_gnnocp.pictures import (
    draw_map,
    draw_states,
    plan_figure,
    plan_html,
    save_plan_picture,
    save_states_picture,
    states_figure,
    style,
)
from drake_gnnocp.pictures.scene import extent
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.search.reachability import NoPath
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import Vehicle

Yard = Callable[..., Scenario]
Turn = Callable[..., Trajectory]
SUM_ERROR = 1e-9  # m, of sums of a few doubles of size 10
FAR_SUM_ERROR = 1e-5  # m, doubles near 1e10 are 2e-6 apart
FAR = (7.0e9 + 0.3, -8.7e9)  # m, the kind of world coordinates some benchmarks use
PIXELS = (500, 4000)  # a picture for a page: neither a thumbnail nor a poster
LARGEST_CARD = 100_000  # characters: a notebook holds many


def labels(ax: Axes) -> list[str]:
    legend = ax.get_legend()
    assert legend is not None
    return [text.get_text() for text in legend.get_texts()]


# --- the map ---


def test_map_shows_every_part_of_a_plan(yard: Yard, left_turn: Turn) -> None:
    ax = Figure().add_subplot()
    assert draw_map(ax, yard(), left_turn(), left_turn(5.0), "a title") is ax
    (obstacles,) = (c for c in ax.collections if isinstance(c, PathCollection))
    assert len(obstacles.get_paths()) == 2
    dashed = [line for line in ax.lines if line.get_linestyle() == "--"]
    assert [line.get_label() for line in dashed] == ["initial guess"]
    assert labels(ax) == ["obstacles", "bounds", "footprints", "initial guess", "optimised path", "start", "goal"]
    assert ax.get_title() == "a title"
    assert ax.get_aspect() == 1.0


def test_map_of_a_failure_shows_the_scenario_alone(yard: Yard) -> None:
    ax = draw_map(Figure().add_subplot(), yard())
    assert labels(ax) == ["obstacles", "bounds", "start", "goal"]


def test_map_without_obstacles_and_bounds(yard: Yard, left_turn: Turn) -> None:
    ax = draw_map(Figure().add_subplot(), yard(obstacles=(), bounds=None), left_turn())
    assert labels(ax) == ["footprints", "optimised path", "start", "goal"]


def test_concave_obstacle_leaves_its_notch_free(yard: Yard) -> None:
    ax = draw_map(Figure().add_subplot(), yard())
    ell = next(c for c in ax.collections if isinstance(c, PathCollection)).get_paths()[0]
    assert ell.contains_point((9.0, 7.0))
    assert not ell.contains_point((11.0, 4.0))  # inside its convex hull


def test_map_shows_points_lines_and_discs(yard: Yard) -> None:
    points, line = [[3.0, -4.0, 0.0], [9.0, 10.0, 0.0], [18.0, 0.0, 0.3]], [[3.0, 4.0], [3.0, 9.0], [6.0, 9.0]]
    ax = draw_map(Figure().add_subplot(), yard(points=points, lines=[line]))
    dots = [np.asarray(drawn.get_xydata()).tolist() for drawn in ax.lines if drawn.get_linestyle() == "None"]
    assert [[3.0, -4.0], [9.0, 10.0]] in dots
    (lines,) = [drawn for drawn in ax.collections if isinstance(drawn, LineCollection)]
    np.testing.assert_array_equal(lines.get_segments(), [line])
    assert labels(ax).count("obstacles") == 1
    alone = draw_map(Figure().add_subplot(), yard(points=points[:2], obstacles=()))
    assert labels(alone).count("obstacles") == 1


def test_footprints_are_evenly_spaced_along_the_path(yard: Yard, left_turn: Turn) -> None:
    plan = left_turn()
    slow_start = Trajectory(plan.t**2, plan.states, plan.inputs)  # the same places at other times
    ax = draw_map(Figure().add_subplot(), yard(), slow_start)
    (footprints,) = (c for c in ax.collections if isinstance(c, PolyCollection))
    corners = np.array([np.asarray(path.vertices)[:4] for path in footprints.get_paths()])
    rear = (corners[:, 0] + corners[:, 3]) / 2
    steps = np.linalg.norm(np.diff(rear, axis=0), axis=1)
    assert len(steps) >= 4
    evenness = 1e-3  # chords of the interpolated circle against its arc
    np.testing.assert_allclose(steps, steps[0], rtol=evenness)


def test_far_away_map_is_drawn_near_zero_and_says_so(yard: Yard, left_turn: Turn) -> None:
    near = draw_map(Figure().add_subplot(), yard(), left_turn())
    far = draw_map(Figure().add_subplot(), yard().translated(*FAR), left_turn().translated(*FAR))
    assert far.get_xlabel() == "x \N{MINUS SIGN} 7000000000 [m]"
    assert far.get_ylabel() == "y + 8700000000 [m]"
    outlines = [next(patch for patch in ax.patches if isinstance(patch, Polygon)).get_xy() for ax in (near, far)]
    np.testing.assert_allclose(outlines[1] - outlines[0], np.tile([0.3, 0.0], (5, 1)), atol=FAR_SUM_ERROR)


def test_map_shows_the_whole_scene(yard: Yard, left_turn: Turn) -> None:
    ax = draw_map(Figure().add_subplot(), yard(), left_turn())
    (left, right), (low, high) = ax.get_xlim(), ax.get_ylim()
    assert left < -5 and right > 25 and low < -5 and high > 12


def test_attempt_that_ran_away_does_not_shrink_the_map(yard: Yard, left_turn: Turn) -> None:
    plan = left_turn()
    states = plan.states.copy()
    states[-2:, 0] = 1e6, np.nan
    box = extent(yard(), (Trajectory(plan.t, states, plan.inputs),), np.zeros(2))
    np.testing.assert_allclose(box, [[-5.0, -5.0], [55.0, 12.0]], atol=SUM_ERROR)  # the map is 30 m wide


# --- the states ---


def test_states_show_limits_plan_and_guess(left_turn: Turn) -> None:
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


def test_violated_limit_stays_in_the_picture(left_turn: Turn) -> None:
    axes = list(Figure().subplots(5, 1))
    draw_states(axes, left_turn(), Vehicle(v_max=0.4))
    assert axes[0].get_ylim()[1] > 1.0


def test_states_of_a_failure_show_the_limits() -> None:
    axes = list(Figure().subplots(5, 1))
    draw_states(axes, None, Vehicle())
    assert [len(ax.lines) for ax in axes] == [2, 2, 2, 2, 0]


# --- files ---


@pytest.mark.parametrize("solved", [True, False])
def test_pictures_are_written_in_a_readable_size(tmp_path: Path, solved: bool, yard: Yard, left_turn: Turn) -> None:
    plan = left_turn() if solved else None
    save_plan_picture(tmp_path / "plan.png", yard(), plan, left_turn(5.0), "title")
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


def test_figures_for_a_notebook_are_those_of_the_files(tmp_path: Path, yard: Yard, left_turn: Turn) -> None:
    task = yard()
    for name, figure in (
        ("plan.png", plan_figure(task, left_turn(), left_turn(5.0), "a title")),
        ("states.png", states_figure(left_turn(), task.vehicle, left_turn(5.0), "a title")),
    ):
        style.save_figure(figure, tmp_path / name)
    save_plan_picture(tmp_path / "saved_plan.png", task, left_turn(), left_turn(5.0), "a title")
    save_states_picture(tmp_path / "saved_states.png", left_turn(), task.vehicle, left_turn(5.0), "a title")
    for name in ("plan.png", "states.png"):
        assert np.array_equal(imread(tmp_path / name), imread(tmp_path / f"saved_{name}"))


# --- in a notebook ---


def made_up_plan(scenario: Scenario, trajectory: Trajectory | None, **changes: Any) -> Any:
    """What `plan_html` reads of a plan, without a planner."""
    solved = trajectory is not None
    attempts = (
        SimpleNamespace(source="gnn", verified=False, reason="collides with <a wall>", iterations=41),
        SimpleNamespace(source="hybrid_astar", verified=solved, reason="" if solved else "no path", iterations=7),
    )
    fields = {
        "scenario": scenario,
        "status": "verified" if solved else "failed",
        "verified": solved,
        "trajectory": trajectory,
        "guess": trajectory,
        "guess_source": "hybrid_astar",
        "no_path": None,
        "verification": SimpleNamespace(min_clearance_m=0.31) if solved else None,
        "cost": SimpleNamespace(J=12.345) if solved else None,
        "first_fault": None,
        "attempts": attempts,
        "total_seconds": 0.256,
    }
    return SimpleNamespace(**fields | changes)


def rows_of(html: str) -> list[list[str]]:
    """The cells of all tables, row by row."""
    return [re.findall(r"<td[^>]*>(.*?)</td>", row) for row in re.findall(r"<tr>(.*?)</tr>", html)]


def test_map_marks_where_it_is_blocked(yard: Yard) -> None:
    blocked = NoPath("the passage near {place} is narrow", True, (FAR[0] + 3.0, FAR[1] + 4.0), 1.25)
    ax = draw_map(Figure().add_subplot(), yard().translated(*FAR), no_path=blocked)
    (cross,) = (line for line in ax.lines if line.get_label() == "blocked: 1.25 m wide")
    start = next(line for line in ax.lines if line.get_marker() == "o")
    offset = np.subtract(cross.get_xydata(), start.get_xydata())
    np.testing.assert_allclose(offset, [[3.0, 4.0]], atol=FAR_SUM_ERROR)


def test_card_of_a_plan_says_what_came_out_and_what_became_of_every_attempt(yard: Yard, left_turn: Turn) -> None:
    rows = rows_of(plan_html(made_up_plan(yard(), left_turn())))
    assert rows == [
        ["status", "verified"],
        ["guess", "hybrid_astar"],
        ["duration", "6.0 s"],
        ["cost J", "12.35"],
        ["clearance", "0.31 m"],
        ["total time", "0.26 s"],
        ["attempt", "iterations", "outcome"],
        ["gnn", "41", "collides with &lt;a wall&gt;"],
        ["hybrid_astar", "7", "verified"],
    ]


def test_card_of_a_failure_leaves_out_what_is_not_known(yard: Yard) -> None:
    rows = rows_of(plan_html(made_up_plan(yard(), None)))
    assert [row[0] for row in rows] == ["status", "guess", "total time", "attempt", "gnn", "hybrid_astar"]
    assert rows[-1] == ["hybrid_astar", "7", "no path"]


def test_card_names_no_clearance_where_there_are_no_obstacles(yard: Yard, left_turn: Turn) -> None:
    plan = made_up_plan(yard(obstacles=()), left_turn(), verification=SimpleNamespace(min_clearance_m=math.inf))
    assert ["clearance", "no obstacles"] in rows_of(plan_html(plan))


def test_card_takes_the_source_of_a_guess_where_an_attempt_holds_the_guess_itself(yard: Yard, left_turn: Turn) -> None:
    attempt = SimpleNamespace(source="mine", verified=True, reason="", iterations=3)
    assert rows_of(plan_html(made_up_plan(yard(), left_turn(), attempts=(attempt,))))[-1] == ["mine", "3", "verified"]


def test_card_is_one_small_piece_of_html_with_a_picture_in_it(yard: Yard, left_turn: Turn) -> None:
    html = plan_html(made_up_plan(yard(name='<script src="x">$'), left_turn()))
    assert "&lt;script" in html and "<script" not in html
    (source,) = re.findall(r'src="([^"]*)"', html)
    kind, picture = source.split(",")
    assert kind == "data:image/png;base64" and len(html) < LARGEST_CARD
    height, width, _ = imread(BytesIO(b64decode(picture))).shape
    assert 300 < width <= 700 and height > 200
