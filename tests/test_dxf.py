"""DXF drawings: arcs against closed forms, units, layers, blocks, poses and bounds."""

from __future__ import annotations

import logging
import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import ezdxf
import numpy as np
import pytest
import shapely

from drake_gnnocp import Scenario
from drake_gnnocp.command_line import main
from drake_gnnocp.maps.curves import FLATTENING, ring_around, ring_around_ellipse
from drake_gnnocp.maps.dxf import read_dxf

EXACT = 1e-9  # m, rounding of coordinates of order ten
RESOLVED = 2e-6  # m, by which a fine polyline differs from an arc
SMOOTH = 20_000  # points of an arc that stands for the exact one: of 100 m, 1e-6 m off
BAD_INPUT = 2  # exit code
SQUARE = [(0, 0), (4, 0), (4, 4), (0, 4)]

Read = Callable[..., dict[str, Any]]
Draw = Callable[[Any], object]


@pytest.fixture
def read(tmp_path: Path) -> Read:
    """Reads what a function draws into a model space, in metres unless said otherwise."""

    def write_and_read(draw: Draw, units: int = 6, layers: tuple[str, ...] = ()) -> dict[str, Any]:
        document = ezdxf.new(units=units)
        draw(document.modelspace())
        document.saveas(tmp_path / "drawing.dxf")
        return read_dxf(tmp_path / "drawing.dxf", layers)

    return write_and_read


def area(obstacle: Any) -> shapely.Polygon:
    if isinstance(obstacle, dict):
        return shapely.Polygon(obstacle["ring"], obstacle["holes"])
    return shapely.Polygon(obstacle)


def arc(x: float, y: float, r: float, begin: float, end: float) -> np.ndarray:
    """Points of a circle."""
    angles = np.linspace(begin, end, SMOOTH)
    return np.column_stack([x + r * np.cos(angles), y + r * np.sin(angles)])


def assert_covers(ring: Any, exact: np.ndarray) -> None:
    """The ring covers what a fine polyline encloses, and is at most FLATTENING larger."""
    covering, covered = shapely.Polygon(ring), shapely.Polygon(exact)
    assert covering.is_valid
    assert covered.difference(covering).area < EXACT
    assert shapely.distance(shapely.points(exact), covering).max() < EXACT
    assert shapely.distance(shapely.points(ring), covered).max() < FLATTENING + RESOLVED


@pytest.mark.parametrize("r", [0.01, 0.3, 5.0, 100.0])
def test_a_ring_of_two_half_circles_covers_the_disc_with_tangents(r: float) -> None:
    ring = np.array(ring_around(np.array([[-r, 2.0, 1.0], [r, 2.0, 1.0]])))
    assert_covers(ring, arc(0, 2, r, 0, 2 * np.pi)[:-1])
    edges = np.roll(ring, -1, axis=0) - ring
    across = np.abs(edges[:, 0] * (2.0 - ring[:, 1]) + edges[:, 1] * ring[:, 0]) / np.linalg.norm(edges, axis=1)
    np.testing.assert_allclose(across, r, atol=EXACT)  # every edge touches the circle


@pytest.mark.parametrize("bulge", [1e-5, 1e-3, 0.05, math.tan(math.pi / 8), 0.9])
@pytest.mark.parametrize("clockwise", [False, True])
def test_an_arc_of_a_square_is_covered_outside_and_inside(bulge: float, clockwise: bool) -> None:
    r = 0.25 * 8 * (bulge + 1 / bulge)  # chord / 4 (b + 1 / b)
    height = r * (1 - bulge**2) / (1 + bulge**2)  # of the centre above the chord
    half = 2 * math.atan(bulge)
    for sign in (1, -1):
        vertices = np.array([[-4, 0, sign * bulge], [4, 0, 0], [4, 40, 0], [-4, 40, 0]], dtype=float)
        bow = arc(0, sign * height, r, -sign * math.pi / 2 - half, -sign * math.pi / 2 + half)[::sign]
        exact = np.concatenate([bow, [[4, 40], [-4, 40]]])
        if clockwise:  # the bulge belongs to the edge, and so to its other end
            vertices = np.array([[4, 0, -sign * bulge], [-4, 0, 0], [-4, 40, 0], [4, 40, 0]], dtype=float)
        assert_covers(ring_around(vertices), exact)
        within = shapely.Polygon(ring_around(vertices, outward=False))
        chords = exact if sign > 0 else np.concatenate([[[-4, 0]], [[4, 0], [4, 40], [-4, 40]]])
        assert within.difference(shapely.Polygon(exact).buffer(EXACT)).area < 1e-3 * FLATTENING
        assert shapely.Polygon(exact).difference(within).area <= FLATTENING * shapely.LineString(chords).length


