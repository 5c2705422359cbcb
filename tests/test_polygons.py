"""Polygons: what is refused, what a ring bounds exactly, and convex parts that cover it exactly."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
import shapely

from drake_gnnocp.convex import convex_parts
from drake_gnnocp.polygons import clean_ring, merged, polygons_of, signed_area

Points = Sequence[tuple[float, float]]

SAME_AREA = 1e-9  # relative: shapely's overlay rounds intersections to about 1e-15 of the coordinates
STRAIGHT = 1e-9  # of an edge's length: a collinear vertex may be this far inside the hull by rounding
FAR = np.array([1e9, -1e9])  # m, world coordinates: one ulp is 1.2e-7 m
FAR_AREA = 1e-6  # relative, of a shape of a few metres whose vertices are rounded to 1.2e-7 m

SQUARE: Points = [(0, 0), (4, 0), (4, 4), (0, 4)]
CONCAVE: dict[str, Points] = {
    "L": [(0, 0), (4, 0), (4, 1), (1, 1), (1, 3), (0, 3)],
    "U": [(0, 0), (5, 0), (5, 4), (4, 4), (4, 1), (1, 1), (1, 4), (0, 4)],
    "C": [(0, 0), (4, 0), (4, 1), (1, 1), (1, 4), (4, 4), (4, 5), (0, 5)],
    "arrow": [(0, 0), (2, 1), (0, 2), (0.5, 1)],
    "collinear": [(0, 0), (1, 0), (2, 0), (4, 0), (4, 2), (4, 4), (2, 4), (2, 3), (2, 2), (1, 2), (0, 2), (0, 1)],
}


def ring_of(points: Points) -> np.ndarray:
    return np.array(points, dtype=float)


def comb(teeth: int) -> np.ndarray:
    """A bar with teeth: four vertices a tooth."""
    tops = [(i + dx, y) for i in reversed(range(teeth)) for dx, y in [(0.75, 1), (0.75, 0.2), (0.25, 0.2), (0.25, 1)]]
    return ring_of([(0, 0), (teeth, 0), *tops])


def spiral(turns: float, n: int) -> np.ndarray:
    """A band between two Archimedean spirals."""
    angle = np.linspace(0, 2 * math.pi * turns, n)
    ray = np.column_stack([np.cos(angle), np.sin(angle)])
    return np.concatenate([ray * (2 + angle)[:, None], (ray * (1 + angle)[:, None])[::-1]])


def star(rng: np.random.Generator) -> np.ndarray:
    """A random star-shaped polygon, mostly concave, with collinear and repeated vertices, either way around."""
    n = int(rng.integers(3, 25))
    angle = 2 * math.pi * (np.arange(n) + rng.uniform(-0.4, 0.4, n)) / n
    ring = rng.uniform(0.5, 10, (n, 1)) * np.column_stack([np.cos(angle), np.sin(angle)])
    middles = (ring + np.roll(ring, -1, axis=0)) / 2
    pieces = [np.vstack(rows) for rows in zip(ring, middles, middles, ring.copy(), strict=True)]
    chosen = [piece[: int(rng.integers(1, 4))] for piece in pieces]  # vertex, then its edge's middle once or twice
    ring = np.concatenate(chosen) + rng.uniform(-20, 20, 2)
    return ring[::-1] if rng.random() < 0.5 else ring


def check_parts(polygon: shapely.Polygon, relative: float = SAME_AREA) -> list[np.ndarray]:
    """Assert everything that convex parts promise; returns them."""
    parts = convex_parts(polygon)
    shapes = [shapely.Polygon(part) for part in parts]
    for part, shape in zip(parts, shapes, strict=True):
        assert shape.is_valid
        assert signed_area(part) > 0
        assert shape.convex_hull.area - shape.area <= STRAIGHT * shape.length**2
    area = polygon.area
    assert sum(shape.area for shape in shapes) == pytest.approx(area, rel=relative)
    assert shapely.union_all(shapes).symmetric_difference(polygon).area <= relative * area
    given = {tuple(vertex) for vertex in shapely.get_coordinates(polygon)}
    assert {tuple(vertex) for part in parts for vertex in part} <= given
    return parts


def test_signed_area_is_positive_counter_clockwise() -> None:
    assert signed_area(ring_of(SQUARE)) == 16
    assert signed_area(ring_of(SQUARE)[::-1]) == -16
    assert signed_area(ring_of(SQUARE)[:2]) == 0


def test_signed_area_keeps_its_digits_far_from_the_origin() -> None:
    assert signed_area(ring_of(SQUARE) + FAR) == 16


def test_cleaning_drops_repeated_vertices_and_the_closing_one() -> None:
    ring = ring_of([(0, 0), (0, 0), (4, 0), (4, 4), (4, 4), (4, 4), (0, 4), (0, 0)])
    assert {tuple(vertex) for vertex in clean_ring(ring)} == set(SQUARE)
    assert len(clean_ring(ring)) == 4
    assert signed_area(clean_ring(ring[::-1])) == 16


@pytest.mark.parametrize("offset", [np.zeros(2), FAR])
@pytest.mark.parametrize(
    ("points", "areas", "holes"),
    [
        ([(0, 0), (2, 0), (1, 1), (2, 2), (0, 2), (1, 1)], [1, 1], 0),  # two triangles tip to tip
        ([(0, 0), (4, 0), (4, 4), (3, 4), (2, 0), (1, 4), (0, 4)], [6, 6], 0),  # a notch as deep as the whole
        ([(0, 0), (4, 0), (4, 4), (2, 4), (3, 2), (1, 2), (2, 4), (0, 4)], [14], 1),  # a hole that touches the rim
        (SQUARE, [16], 0),
    ],
)
def test_a_ring_that_touches_itself_bounds_exactly_its_area(
    points: Points, areas: list[float], holes: int, offset: np.ndarray
) -> None:
    for ring in (ring_of(points), ring_of(points)[::-1]):
        pieces = polygons_of(ring + offset)
        assert [piece.area for piece in pieces] == pytest.approx(areas, rel=FAR_AREA if offset.any() else SAME_AREA)
        assert sum(len(piece.interiors) for piece in pieces) == holes
        for piece in pieces:
            check_parts(piece, FAR_AREA if offset.any() else SAME_AREA)


def test_a_vertex_that_touches_an_edge_but_for_rounding_is_no_spike() -> None:
    notched = ring_of([(0, 0), (4, 0), (4, 4), (3, 4), (2, 0), (1, 4), (0, 4)])
    rng = np.random.default_rng(0)
    for angle, x, y in rng.uniform(-5, 5, (100, 3)):
        cos, sin = math.cos(angle), math.sin(angle)
        ring = notched @ [[cos, sin], [-sin, cos]] + [x, y]
        for offset, same in ((0, SAME_AREA), (FAR, FAR_AREA)):
            assert sum(piece.area for piece in polygons_of(ring + offset)) == pytest.approx(12, rel=same)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ([(0, 0), (4, 4), (4, 0), (0, 4)], "crosses itself"),  # bow-tie with equal halves
        ([(0, 0), (4, 4), (4, 1), (0, 4)], "crosses itself"),  # and with unequal ones
        ([*SQUARE, *SQUARE], "crosses itself"),  # goes around twice
        # as much area is wound around twice (inside, right) as backwards (above): the sum of the areas is no sign of it
        (
            [
                *[(0, 0), (10, 0), (10, 5), (8, 5), (8, 4), (9, 4), (9, 6), (10, 6), (10, 10)],
                *[(4, 10), (4, 11), (5, 11), (5, 9), (0, 9)],
            ],
            "crosses itself",
        ),
        ([(0, 0), (4, 0), (4, 4), (2, 4), (2, 6), (2, 4), (0, 4)], "runs back"),  # a spike outwards
        ([(0, 0), (4, 0), (4, 4), (2, 4), (2, 2), (2, 4), (0, 4)], "runs back"),  # a slit inwards
        ([(0, 0), (6, 0), (4, 0), (4, 4), (0, 4)], "runs back"),  # a spike along an edge
        ([(0, 0), (1, 1), (2, 2)], "has no area"),
        ([(0, 0), (1, 1), (0, 0), (1, 1)], "has no area"),
        ([(0, 0), (1, 0), (1, 1.5e-9)], "has no area"),
        ([(1, 1), (1, 1), (1, 1)], "fewer than 3 different vertices"),
        ([(0, 0), (1, 1), (1, 1)], "fewer than 3 different vertices"),
        ([(0, 0), (1, math.nan), (1, 1)], "not finite"),
        ([(0, 0), (1, math.inf), (1, 1)], "not finite"),
    ],
)
def test_a_ring_that_bounds_no_clear_region_is_refused(points: Points, message: str) -> None:
    for ring in (ring_of(points), ring_of(points)[::-1]):
        with pytest.raises(ValueError, match=message):
            polygons_of(ring)


def test_a_convex_ring_stays_whole() -> None:
    (part,) = convex_parts(shapely.Polygon([(0, 0), (2, 0), (4, 0), (4, 4), (0, 4)]))
    assert len(part) == 5


@pytest.mark.parametrize("name", CONCAVE)
def test_concave_shapes_split_into_convex_parts_that_cover_them(name: str) -> None:
    for ring in (ring_of(CONCAVE[name]), ring_of(CONCAVE[name])[::-1]):
        (polygon,) = polygons_of(ring)
        reflex = 3  # no shape above has more than three reflex corners
        assert 2 <= len(check_parts(polygon)) <= 2 * reflex + 1


@pytest.mark.parametrize("seed", range(200))
def test_random_stars_split_into_convex_parts_that_cover_them(seed: int) -> None:
    (polygon,) = polygons_of(star(np.random.default_rng(seed)))
    check_parts(polygon)


@pytest.mark.parametrize("ring", [spiral(0.9, 30), spiral(2.0, 60), comb(12)], ids=["arc", "spiral", "comb"])
def test_winding_shapes_split_into_convex_parts_that_cover_them(ring: np.ndarray) -> None:
    (polygon,) = polygons_of(ring)
    check_parts(polygon)


def test_holes_stay_free() -> None:
    hole = [(1, 1), (1, 3), (3, 3), (3, 1)]
    check_parts(shapely.Polygon(SQUARE, [hole]))


def test_merging_leaves_at_most_two_parts_a_reflex_corner_and_one() -> None:
    teeth = 40  # two reflex corners between neighbours and at either end; Hertel and Mehlhorn's bound
    assert len(check_parts(polygons_of(comb(teeth))[0])) <= 2 * (2 * teeth) + 1


def test_a_polygon_of_a_thousand_vertices_is_split_without_deep_recursion() -> None:
    check_parts(polygons_of(comb(250))[0])


def test_how_a_region_is_cut_makes_no_difference_to_the_merged_one() -> None:
    steps = np.linspace(0.0, 2.0, 11)  # whose sums are rounded: neighbours miss each other by an ulp
    cells = [shapely.box(0.3 + x, y, 0.3 + x + 0.2, y + 0.2) for x in steps[:-1] for y in steps[:-1]]
    alone = shapely.Point(9.0, 9.0).buffer(0.5)
    first, wall = merged([*cells, alone])
    assert first is alone
    assert len(clean_ring(np.array(wall.exterior.coords))) == 4
    assert wall.area == pytest.approx(4.0, rel=SAME_AREA)
    frame = merged([shapely.box(0, 0, 5, 1), shapely.box(0, 4, 5, 5), shapely.box(0, 0, 1, 5), shapely.box(4, 0, 5, 5)])
    assert [len(polygon.interiors) for polygon in frame] == [1]


def test_slivers_that_rounding_leaves_are_no_pieces_and_long_ones_no_polygons() -> None:
    speck = ring_of([(0, 2), (3, 1), (0, 1.000001), (0, 1.000000001), (-1e-9, 1.5)])
    for piece in polygons_of(speck):
        check_parts(piece)
    needle = ring_of([(0, 0), (4, 0), (4, 4), (2, 4), (2 + 1e-10, 7), (2, 4 - 1e-12), (0, 4)])
    with pytest.raises(ValueError, match="has no area, or runs back along one of its own edges"):
        polygons_of(needle)


def test_rings_with_more_crossings_than_could_be_repaired_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shapely, "make_valid", None)
    rng = np.random.default_rng(0)
    on_a_line = np.column_stack([rng.uniform(0, 10, 500), np.zeros(500)])
    for ring, message in ((rng.uniform(0, 10, (500, 2)), "crosses itself"), (on_a_line, "has no area")):
        with pytest.raises(ValueError, match=message):
            polygons_of(ring + FAR)
