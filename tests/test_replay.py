"""The replay: one file that needs no network, a car that moves as planned, and meshes that are exact."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable
from pathlib import Path
from typing import cast

import numpy as np
import pytest
import shapely
from pydrake.geometry import Meshcat, MeshcatAnimation, Rgba
from pydrake.math import RigidTransform

from drake_gnnocp.pictures import save_replay
from drake_gnnocp.pictures.car_model import Proportions, animate_car
from drake_gnnocp.pictures.meshes import Mesh, frustum, prism, upright
from drake_gnnocp.pictures.replay import THIN, WALL_HEIGHT, _add_obstacles
from drake_gnnocp.scenario import Area, Scenario
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import Vehicle

Yard = Callable[..., Scenario]
Turn = Callable[..., Trajectory]
SUM_ERROR = 1e-9  # m, of sums of a few doubles of size 10
FAR_SUM_ERROR = 1e-5  # m, doubles near 1e10 are 2e-6 apart
FAR = (7.0e9 + 0.3, -8.7e9)  # m, the kind of world coordinates some benchmarks use
LARGEST_REPLAY = 6e6  # bytes: Meshcat itself is 2.2e6, 20 s of animation below 1e6


def volume(mesh: Mesh) -> float:
    """Enclosed by a closed mesh whose faces look outwards (the divergence theorem) [m^3]."""
    vertices, faces = mesh
    a, b, c = (vertices[:, faces[k]].T for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


@pytest.fixture(scope="module")
def replay(tmp_path_factory: pytest.TempPathFactory, yard: Yard, left_turn: Turn) -> str:
    path = tmp_path_factory.mktemp("replay") / "replay.html"
    save_replay(path, yard(name="<yard>"), left_turn())
    return path.read_text(encoding="utf-8")


def test_replay_loads_nothing_from_the_network(replay: str) -> None:
    assert not re.findall(r"<(?:script|img|iframe)\b[^>]*\bsrc\s*=", replay)
    assert not re.findall(r"<link\b[^>]*\bhref\s*=", replay)
    assert len(replay) < LARGEST_REPLAY


def test_replay_names_the_scenario(replay: str) -> None:
    assert "<title>&lt;yard&gt;: replay</title>" in replay


def test_replay_holds_the_animation_and_its_controls(replay: str, tmp_path: Path, yard: Yard) -> None:
    save_replay(tmp_path / "still.html", yard(), None)
    still = (tmp_path / "still.html").read_text(encoding="utf-8")
    seconds, tracks, least_key = 6, 7, 40  # 7 moving parts at 30 Hz, at least 40 bytes a key frame
    assert len(replay) - len(still) > 30 * seconds * tracks * least_key
    assert "viewer.gui.open()" in replay and "viewer.gui.open()" not in still


def test_replay_puts_its_controls_beside_the_scene(replay: str) -> None:
    (panel,) = re.findall(r"viewer\.gui\.width = (\d+);", replay)
    (taken,) = re.findall(r'viewer\.dom_element\.style\.width = "calc\(100% - (\d+)px\)"', replay)
    assert panel == taken


def test_replay_works_without_obstacles(tmp_path: Path, yard: Yard, left_turn: Turn) -> None:
    save_replay(tmp_path / "replay.html", yard(obstacles=(), bounds=None), left_turn())
    assert [path.name for path in tmp_path.iterdir()] == ["replay.html"]


def test_replay_of_a_far_away_map_happens_near_zero(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, yard: Yard, left_turn: Turn
) -> None:
    parked: list[np.ndarray] = []
    monkeypatch.setattr("drake_gnnocp.pictures.replay.place_car", lambda _meshcat, pose: parked.append(pose))
    for dx, dy in ((0.0, 0.0), FAR):
        save_replay(tmp_path / "replay.html", yard().translated(dx, dy), left_turn().translated(dx, dy))
    near, far = parked
    np.testing.assert_allclose(near, [-10.0, -3.5, 0.0], atol=SUM_ERROR)  # from the middle of the bounds
    np.testing.assert_allclose(far, near, atol=FAR_SUM_ERROR)


def test_replay_of_a_small_robot_has_what_stands_around_it_at_its_scale(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, yard: Yard, left_turn: Turn
) -> None:
    parked: list[np.ndarray] = []
    monkeypatch.setattr("drake_gnnocp.pictures.replay.place_car", lambda _meshcat, pose: parked.append(pose))
    small = yard(
        vehicle=Vehicle().scaled(0.2),
        obstacles=tuple(0.2 * np.asarray(ring) for ring in yard().obstacles),
        bounds=(-1.0, 5.0, -1.0, 2.4),
        goal=np.array([4.0, 1.0, 1.0]),
    )
    save_replay(tmp_path / "replay.html", small, left_turn().scaled(0.2))
    np.testing.assert_allclose(parked[0], [-10.0, -3.5, 0.0], atol=SUM_ERROR)


class Scene:
    """A Meshcat that remembers what it is given."""

    def __init__(self) -> None:
        self.meshes: dict[str, Mesh] = {}
        self.segments: dict[str, tuple[np.ndarray, np.ndarray]] = {}

    def SetTriangleMesh(self, path: str, vertices: np.ndarray, faces: np.ndarray, rgba: Rgba) -> None:  # noqa: N802, D102
        self.meshes[path] = vertices, faces

    def SetLineSegments(  # noqa: N802, D102 (Drake's name)
        self, path: str, begin: np.ndarray, end: np.ndarray, width: float, rgba: Rgba
    ) -> None:
        self.segments[path] = begin, end


def test_all_obstacles_are_one_mesh_and_thin_ones_are_thick_enough_to_see() -> None:
    grid = [(3.0 * x, 3.0 * y) for x in range(-20, 20) for y in range(3, 23)]
    squares = tuple(np.array([[x, y], [x + 1, y], [x + 1, y + 1], [x, y + 1]]) for x, y in grid)
    frame = Area(np.array([[0, -9], [4, -9], [4, -5], [0, -5]]), (np.array([[1, -8], [2, -8], [2, -7]]),))
    start, goal = np.array([-9.0, 0.0, 0.0]), np.array([9.0, 0.0, 0.0])
    solid = Scenario("solid", start, goal, (*squares, frame))
    thin = Scenario("thin", start, goal, lines=(np.array([[0.0, 4.0], [10.0, 4.0]]),), points=np.array([[2, 7, 0]]))
    for scenario, area in ((solid, len(squares) + 16 - 0.5), (thin, 10 * 2 * THIN)):
        scene = Scene()
        _add_obstacles(cast(Meshcat, scene), scenario)
        (walls,), ((begin, end),) = scene.meshes.values(), scene.segments.values()
        assert volume(walls) == pytest.approx(WALL_HEIGHT * area, rel=0.02)
        closed = 4 * len(squares) + 4 + 3
        assert begin.shape == end.shape and (scenario is thin or begin.shape == (3, closed))


def test_replay_is_silent_and_restores_the_log_level(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, capfd: pytest.CaptureFixture[str], yard: Yard, left_turn: Turn
) -> None:
    with caplog.at_level(logging.INFO, logger="drake"):
        save_replay(tmp_path / "replay.html", yard(), left_turn())
        assert logging.getLogger("drake").level == logging.INFO
    assert not caplog.records
    assert capfd.readouterr() == ("", "")


def test_failed_replay_keeps_the_old_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, yard: Yard, left_turn: Turn
) -> None:
    def breaks(path: Path, _target: Path) -> None:
        raise OSError("disk full")

    (tmp_path / "replay.html").write_text("old")
    monkeypatch.setattr(Path, "replace", breaks)
    with pytest.raises(OSError, match="disk full"):
        save_replay(tmp_path / "replay.html", yard(), left_turn())
    assert [path.name for path in tmp_path.iterdir()] == ["replay.html"]
    assert (tmp_path / "replay.html").read_text() == "old"


class Recorder:
    """An animation that remembers the transforms it is given."""

    def __init__(self) -> None:
        self.frames: dict[tuple[int, str], RigidTransform] = {}

    def SetTransform(self, frame: int, path: str, transform: RigidTransform) -> None:  # noqa: N802, D102 (Drake's name)
        self.frames[frame, path] = transform


def test_car_drives_along_its_heading_and_steers_left_for_positive_phi(left_turn: Turn) -> None:
    plan, recorder, vehicle = left_turn(), Recorder(), Vehicle()
    animate_car(cast(MeshcatAnimation, recorder), vehicle, plan, hold=10)
    car = recorder.frames[20, "car"]
    np.testing.assert_allclose(car.translation(), [*plan.poses[20, :2], 0.0], atol=SUM_ERROR)
    heading = car.rotation().multiply([1.0, 0.0, 0.0])
    np.testing.assert_allclose(heading, [np.cos(plan.poses[20, 2]), np.sin(plan.poses[20, 2]), 0.0], atol=SUM_ERROR)
    wheel = recorder.frames[20, "car/front_left"].rotation().multiply([1.0, 0.0, 0.0])
    np.testing.assert_allclose(wheel, [np.cos(0.5), np.sin(0.5), 0.0], atol=SUM_ERROR)  # towards +y: left
    assert (20, "car/rear_left") not in recorder.frames
    rested = recorder.frames[len(plan) - 1 + 10, "car"]
    np.testing.assert_allclose(rested.translation(), [*plan.poses[-1, :2], 0.0], atol=SUM_ERROR)


def test_wheels_roll_forwards_without_slipping(left_turn: Turn) -> None:
    plan, recorder, vehicle = left_turn(), Recorder(), Vehicle()
    animate_car(cast(MeshcatAnimation, recorder), vehicle, plan)
    turn = recorder.frames[1, "car/rear_left/roll"].rotation().multiply([0.0, 0.0, 1.0])  # the tyre's uppermost point
    angle = float(plan.t[1]) / Proportions.of(vehicle).wheel_radius  # at 1 m/s
    np.testing.assert_allclose(turn, [np.sin(angle), 0.0, np.cos(angle)], atol=SUM_ERROR)


# --- meshes ---


def test_prism_encloses_the_exact_polygon_in_either_orientation(yard: Yard) -> None:
    for ring in yard().obstacles:
        for polygon in (shapely.Polygon(ring), shapely.Polygon(ring[::-1])):
            assert volume(prism(polygon, 0.5, 2.0)) == pytest.approx(1.5 * polygon.area, rel=SUM_ERROR)


def test_prism_keeps_holes_open() -> None:
    frame = shapely.box(0, 0, 4, 3) - shapely.box(1, 1, 2, 2)
    assert volume(prism(frame, 0.0, 2.0)) == pytest.approx(2.0 * 11.0, rel=SUM_ERROR)


def test_many_prisms_are_one_mesh_of_all_of_them() -> None:
    polygons = np.array([shapely.box(0, 0, 4, 3) - shapely.box(1, 1, 2, 2), shapely.box(5, 0, 6, 1), shapely.Polygon()])
    assert volume(prism(polygons, 1.0, 3.0)) == pytest.approx(2.0 * 12.0, rel=SUM_ERROR)


def test_frustum_and_upright_face_outwards() -> None:
    assert volume(frustum((0, 4, 1), (1, 3, 0.5), 0.0, 3.0)) == pytest.approx(14.0, rel=SUM_ERROR)  # h (A + M4 + B) / 6
    side = shapely.Polygon([(0, 0), (3, 0), (3, 1), (0, 2)])
    assert volume(upright(prism(side, 0.0, 1.0), 0.5)) == pytest.approx(side.area, rel=SUM_ERROR)
