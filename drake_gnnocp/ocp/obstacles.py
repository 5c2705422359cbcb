"""Convex obstacles as arrays, asked for at times, for what is computed for many pairs of a pose and an obstacle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely

from drake_gnnocp.polygons import padded_rings, polygons_from

SHORTEST_EDGE = 1e-9  # m, shorter edges are repeated vertices
MOST_OF_A_KNOT = 200  # pairs: what more of them asks for, the answers to the check find


@dataclass(frozen=True, eq=False)
class Pairs:
    """P pairs of a knot and an obstacle, with the obstacle as it is at the time of the knot."""

    knot: np.ndarray  # (P,)
    obstacle: np.ndarray  # (P,)
    rings: np.ndarray  # (P, M, 2) vertices, counter-clockwise, the last repeated to M [m]
    is_vertex: np.ndarray  # (P, M) bool, False where it is padding
    normals: np.ndarray  # (P, M, 2) outward normals of the edges, zero where vertices repeat

    def __len__(self) -> int:
        return len(self.knot)


@dataclass(frozen=True, eq=False)
class Obstacles:
    """J convex obstacles, counter-clockwise, padded to the same number of vertices.

    They stand still: the times they are asked for make no difference. Padding repeats the last vertex: the edges it
    adds have no length and span no area.
    """

    vertices: np.ndarray  # (J, M, 2) [m]
    is_vertex: np.ndarray  # (J, M) bool, False where it is padding

    @classmethod
    def of(cls, rings: Sequence[np.ndarray]) -> Obstacles:
        """The obstacles, convex rings (M_j, 2) [m]."""
        return cls(*padded_rings(rings))

    def __len__(self) -> int:
        return len(self.vertices)

    @cached_property
    def polygons(self) -> np.ndarray:
        """The obstacles as polygons: (J,)."""
        return polygons_from([ring[used] for ring, used in zip(self.vertices, self.is_vertex, strict=True)])

    @cached_property
    def tree(self) -> shapely.STRtree:
        """An index of the polygons."""
        return shapely.STRtree(self.polygons)

    @cached_property
    def _normals(self) -> np.ndarray:
        return outward_normals(self.vertices)

    @cached_property
    def _boxes(self) -> shapely.STRtree:
        """An index of the boxes around the obstacles."""
        return shapely.STRtree(shapely.box(*self.vertices.min(axis=1).T, *self.vertices.max(axis=1).T))

    def ring(self, obstacle: int) -> np.ndarray:
        """One obstacle: (M_j, 2) [m]."""
        return self.vertices[obstacle][self.is_vertex[obstacle]]

    def ring_during(self, obstacle: int, times: np.ndarray) -> np.ndarray:
        """What an obstacle covers from the first to the last of some times [s]: a convex ring (M, 2) [m]."""
        return self.ring(obstacle)

    def pairs_within(
        self, footprints: np.ndarray, times: np.ndarray, distance: float, with_last: bool = False
    ) -> Pairs:
        """Pairs of a knot and an obstacle whose bounding boxes are nearer than a distance, by obstacle, then by knot.

        Of a knot with more than MOST_OF_A_KNOT such obstacles, the nearest.

        Args:
            footprints: (N, 4, 2) of the car; the first knot is fixed and in no pair [m].
            times: (N,) of the knots [s].
            distance: [m].
            with_last: whether the last knot is in pairs: it need not be where it is fixed.
        """
        footprints = footprints[1:] if with_last else footprints[1:-1]
        low, high = footprints.min(axis=1) - distance, footprints.max(axis=1) + distance
        knot, obstacle = self._boxes.query(shapely.box(*low.T, *high.T))
        if np.bincount(knot, minlength=1).max() > MOST_OF_A_KNOT:
            corners = self.vertices[obstacle]
            gap = np.maximum(low[knot] - corners.max(axis=1), corners.min(axis=1) - high[knot]).max(axis=1)
            order = np.lexsort([obstacle, gap, knot])
            place = np.arange(len(order)) - np.searchsorted(knot[order], knot[order])  # among those of the knot
            nearest = order[place < MOST_OF_A_KNOT]
            knot, obstacle = knot[nearest], obstacle[nearest]
        order = np.lexsort([knot, obstacle])
        knot, obstacle = knot[order] + 1, obstacle[order]
        return Pairs(knot, obstacle, self.vertices[obstacle], self.is_vertex[obstacle], self._normals[obstacle])


def padded(ring: np.ndarray, n: int) -> np.ndarray:
    """The vertices (..., M, 2), the last repeated to n."""
    return np.concatenate([ring, np.repeat(ring[..., -1:, :], n - ring.shape[-2], axis=-2)], axis=-2)


def outward_normals(rings: np.ndarray) -> np.ndarray:
    """Unit normals of the edges of counter-clockwise rings (..., M, 2); zero where vertices repeat."""
    edges = np.concatenate([rings[..., 1:, :], rings[..., :1, :]], axis=-2) - rings
    length = np.sqrt(np.sum(edges**2, axis=-1, keepdims=True))
    turned = np.stack([edges[..., 1], -edges[..., 0]], axis=-1)
    return np.where(length > SHORTEST_EDGE, turned / np.maximum(length, SHORTEST_EDGE), 0.0)