def test_a_turned_ellipse_is_covered() -> None:
    major, minor = np.array([3.0, 4.0]), np.array([-0.8, 0.6])
    angles = np.linspace(0, 2 * np.pi, SMOOTH)[:-1, None]
    exact = [1.0, -2.0] + np.cos(angles) * major + np.sin(angles) * minor
    assert_covers(ring_around_ellipse(np.array([1.0, -2.0]), major, minor), exact)
    within = shapely.Polygon(ring_around_ellipse(np.array([1.0, -2.0]), major, minor, outward=False))
    assert within.difference(shapely.Polygon(ring_around_ellipse(np.array([1.0, -2.0]), major, minor))).area == 0
    assert within.area < math.pi * 5 * 1


@pytest.mark.parametrize(
    ("units", "metre"), [(1, 39.37007874015748), (2, 3.280839895013123), (4, 1000), (5, 100), (6, 1), (14, 10)]
)
def test_units_become_metres(read: Read, units: int, metre: float) -> None:
    found = read(lambda space: space.add_lwpolyline([(x * metre, y * metre) for x, y in SQUARE], close=True), units)
    np.testing.assert_allclose(found["obstacles"], [SQUARE], atol=EXACT)
    circle = read(lambda space: space.add_circle((7 * metre, 0), 2 * metre), units)["obstacles"][0]
    assert_covers(circle, arc(7, 0, 2, 0, 2 * np.pi)[:-1])


def test_without_a_unit_metres_are_taken_with_a_warning(read: Read, caplog: pytest.LogCaptureFixture) -> None:
    assert read(lambda space: space.add_lwpolyline(SQUARE, close=True), 0)["obstacles"] == [
        [list(map(float, point)) for point in SQUARE]
    ]
    assert [record.getMessage() for record in caplog.records] == [
        "$INSUNITS: the drawing has no unit: it is taken to be in metres"
    ]
    with pytest.raises(ValueError, match=r"^\$INSUNITS: must be the number of a unit of length, not 20"):
        read(lambda space: None, 20)


def test_closed_things_are_solid_and_open_ones_lines(read: Read) -> None:
    def draw(space: Any) -> None:
        space.add_lwpolyline(SQUARE, close=True)
        space.add_lwpolyline([*SQUARE, SQUARE[0]])  # closed by hand
        space.add_polyline2d(SQUARE, close=True)
        space.add_polyline3d([(*point, 7) for point in SQUARE], close=True)
        space.add_solid([SQUARE[0], SQUARE[1], SQUARE[3], SQUARE[2]])  # their order in DXF
        space.add_lwpolyline(SQUARE)
        space.add_line((1, 2, 3), (4, 5, 6))
        space.add_point((8, 9, 3))
        space.add_line((7, 7), (7, 7))

    found = read(draw)
    assert [area(obstacle).equals(shapely.Polygon(SQUARE)) for obstacle in found["obstacles"]] == [True] * 5
    assert found["lines"] == [[[x, y] for x, y in SQUARE], [[1, 2], [4, 5]]]
    assert found["points"] == [[8, 9], [7, 7]]


