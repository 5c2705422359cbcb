"""Convex obstacles as arrays, for what is computed for many pairs of a pose and an obstacle at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

SHORTEST_EDGE = 1e-9  # m, shorter edges are repeated vertices


@dataclass(frozen=True, eq=False)
class ConvexRings:
    """J convex obstacles, counter-clockwise, padded to the same number of vertices.

    Padding repeats the last vertex: the edges it adds have no length and span no area.
    """

    vertices: np.ndarray  # (J, M, 2) [m]
    is_vertex: np.ndarray  # (J, M) bool, False where it is padding

    @classmethod
    def of(cls, obstacles: Sequence[np.ndarray]) -> ConvexRings:
        """The obstacles, rings (M_j, 2) [m]."""
        counts = np.array([len(ring) for ring in obstacles], dtype=int)
        most = int(counts.max(initial=1))
        vertices = np.array([padded(ring, most) for ring in obstacles]).reshape(-1, most, 2)
        return cls(vertices, np.arange(most) < counts[:, None])

    def __len__(self) -> int:
        return len(self.vertices)

    @cached_property
    def normals(self) -> np.ndarray:
        """Outward normals of the edges from every vertex to the next: (J, M, 2), see `outward_normals`."""
        return outward_normals(self.vertices)

    @cached_property
    def _boxes(self) -> tuple[np.ndarray, np.ndarray]:
        return self.vertices.min(axis=1), self.vertices.max(axis=1)

    def pairs_within(self, footprints: np.ndarray, near: float) -> tuple[np.ndarray, np.ndarray]:
        """Knots and obstacles whose bounding boxes come nearer than `near` [m], by obstacle and then by knot.

        Args:
            footprints: (N, 4, 2) of the car; the first and the last knot are fixed and in no pair [m].
            near: [m].
        """
        low, high = self._boxes
        reach_low, reach_high = footprints.min(axis=1) - near, footprints.max(axis=1) + near
        close = np.all((reach_high > low[:, None]) & (reach_low < high[:, None]), axis=2)
        close[:, [0, -1]] = False
        obstacle, knot = np.nonzero(close)
        return knot, obstacle


def padded(ring: np.ndarray, n: int) -> np.ndarray:
    """The vertices (..., M, 2), the last repeated to n."""
    return np.concatenate([ring, np.repeat(ring[..., -1:, :], n - ring.shape[-2], axis=-2)], axis=-2)


def outward_normals(rings: np.ndarray) -> np.ndarray:
    """Unit normals of the edges of counter-clockwise rings (..., M, 2); zero where vertices repeat."""
    edges = np.concatenate([rings[..., 1:, :], rings[..., :1, :]], axis=-2) - rings
    length = np.sqrt(np.sum(edges**2, axis=-1, keepdims=True))
    turned = np.stack([edges[..., 1], -edges[..., 0]], axis=-1)
    return np.where(length > SHORTEST_EDGE, turned / np.maximum(length, SHORTEST_EDGE), 0.0)
