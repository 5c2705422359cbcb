"""What stands in a car's way, as exact shapes: areas, lines without thickness, points and discs, and a fence.

Planners want areas with an inside: there, lines and points are as thick as a hair. The check looks at the exact shapes.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import shapely

from drake_gnnocp.polygons import NO_AREA, SMALLEST_AREA, polygons_of, signed_area, simple_polygons

HAIR = 1e-4  # m, half the thickness of lines and points where an area is wanted
DISC_SIDES = 24  # of the polygon around a disc: its corners are 0.9 % of the radius outside
FRAME = 20.0  # m, thickness of what is outside of a fence where an area is wanted
MOST_WITHOUT_AREA = 1000  # vertices of a ring that is asked whether it has an area: repairing larger ones takes minutes

logger = logging.getLogger(__name__)


class Area(NamedTuple):
    """An obstacle with holes."""

    ring: np.ndarray  # (N, 2) [m]
    holes: tuple[np.ndarray, ...] = ()  # rings (M, 2) [m]


@dataclass(frozen=True, eq=False)
class Shapes:
    """What a car must not touch, and the fence that it must stay inside of."""

    polygons: np.ndarray  # (P,) areas
    lines: np.ndarray  # (L,) polylines; a point is one of no length
    names: tuple[str, ...]  # (P + L,) of which entry of the scenario each is
    fence: shapely.Polygon | None = None

    @cached_property
    def all(self) -> np.ndarray:
        """Polygons and lines: (P + L,)."""
        return np.append(self.polygons, self.lines)

    @cached_property
    def outlines(self) -> shapely.MultiLineString:
        """The outlines of the polygons, and the lines, prepared: one needs no more for a car that begins outside."""
        outlines = shapely.multilinestrings(np.append(shapely.get_rings(self.polygons), self.lines))
        shapely.prepare(outlines)
        return outlines

    @cached_property
    def fence_line(self) -> shapely.LinearRing | None:
        """The outline of the fence, prepared."""
        if self.fence is None:
            return None
        shapely.prepare(self.fence.exterior)
        return self.fence.exterior

    @cached_property
    def things(self) -> np.ndarray:
        """What stands in the way as polygons, lines and points as thick as a hair."""
        return np.append(self.polygons, shapely.get_parts(_thick(self.lines)))

    @cached_property
    def areas(self) -> np.ndarray:
        """The `things`, and what is outside of the fence: a frame around it."""
        if self.fence is None:
            return self.things
        around = shapely.box(*_grown(self.fence.bounds, FRAME))
        return np.append(self.things, shapely.get_parts(around.difference(self.fence)))

    def distances(self, polygons: np.ndarray) -> np.ndarray:
        """Of polygons (N,) from the nearest shape or the fence: (N,) infinite without one [m]."""
        found = np.full(len(polygons), math.inf)
        if len(self.all):
            which, distances = self._tree.query_nearest(polygons, return_distance=True, all_matches=False)
            found[which[0]] = distances
        return found if self.fence_line is None else np.minimum(found, shapely.distance(self.fence_line, polygons))

    def near(self, polygon: shapely.Polygon, distance: float) -> Shapes:
        """The shapes whose boxes are within a distance of that of a polygon [m]."""
        which = np.sort(self._tree.query(shapely.box(*_grown(polygon.bounds, distance))))
        names = tuple(self.names[i] for i in which)
        return Shapes(
            self.polygons[which[which < len(self.polygons)]],
            self.lines[which[which >= len(self.polygons)] - len(self.polygons)],
            names,
        )

    def touched_by(self, polygon: shapely.Polygon, tolerance: float) -> str | None:
        """The name of the first shape that a polygon is within a tolerance of [m]; None where there is none."""
        touched = self._tree.query(polygon, predicate="dwithin", distance=tolerance)
        return self.names[touched.min()] if len(touched) else None

    @cached_property
    def _tree(self) -> shapely.STRtree:
        return shapely.STRtree(self.all)

    def mapped(self, change: Callable[[np.ndarray], np.ndarray]) -> Shapes:
        """The shapes with other coordinates, which `change` gives for coordinates (N, 2)."""
        fence = None if self.fence is None else shapely.transform(self.fence, change)
        return Shapes(
            shapely.transform(self.polygons, change), shapely.transform(self.lines, change), self.names, fence
        )


def _grown(box: tuple[float, float, float, float], distance: float) -> tuple[float, float, float, float]:
    xmin, ymin, xmax, ymax = box
    return xmin - distance, ymin - distance, xmax + distance, ymax + distance


def _thick(lines: np.ndarray) -> np.ndarray:
    """Polylines as areas: (L,)."""
    thick = shapely.buffer(lines, HAIR, cap_style="square", join_style="mitre")
    is_point = shapely.length(lines) == 0
    thick[is_point] = shapely.buffer(shapely.centroid(lines[is_point]), HAIR, cap_style="square")
    return thick


def shapes_of(
    obstacles: Sequence[np.ndarray | Area],
    lines: Sequence[np.ndarray],
    points: np.ndarray,
    fence: np.ndarray | None,
) -> Shapes:
    """The exact shapes of a scenario's entries.

    Args:
        obstacles: rings (N, 2), or areas with holes [m].
        lines: polylines (N, 2) [m].
        points: (K, 3) x, y, radius [m].
        fence: ring (N, 2) [m].

    Raises:
        ValueError: an entry is none; the message begins with its name.
    """
    polygons: list[Iterable[shapely.Polygon]] = []
    thin: list[shapely.LineString] = []
    names: list[str] = []
    names_of_thin: list[str] = []
    plain = simple_polygons([obstacle for obstacle in obstacles if isinstance(obstacle, np.ndarray)])
    for j, obstacle in enumerate(obstacles):
        name = f"obstacles[{j}]"
        found = next(plain) if isinstance(obstacle, np.ndarray) else None
        try:
            pieces = [found] if found is not None else _pieces(obstacle)
        except _NoArea as no_area:
            logger.warning("%s: has no area: it is taken as a line", name)
            thin.append(no_area.line)
            names_of_thin.append(name)
            continue
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from None
        polygons.append(pieces)
        names += [name] * len(pieces)
    for j, line in enumerate(lines):
        if len(line) < 2:
            raise ValueError(f"lines[{j}]: must have at least 2 vertices")
        thin.append(shapely.LineString(line))
        names_of_thin.append(f"lines[{j}]")
    is_disc = points[:, 2] > 0
    polygons.append(_discs(points[is_disc]))
    names += [f"points[{k}]" for k in np.flatnonzero(is_disc)]
    thin += list(shapely.linestrings(np.repeat(points[~is_disc, None, :2], 2, axis=1)))
    names_of_thin += [f"points[{k}]" for k in np.flatnonzero(~is_disc)]
    flat = [piece for pieces in polygons for piece in pieces]
    return Shapes(_objects(flat), _objects(thin), (*names, *names_of_thin), _fence(fence))


class _NoArea(ValueError):
    def __init__(self, line: shapely.LineString) -> None:
        super().__init__(NO_AREA)
        self.line = line


def _pieces(obstacle: np.ndarray | Area) -> Sequence[shapely.Polygon]:
    if isinstance(obstacle, Area):
        solid = shapely.union_all(polygons_of(obstacle.ring))
        holes = [piece for hole in obstacle.holes for piece in polygons_of(hole)]
        parts = shapely.get_parts(solid.difference(shapely.union_all(holes)))
        parts = parts[shapely.area(parts) > SMALLEST_AREA]
        if not len(parts):
            raise ValueError("its holes leave no area")
        return list(parts)
    try:
        return polygons_of(obstacle)
    except ValueError:
        if not np.isfinite(obstacle).all() or not len(obstacle) or not _has_no_area(obstacle):
            raise
        raise _NoArea(shapely.LineString(np.concatenate([obstacle, obstacle[:1]]))) from None


def _has_no_area(ring: np.ndarray) -> bool:
    if abs(signed_area(ring)) > SMALLEST_AREA or len(ring) > MOST_WITHOUT_AREA:
        return False
    return len(ring) < 3 or bool(shapely.make_valid(shapely.Polygon(ring - ring[0])).area <= SMALLEST_AREA)


def _discs(points: np.ndarray) -> np.ndarray:
    """Polygons (K,) around discs (K, 3) x, y, radius [m]."""
    angles = 2 * np.pi * np.arange(DISC_SIDES) / DISC_SIDES
    corners = np.column_stack([np.cos(angles), np.sin(angles)]) / math.cos(np.pi / DISC_SIDES)
    return np.atleast_1d(shapely.polygons(points[:, None, :2] + points[:, None, 2:] * corners))


def _fence(ring: np.ndarray | None) -> shapely.Polygon | None:
    if ring is None:
        return None
    try:
        pieces = polygons_of(ring)
    except ValueError as error:
        raise ValueError(f"bounds: {error}") from None
    if len(pieces) > 1:
        raise ValueError("bounds: must not touch itself")
    return pieces[0]


def _objects(shapes: list[shapely.Geometry]) -> np.ndarray:
    array = np.empty(len(shapes), dtype=object)
    array[:] = shapes
    return array