def test_open_arcs_are_chords_near_the_curve(read: Read) -> None:
    def draw(space: Any) -> None:
        space.add_arc((1, 2), 5, 30, 250)
        space.add_ellipse((1, 2), (5, 0), 1.0, math.radians(30), math.radians(250))
        space.add_lwpolyline([(5, 0, 1.0), (-5, 0, 0)], format="xyb", dxfattribs={"elevation": 3})

    found = read(draw)["lines"]
    for line, (x, y, begin, end) in zip(found, [(1, 2, 30, 250), (1, 2, 30, 250), (0, 0, 0, 180)], strict=True):
        exact = arc(x, y, 5, math.radians(begin), math.radians(end))
        np.testing.assert_allclose([line[0], line[-1]], exact[[0, -1]], atol=EXACT)
        np.testing.assert_allclose(np.linalg.norm(np.array(line) - [x, y], axis=1), 5, atol=EXACT)
        assert shapely.distance(shapely.points(exact), shapely.LineString(line)).max() < FLATTENING


def test_a_mirrored_arc_turns_the_other_way(read: Read) -> None:
    def draw(space: Any) -> None:
        below = {"extrusion": (0, 0, -1)}
        space.add_lwpolyline([(0, 0, 0.5), (4, 0, 0), (4, 4, 0), (0, 4, 0)], "xyb", close=True, dxfattribs=below)
        space.add_circle((4, 0), 1, dxfattribs=below)
        space.add_arc((4, 0), 1, 0, 90, dxfattribs=below)

    found = read(draw)
    bow = arc(2, 1.5, 2.5, -np.pi / 2 - 2 * math.atan(0.5), -np.pi / 2 + 2 * math.atan(0.5))  # r = 4 / 4 (2 + 0.5)
    assert_covers(found["obstacles"][0], np.concatenate([bow, [[4, 4], [0, 4]]]) * [-1, 1])
    assert_covers(found["obstacles"][1], arc(-4, 0, 1, 0, 2 * np.pi)[:-1])
    np.testing.assert_allclose([found["lines"][0][0], found["lines"][0][-1]], [[-5, 0], [-4, 1]], atol=EXACT)


