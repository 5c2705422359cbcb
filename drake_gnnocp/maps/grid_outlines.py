"""The outlines of what is occupied in a grid, exactly: polygons that run along the sides of cells.

The corners of all outlines are the lattice points where one or three of the four cells around are occupied, and those
where two diagonal ones are: these touch in a point, and two corners lie there, one of each cell. Along a row of the
lattice corners are in turn the left and the right end of a side of an outline, along a column the lower and the upper
end. So each corner has a partner in its row and one in its column: outlines are the cycles from partner to partner.

At a diagonal contact the partners in the column are chosen so that outlines go around the cells, and what only touches
stays apart: one polygon for all cells that are connected by sides. Where an outline comes through a contact twice (its
cells are connected another way round), the two corners exchange their partners. That cuts the outline into two which
touch in a point, one of them a hole. So all polygons are valid, share no area, and leave no gap where cells touch.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
import shapely

from drake_gnnocp.maps.occupancy_grid import MEANINGS, Grid
from drake_gnnocp.shapes import Area
from drake_gnnocp.vehicle import Vehicle

SW, SE, NW, NE = 1, 2, 4, 8  # bits for the cells around a lattice point
FALLING = SE | NW  # the diagonal contact of which the lower cell is the right one
CORNERS = np.array([code.bit_count() % 2 + 2 * (code in (SW | NE, FALLING)) for code in range(16)], dtype=np.uint8)
MOST_CORNERS = 5_000_000  # they take 100 bytes each
COLLISION = re.compile(r"(?P<end>start|goal)(s\[(?P<i>\d+)\])?: the car collides with obstacles\[(?P<j>\d+)\]")


def outlines(grid: Grid) -> list[shapely.Polygon]:
    """Valid polygons that together cover the occupied cells exactly, with holes; they share no more than corners.

    Their vertices are corners only, none is straight [m].

    Raises:
        ValueError: they would have more than five million corners.
    """
    ny, nx = np.array(grid.occupied.shape) + 1
    code = _cells_around(grid.occupied).ravel()
    at = np.flatnonzero(CORNERS[code])  # the lattice points with corners, row by row
    at = np.repeat(at, CORNERS[code[at]])
    if not len(at):
        return []
    if len(at) > MOST_CORNERS:
        raise ValueError(f"cells: what is occupied has {len(at)} corners, and at most {MOST_CORNERS} are possible")
    y, x = np.divmod(at, nx)
    place = x * ny + y  # counted column by column
    order, first, by_column = _linked(at, place, code[at] == FALLING)
    ring_of = _ring_of(order, first)
    lowest = np.minimum.reduceat(at[order], first)  # lattice point of each ring, its leftmost
    is_hole = (code[lowest] & NE) == 0
    owner = np.arange(len(first))
    owner[is_hole] = _ring_to_the_left(grid.occupied, lowest[is_hole], np.sort(place), ring_of[by_column])
    while is_hole[owner].any():  # a hole to the left of a hole
        owner = owner[owner]
    rings = shapely.linearrings(grid.in_world(np.column_stack([x, y])[order]), indices=ring_of[order])
    _, polygon_of = np.unique(owner, return_inverse=True)
    outer_first = np.lexsort([is_hole, polygon_of])
    return list(shapely.polygons(rings[outer_first], indices=polygon_of[outer_first]))


def _cells_around(occupied: np.ndarray) -> np.ndarray:
    """Which of the cells around each lattice point are occupied: (ny + 1, nx + 1), bits."""
    cells = np.pad(occupied, 1).view(np.uint8)
    pairs = cells[:, :-1] | cells[:, 1:] << 1
    return pairs[:-1] | pairs[1:] << 2


def _linked(at: np.ndarray, place: np.ndarray, is_falling: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The rings of corners.

    Args:
        at: (C,) lattice point of each corner, counted row by row, and in this order.
        place: (C,) the same, counted column by column.
        is_falling: (C,) whether it lies at a falling contact.

    Returns:
        All corners in the order of their rings; where in it each ring begins; and all corners in the order of columns,
        lower and upper ends of sides in turn.
    """
    by_column, partner = _column_partners(place, is_falling)
    order, first = _cycles(partner)
    ring_of = _ring_of(order, first)
    contact = np.flatnonzero(at[1:] == at[:-1])
    twice = contact[ring_of[contact] == ring_of[contact + 1]]
    if len(twice):
        exchanged = np.arange(len(at))
        exchanged[twice], exchanged[twice + 1] = twice + 1, twice
        by_column, partner = exchanged[by_column], exchanged[partner[exchanged]]
        order, first = _cycles(partner)
    return order, first, by_column


