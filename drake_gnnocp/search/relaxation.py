"""Shortest lengths on grids: the wave front of what has changed is relaxed until nothing changes, with numpy.

V(s) = min over the moves of (length + V(s after the move)) is met where no state can be improved (Bellman and Ford).
What changed is taken up in the order of the lengths, within the longest move at once (Meyer and Sanders 2003), so that
most states are taken up once.
"""

from __future__ import annotations

import numpy as np

from drake_gnnocp.budget import Budget


def relax(
    values: np.ndarray,
    is_free: np.ndarray,
    offsets: np.ndarray,
    lengths: np.ndarray,
    front: np.ndarray,
    budget: Budget,
    least_change: float = 0.0,
) -> None:
    """Lower values to the shortest lengths, in place.

    Args:
        values: (S,) of states, the targets' are known; the states are planes of equal size, one behind the other.
        is_free: (S,) bool; no move from a free state leaves the planes.
        offsets: (H, M) for a state of each plane, the states that M moves lead to it from: indices less its own.
        lengths: (H, M) of these moves.
        front: (F,) states whose values are known.
        budget: where it ends early, values are too large.
        least_change: smaller changes do not go on.
    """
    plane, reach = len(values) // len(offsets), float(lengths.max())
    is_waiting, waiting = np.zeros(len(values), dtype=bool), front
    last_place = np.empty(len(values), dtype=np.intp)
    while len(waiting) and not budget.is_over:
        # those that are much farther may still be reached by shorter ways
        is_next = values[waiting] <= values[waiting].min() + reach
        front, waiting = waiting[is_next], waiting[~is_next]
        heading = front // plane
        before = (front[:, None] + offsets[heading]).ravel()
        length = (values[front][:, None] + lengths[heading]).ravel()
        better = is_free[before] & (length < values[before])
        before, length = before[better], length[better]
        old = values[before]
        np.minimum.at(values, before, length)
        is_waiting[front] = False
        changed = before[length < old - least_change]
        fresh = changed[~is_waiting[changed]]
        place = np.arange(len(fresh))
        last_place[fresh] = place  # each state once, and sorted: this is faster than np.unique
        fresh = np.sort(fresh[last_place[fresh] == place])
        is_waiting[fresh] = True
        waiting = np.concatenate([waiting, fresh])