def test_a_closed_spline_is_covered_and_an_open_one_is_near(read: Read) -> None:
    frame = np.array([(0, 0), (6, 0), (7, 5), (2, 7), (-3, 4)], dtype=float)
    wrapped = np.concatenate([frame, frame[:3]])

    def draw(space: Any) -> None:
        space.add_spline(degree=3).set_closed([(x, y, 0) for x, y in frame])
        space.add_open_spline([(x, y, 0) for x, y in frame])

    found = read(draw)
    u = np.linspace(0, 1, SMOOTH // 10)[:, None]
    basis = np.hstack([(1 - u) ** 3, 3 * u**3 - 6 * u**2 + 4, -3 * u**3 + 3 * u**2 + 3 * u + 1, u**3]) / 6
    exact = np.concatenate([basis @ wrapped[i : i + 4] for i in range(5)])  # uniform cubic B-spline
    assert_covers(found["obstacles"][0], exact)
    space = ezdxf.new().modelspace()
    opened = space.add_open_spline([(x, y, 0) for x, y in frame]).construction_tool().approximate(2000)
    line = shapely.LineString(found["lines"][0])
    assert shapely.distance(shapely.points([(p.x, p.y) for p in opened]), line).max() < FLATTENING


def test_hatches_have_holes_and_circles(read: Read) -> None:
    def draw(space: Any) -> None:
        hatch = space.add_hatch()
        hatch.paths.add_polyline_path(SQUARE)
        hatch.paths.add_polyline_path([(1, 1), (3, 1), (3, 3), (1, 3)])
        disc = space.add_hatch()
        disc.paths.add_edge_path().add_arc((10, 0), 2, 0, 360)

    square, disc = read(draw)["obstacles"]
    assert area(square).area == 12 and len(square["holes"]) == 1
    exact = arc(10, 0, 2, 0, 2 * np.pi)[:-1]
    assert shapely.Polygon(disc).covers(shapely.Polygon(exact))
    assert shapely.distance(shapely.points(disc), shapely.Polygon(exact)).max() < FLATTENING + 3e-4 * 8


def test_a_wide_polyline_is_as_wide_as_drawn(read: Read) -> None:
    def draw(space: Any) -> None:
        space.add_lwpolyline([(0, 0), (10, 0)], dxfattribs={"const_width": 0.4})
        space.add_lwpolyline(SQUARE, close=True, dxfattribs={"const_width": 0.4})

    wall, block = (area(obstacle) for obstacle in read(draw)["obstacles"])
    assert wall.equals(shapely.box(0, -0.2, 10, 0.2))
    assert block.covers(shapely.box(-0.2, -0.2, 4.2, 4.2).buffer(-EXACT)) and block.area < 4.4**2 + EXACT


def test_blocks_are_placed_turned_scaled_and_repeated(read: Read) -> None:
    def draw(space: Any) -> None:
        block = space.doc.blocks.new("POST", base_point=(1, 0))
        block.add_lwpolyline([(1, 0), (3, 0), (1, 1)], close=True)
        outer = space.doc.blocks.new("PAIR")
        outer.add_blockref("POST", (0, 0))
        outer.add_blockref("POST", (0, 10), dxfattribs={"rotation": 90})
        space.add_blockref("PAIR", (5, 5), dxfattribs={"xscale": -1})
        space.add_blockref("POST", (0, 0), dxfattribs={"xscale": 2, "yscale": 3})
        grid = {"row_count": 2, "column_count": 3, "row_spacing": 10, "column_spacing": 20}
        space.add_blockref("POST", (0, 0), dxfattribs=grid)

    found = [area(obstacle) for obstacle in read(draw)["obstacles"]]
    expected = [
        *([(5, 5), (3, 5), (5, 6)], [(5, 15), (5, 17), (6, 15)], [(0, 0), (4, 0), (0, 3)]),
        *([(x, y), (x + 2, y), (x, y + 1)] for y in (0, 10) for x in (0, 20, 40)),
    ]
    for ours, ring in zip(found, expected, strict=True):
        assert ours.symmetric_difference(shapely.Polygon(ring)).area < EXACT


def test_a_circle_in_a_stretched_block_is_a_covered_ellipse(read: Read) -> None:
    def draw(space: Any) -> None:
        space.doc.blocks.new("POST").add_circle((0, 0), 1)
        space.add_blockref("POST", (5, 5), dxfattribs={"xscale": 3})

    ring = read(draw)["obstacles"][0]
    assert_covers(ring, (arc(0, 0, 1, 0, 2 * np.pi) * [3, 1] + 5)[:-1])


@pytest.fixture
def yard(tmp_path: Path) -> Path:
    """A drawing in mm with bounds, poses, and layers that are off, frozen, ignored and chosen."""
    document = ezdxf.new(units=4)
    space = document.modelspace()

    def box(x: float, y: float, w: float, h: float, layer: str) -> None:
        corners = [(x, y), (x + w, y), (x + w, y + h), (x, y + h)]
        space.add_lwpolyline([(1000 * u, 1000 * v) for u, v in corners], close=True, dxfattribs={"layer": layer})

    box(-5, -10, 35, 25, "Bounds")
    box(6, -3, 3, 4, "walls")
    box(12, 8, 1, 1, "Posts")
    for x, layer in enumerate(("Ignore_this", "DEFPOINTS", "off", "frozen")):
        box(3 * x, 5, 1, 1, layer)
    document.layers.get("off").off() if "off" in document.layers else document.layers.add("off").off()
    document.layers.add("frozen").freeze()
    space.add_line((0, 0), (1000, 0), dxfattribs={"layer": "start"})
    space.add_line((18000, 4000), (18000, 5000), dxfattribs={"layer": "Goal"})
    space.add_text("not an obstacle")
    space.add_text("neither", dxfattribs={"layer": "BOUNDS"})
    document.saveas(tmp_path / "yard.dxf")
    return tmp_path / "yard.dxf"


def test_all_that_a_drawing_shows_is_kept_exactly(tmp_path: Path) -> None:
    path = tmp_path / "all.dxf"
    document = ezdxf.new(units=1)
    space = document.modelspace()
    space.add_line((0, 0), (100, 30), dxfattribs={"layer": "START"})
    space.add_line((900, 0), (1000, 30), dxfattribs={"layer": "GOAL"})
    space.add_circle((0, 0), 2000, dxfattribs={"layer": "BOUNDS"})
    space.add_circle((400, 400), 7)
    space.add_arc((500, -300), 77, 10, 200)
    space.add_point((300, 500))
    hatch = space.add_hatch()
    hatch.paths.add_polyline_path([(0, 400), (90, 400), (90, 490), (0, 490)])
    hatch.paths.add_polyline_path([(30, 430), (60, 430), (60, 460), (30, 460)])
    document.saveas(path)
    scenario = Scenario.load(path)
    scenario.save(tmp_path / "all.json")
    again = Scenario.load(tmp_path / "all.json")
    assert again.to_dict() == scenario.to_dict()
    assert set(scenario.to_dict()) >= {"obstacles", "lines", "points", "bounds"}
    assert scenario.end_clearances.min() > 0


def test_layers_say_what_things_are(yard: Path) -> None:
    scenario = Scenario.load(yard)
    assert scenario.name == "yard" and scenario.bounds == (-5, 30, -10, 15)
    np.testing.assert_allclose(scenario.start, [0, 0, 0])
    np.testing.assert_allclose(scenario.goal, [18, 4, math.pi / 2])
    assert [polygon.bounds for polygon in scenario.polygons] == [(6, -3, 9, 1), (12, 8, 13, 9)]
    assert Scenario.from_dict(scenario.to_dict()).to_dict() == scenario.to_dict()


def test_chosen_layers_are_the_only_obstacles(yard: Path) -> None:
    assert [polygon.bounds for polygon in Scenario.load(yard, layers=["POSTS"]).polygons] == [(12, 8, 13, 9)]
    chosen = Scenario.load(yard, layers=["walls", "Off"], goal=(20, 4, 0))
    assert [polygon.bounds for polygon in chosen.polygons] == [(6, -3, 9, 1), (6, 5, 7, 6)]
    assert chosen.bounds == (-5, 30, -10, 15) and chosen.goal.tolist() == [20, 4, 0]
    with pytest.raises(ValueError, match="--layers: there is no layer 'hedges'; there are 0, "):
        Scenario.load(yard, layers=["hedges"])
    with pytest.raises(ValueError, match="^map_a: --layers: only a .dxf file has layers"):
        Scenario.load("map_a", layers=["hedges"])


def test_layers_are_named_on_the_command_line(yard: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(yard), "--layers", "walls, Hedges", "--out", str(yard.parent / "out")]) == BAD_INPUT
    said = capsys.readouterr().err
    assert said.startswith(f"{yard}: --layers: there is no layer 'Hedges'; there are 0, ") and said.count("\n") == 1
    with pytest.raises(SystemExit) as exit_:
        main([str(yard), "--layers", "walls,,posts"])
    assert exit_.value.code == BAD_INPUT and "must be names with commas between" in capsys.readouterr().err