def _column_partners(place: np.ndarray, is_falling: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The partners of corners in their columns.

    Args:
        place: (C,) of each corner, counted column by column.
        is_falling: (C,) whether it lies at a falling contact.

    Returns:
        The corners ordered by column, lower and upper ends of sides in turn, and the partner of each corner.
    """
    # Two corners of a contact follow each other: the first is the right end of a side, the second the left end of one.
    # The first is also the upper end of a side where it is the lower left cell's, the lower end where the upper left's.
    is_second = np.append(False, place[1:] == place[:-1])
    by_column = np.argsort(2 * place + (is_second ^ is_falling), kind="stable")
    partner = np.empty(len(place), dtype=int)
    partner[by_column[::2]], partner[by_column[1::2]] = by_column[1::2], by_column[::2]
    return by_column, partner


def _cycles(partner: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All corners in the order of their rings, and where in it each ring begins."""
    n = len(partner)
    follow = partner[np.arange(n) ^ 1].tolist()  # along the row to the right or left, and then along the column
    is_left = bytearray(b"\1") * n
    order: list[int] = []
    first: list[int] = []
    for start in range(0, n, 2):
        if is_left[start]:
            first.append(2 * len(order))
            corner = start
            while is_left[corner]:
                is_left[corner] = is_left[corner ^ 1] = 0
                order.append(corner)
                corner = follow[corner]
    ends = np.array(order)
    return np.column_stack([ends, ends ^ 1]).ravel(), np.array(first)


def _ring_of(order: np.ndarray, first: np.ndarray) -> np.ndarray:
    """The ring of each corner."""
    ring_of = np.empty(len(order), dtype=int)
    ring_of[order] = np.repeat(np.arange(len(first)), np.diff(first, append=len(order)))
    return ring_of


def _ring_to_the_left(occupied: np.ndarray, lowest: np.ndarray, places: np.ndarray, ring_of: np.ndarray) -> np.ndarray:
    """The rings that lie to the left of holes, with nothing but occupied cells in between.

    Args:
        occupied: (ny, nx) cells.
        lowest: (H,) the lowest lattice point of each hole, its leftmost.
        places: (C,) of the corners, counted column by column and in this order.
        ring_of: (C,) the ring of each corner, in the same order.
    """
    ny, nx = occupied.shape
    begins = np.flatnonzero(np.diff(occupied, axis=1, prepend=False) & occupied)  # of what is occupied in a row
    y, x = np.divmod(lowest, nx + 1)
    cell = y * nx + x - 1
    row, column = np.divmod(begins[np.searchsorted(begins, cell, "right") - 1], nx)
    side = np.searchsorted(places[::2], column * (ny + 1) + row, "right") - 1
    return ring_of[2 * side]


def fields_of_grid(grid: Grid) -> dict[str, Any]:
    """The fields `obstacles` and `bounds` of a scenario on a grid."""
    polygons = outlines(grid)
    closed, polygon_of = shapely.get_rings(polygons, return_index=True)
    points, counts = shapely.get_coordinates(closed), shapely.get_num_coordinates(closed)
    rings: list[list[np.ndarray]] = [[] for _ in polygons]
    for j, end, count in zip(polygon_of, np.cumsum(counts), counts, strict=True):
        rings[j].append(points[end - count : end - 1])
    areas = (Area(ring, tuple(holes)) if holes else ring for ring, *holes in rings)
    return {"obstacles": tuple(areas), "bounds": grid.bounds}


def with_places(message: str, fields: Mapping[str, Any], unknown: str) -> str:
    """What is said of a scenario on a grid, with places for the numbers of obstacles: nobody has given them.

    Args:
        message: of an error.
        fields: of the scenario.
        unknown: what unknown cells were taken for.
    """
    cell = "an occupied (or unknown) cell" if unknown == MEANINGS[0] else "an occupied cell"

    def placed(found: re.Match[str]) -> str:
        end, i = found["end"], found["i"]
        pose = np.array(fields[end] if i is None else fields[f"{end}s"][int(i)], dtype=float)
        car = shapely.Polygon((fields.get("vehicle") or Vehicle()).footprints(pose)[0])
        area = fields["obstacles"][int(found["j"])]
        cells = shapely.Polygon(area.ring, area.holes) if isinstance(area, Area) else shapely.Polygon(area)
        x, y = shapely.get_coordinates(shapely.shortest_line(car, cells))[1]
        return f"{found[0].partition(':')[0]}: the car collides with {cell} near ({x:.2f}, {y:.2f})"

    return COLLISION.sub(placed, message)
