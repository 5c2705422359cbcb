"""The region that obstacles cover, however they are cut, as planners see it: polygons, covers of them, convex parts."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np
import shapely

from drake_gnnocp.convex import convex_parts, convex_parts_of, cover
from drake_gnnocp.polygons import SAME_POINT, merged

FEW_VERTICES = 100  # of a polygon that is taken as it is
# of all polygons together: the outline of more is made simpler, by this share of half the gaps that are filled
MOST_CORNERS, SIMPLER = 3000, 0.3

Parts = tuple[np.ndarray, ...]  # convex rings (M, 2), counter-clockwise, that cover a polygon [m]


@dataclass(frozen=True, eq=False)
class Blocked:
    """B polygons that do not overlap, holes possible, and what planners take for them."""

    polygons: np.ndarray  # (B,) exactly
    covers: np.ndarray  # (B,) the same, or a little larger with fewer vertices
    parts: tuple[Parts, ...]  # of the covers
    is_larger: np.ndarray  # (B,) bool, whether the cover is not the polygon itself

    @classmethod
    def of(cls, areas: np.ndarray, tolerance: float) -> Blocked:
        """What areas (A,) cover; covers are no farther out than a tolerance [m]."""
        polygons = shapely.normalize(shapely.simplify(_objects(merged(list(areas))), SAME_POINT))
        has_many = shapely.get_num_coordinates(polygons) > FEW_VERTICES
        covers = [
            cover(polygon, tolerance) if many else polygon for polygon, many in zip(polygons, has_many, strict=True)
        ]
        is_larger = np.array([one is not other for one, other in zip(covers, polygons, strict=True)], dtype=bool)
        array = _objects(covers)
        return cls(polygons, array, convex_parts_of(array), is_larger)

    def exact_near(self, shapes: np.ndarray, distance: float) -> Blocked:
        """The same with polygons as they are where their covers are within a distance of some shapes [m]."""
        near = self.is_larger.copy()
        near[near] = shapely.dwithin(self.covers[near, None], shapes, distance).any(axis=1)
        return self._exact_at(near)

    @property
    def exactly(self) -> Blocked:
        """The same without covers."""
        return self._exact_at(self.is_larger)

    def _exact_at(self, which: np.ndarray) -> Blocked:
        if not which.any():
            return self
        covers, parts = np.where(which, self.polygons, self.covers), list(self.parts)
        for i in np.flatnonzero(which):
            parts[i] = tuple(convex_parts(self.polygons[i]))
        return Blocked(self.polygons, covers, tuple(parts), self.is_larger & ~which)

    def mapped(self, change: Callable[[np.ndarray], np.ndarray]) -> Blocked:
        """The same with other coordinates, which `change` gives for coordinates (N, 2)."""
        polygons, covers = shapely.transform(self.polygons, change), shapely.transform(self.covers, change)
        return Blocked(polygons, covers, tuple(_changed(self.parts, change)), self.is_larger)


def _changed(parts: Sequence[Parts], change: Callable[[np.ndarray], np.ndarray]) -> Iterator[Parts]:
    """Parts with other coordinates, changed at once."""
    rings = [ring for those in parts for ring in those]
    if rings:
        changed = change(np.concatenate(rings))
        rings = np.split(changed, np.cumsum([len(ring) for ring in rings])[:-1])
    one = iter(rings)
    return (tuple(islice(one, len(those))) for those in parts)


def outline_of(polygons: np.ndarray, gap: float) -> shapely.MultiLineString:
    """The outline of polygons (B,), with gaps between them filled that are narrower than `gap` [m]."""
    half, union = gap / 2, shapely.union_all
    if shapely.get_num_coordinates(polygons).sum() > MOST_CORNERS:
        polygons, union = shapely.simplify(polygons, half * SIMPLER), shapely.disjoint_subset_union_all
    grown = union(shapely.buffer(polygons, half, join_style="mitre"))
    with np.errstate(divide="ignore", invalid="ignore"):  # GEOS divides by zero at some corners, and copes
        filled = shapely.buffer(shapely.get_parts(grown), -half, join_style="mitre")
    rings = shapely.get_rings(shapely.get_parts(shapely.normalize(filled)))
    return shapely.MultiLineString([shapely.LineString(ring) for ring in rings])


def _objects(shapes: Sequence[shapely.Geometry]) -> np.ndarray:
    array = np.empty(len(shapes), dtype=object)
    array[:] = shapes
    return array