def test_what_is_left_out_is_counted_in_one_line(read: Read, caplog: pytest.LogCaptureFixture) -> None:
    def draw(space: Any) -> None:
        space.add_text("a")
        space.add_text("b")
        space.add_mtext("c")
        space.add_polymesh((3, 3))

    caplog.set_level(logging.INFO, "drake_gnnocp")
    assert read(draw)["obstacles"] == []
    said = [(record.levelname, record.getMessage()) for record in caplog.records if "drake" in record.name]
    assert said == [("WARNING", "left out: 1 MTEXT, 1 POLYLINE, 2 TEXT")]


def test_poses_are_lines_blocks_and_points(read: Read) -> None:
    def draw(space: Any) -> None:
        space.doc.blocks.new("CAR").add_circle((0, 0), 1)
        space.add_blockref("CAR", (1, 2), dxfattribs={"layer": "START", "rotation": 30, "xscale": 2})
        space.add_point((5, 6), dxfattribs={"layer": "GOAL"})
        space.add_lwpolyline([(9, 9), (8, 9)], dxfattribs={"layer": "goal"})

    found = read(draw)
    np.testing.assert_allclose(found["start"], [1, 2, math.pi / 6])
    assert found["goals"] == [[5, 6, None], [9, 9, math.pi]] and "goal" not in found
    assert found["obstacles"] == []


def on(layer: str) -> dict[str, str]:
    return {"layer": layer}


