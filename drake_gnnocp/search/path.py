"""A path with gears: what the searches find and the speed planner puts a time to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class GearedPath:
    """Poses along a path, each with the gear and curvature of the motion that arrives at it.

    Where the gear changes the car stops; that pose appears once, with the gear that arrives there.
    """

    poses: np.ndarray  # (N, 3) x, y, theta [m, m, rad], theta continuous (no jumps by 2 pi)
    gears: np.ndarray  # (N,) +1 forward, -1 reverse; gears[0] == gears[1]
    curvatures: np.ndarray  # (N,) tan(phi) / L_w, positive left whatever the gear [1/m]; curvatures[0] == curvatures[1]


def n_sections(path: GearedPath) -> int:
    """Moves in one gear along a path: one more than changes of gear."""
    return 1 + int(np.count_nonzero(np.diff(path.gears)))


def length_of(path: GearedPath) -> float:
    """Length of a path [m]."""
    return float(np.linalg.norm(np.diff(path.poses[:, :2], axis=0), axis=1).sum())