def recursive(space: Any) -> None:
    block = space.doc.blocks.new("SELF")
    block.add_blockref("SELF", (1, 1))
    space.add_blockref("SELF", (0, 0))


BOW_TIE = [(0, 0), (4, 4), (4, 0), (0, 4)]
MANY = {"row_count": 1000, "column_count": 1000, "row_spacing": 1, "column_spacing": 1}
FAULTS: list[tuple[Draw, str]] = [
    (lambda space: space.add_lwpolyline(BOW_TIE, close=True), "LWPOLYLINE .* on layer '0': crosses itself"),
    (lambda space: space.add_line((0, 0), (4, 4), dxfattribs=on("BOUNDS")), "LINE .*: must be a closed polyline, as b"),
    (
        lambda space: [space.add_circle((0, 0), r, dxfattribs=on("BOUNDS")) for r in (8, 9)],
        ".*: is a second one; there",
    ),
    (lambda space: [space.add_line((0, 0), (r, 0), dxfattribs=on("START")) for r in (8, 9)], ".*: is a second one; th"),
    (lambda space: space.add_circle((0, 0), 1, dxfattribs=on("GOAL")), "CIRCLE .*: must be a LINE, an INSERT or"),
    (lambda space: space.add_line((1, 0), (1, 0), dxfattribs=on("GOAL")), "LINE .*: has no length"),
    (lambda space: space.add_point((1, 0), dxfattribs=on("START")), "POINT .*: shows no heading of the start"),
    (lambda space: space.add_circle((0, 0), 1, dxfattribs={"extrusion": (0, 1, 1)}), "CIRCLE .*: lies in a tilted pl"),
    (lambda space: space.add_circle((0, 0), 1e9), r"CIRCLE .*: is a curve with a radius of 1e\+09 m: is the drawing's"),
    (lambda space: space.add_open_spline([(0, 0), (1e6, 0), (0, 1e6), (1, 1)]), "SPLINE .*: is a curve larger than"),
    (lambda space: space.add_line((0, 0), (1e13, 0)), "LINE .*: has a coordinate that is not finite or beyond"),
    (lambda space: space.add_blockref("NONE", (0, 0)), "INSERT on layer '0': there is no block 'NONE'"),
    (recursive, "INSERT on layer '0': has more than 20 blocks within blocks"),
    (
        lambda space: [space.doc.blocks.new("A"), space.add_blockref("A", (0, 0), dxfattribs=MANY)],
        "file: has more than",
    ),
]


@pytest.mark.parametrize(("draw", "message"), FAULTS, ids=lambda value: value if isinstance(value, str) else "")
def test_what_cannot_be_taken_is_refused_by_name(read: Read, draw: Draw, message: str) -> None:
    with pytest.raises(ValueError, match=f"^{message}"):
        read(draw)


def test_a_binary_drawing_is_as_good_as_a_text(tmp_path: Path) -> None:
    document = ezdxf.new(units=6)
    document.modelspace().add_lwpolyline(SQUARE, close=True)
    document.saveas(tmp_path / "binary.dxf", fmt="bin")
    assert area(read_dxf(tmp_path / "binary.dxf")["obstacles"][0]).equals(shapely.Polygon(SQUARE))


def test_without_ezdxf_one_line_says_what_to_install(yard: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ezdxf", None)
    with pytest.raises(ValueError, match=r"yard.dxf: ezdxf is not installed: pip install -e \.\[dxf\]$"):
        Scenario.load(yard)


def test_a_drawing_without_poses_asks_for_them(tmp_path: Path) -> None:
    document = ezdxf.new(units=6)
    document.modelspace().add_lwpolyline([(6, -3), (9, -3), (9, 1)], close=True)
    document.saveas(tmp_path / "bare.dxf")
    with pytest.raises(
        ValueError, match="start and goal: missing; where the file has none, give --start X Y THETA --goal X"
    ):
        Scenario.load(tmp_path / "bare.dxf")
    assert Scenario.load(tmp_path / "bare.dxf", start=(0, 0, 0), goal=(15, 0, 0)).goal.tolist() == [15, 0, 0]
