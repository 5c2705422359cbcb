r"""A heuristic that knows where the car can turn: shortest paths on a coarse lattice of positions and headings.

Dolgov's holonomic-with-obstacles heuristic drives a disc (`heuristic`), and his non-holonomic-without-obstacles one
is the Reeds-Shepp length, which knows no obstacles. Neither sees that a car which points the wrong way in a narrow lane
must first go to where it can turn round. Here a state is a grid cell and one of 16 headings. It is blocked if the car
there, as a row of inscribed circles, hits an obstacle or leaves the region.
A state has six neighbours: one step ahead or back, and a sixteenth of a turn left or right at full lock in either gear.
The shortest lengths V to the target are the fixed point of V(s) = min over the moves of (length + V(s after the move)),
found with numpy (`relaxation`).

It takes a tenth of a second, so it is computed only when the cheap heuristics have not been enough. Displacements
are rounded to cells, so V guides the search and proves nothing: where it is infinite, a finite guess replaces it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from drake_gnnocp.budget import Budget
from drake_gnnocp.search.collision import Box
from drake_gnnocp.search.distance_field import DistanceField
from drake_gnnocp.search.heuristic import HolonomicHeuristic, pooled
from drake_gnnocp.search.relaxation import relax
from drake_gnnocp.vehicle import Vehicle

HEADINGS = 16
CHANGE = 1e-3  # m, smaller changes do not go on
DETOUR_FACTOR, DETOUR_EXTRA = 1.3, 60.0  # m: longer ways of the disc are left out where a shorter one leads
END_RADIUS = 1.5  # lengths of the car: so near to an end a state needs no more room than the car
WITHOUT_WAY_FACTOR = 2.0  # where the lattice knows no way: this many times the disc's way ...
WITHOUT_WAY_EXTRA = 10.0  # m, ... and this


@dataclass(frozen=True, eq=False)
class Lattice:
    """Lengths to the target at grid cells and headings."""

    xmin: float  # m, left side of the grid
    ymin: float  # m, lower side of the grid
    cell: float  # m, side of a cell
    values: np.ndarray  # (HEADINGS, nx, ny) [m], finite where the disc has a way
    knows_way: bool  # whether it leads from about the root to the target

    @classmethod
    def of(
        cls,
        field: DistanceField,
        vehicle: Vehicle,
        root: np.ndarray,
        target: np.ndarray,
        holonomic: HolonomicHeuristic,
        from_root: HolonomicHeuristic,
        region: Box,
        room: float,
        budget: Budget,
    ) -> Lattice:
        """Compute the lengths to a target pose (3,) on the grid of the disc's distances to it.

        Args:
            field: distances to the obstacles.
            vehicle: the car.
            root: from where the search begins: x, y, theta [m, m, rad].
            target: x, y, theta [m, m, rad].
            holonomic: the disc's distances to the target.
            from_root: and to the root.
            region: xmin, xmax, ymin, ymax, which the car does not leave [m].
            room: what the circles have around them [m], except near both ends.
            budget: where it ends early, lengths are too large.
        """
        through = holonomic.values + from_root.values  # length of the disc's shortest way through a cell
        is_detour = through > DETOUR_FACTOR * through.min() + DETOUR_EXTRA
        is_near = np.minimum(holonomic.values, from_root.values) < END_RADIUS * vehicle.length
        blocked = _blocked(field, vehicle, holonomic, region, np.where(is_near, 0.0, room))
        end, moves = _state(target, holonomic), _moves(holonomic.cell, vehicle.turning_radius)
        values = _lengths(blocked | is_detour, end, moves, budget)
        knows_way = _leads(values, _state(root, holonomic))
        if not knows_way and is_detour.any():
            values = _lengths(blocked, end, moves, budget)
            knows_way = _leads(values, _state(root, holonomic))
        guess = WITHOUT_WAY_FACTOR * holonomic.values + WITHOUT_WAY_EXTRA
        values = np.where(np.isfinite(values), values, guess)
        return cls(holonomic.xmin, holonomic.ymin, holonomic.cell, values, knows_way)

    def at(self, x: float, y: float, theta: float) -> float:
        """Length to the target from a pose [m, m, rad], in m."""
        _, nx, ny = self.values.shape
        i = min(max(int((x - self.xmin) / self.cell), 0), nx - 1)
        j = min(max(int((y - self.ymin) / self.cell), 0), ny - 1)
        return float(self.values[round(theta / (2 * math.pi) * HEADINGS) % HEADINGS, i, j])


def _state(pose: np.ndarray, holonomic: HolonomicHeuristic) -> tuple[int, int, int]:
    """Heading and cell of a pose (3,)."""
    nx, ny = holonomic.values.shape
    i = min(max(int((pose[0] - holonomic.xmin) / holonomic.cell), 0), nx - 1)
    j = min(max(int((pose[1] - holonomic.ymin) / holonomic.cell), 0), ny - 1)
    return round(pose[2] / (2 * math.pi) * HEADINGS) % HEADINGS, i, j


def _leads(values: np.ndarray, state: tuple[int, int, int]) -> bool:
    """Whether lengths are known at a state or one beside it."""
    k, i, j = state
    around = np.take(values, np.arange(k - 1, k + 2), axis=0, mode="wrap")
    return bool(np.isfinite(around[:, max(i - 1, 0) : i + 2, max(j - 1, 0) : j + 2]).any())


def _blocked(
    field: DistanceField, vehicle: Vehicle, holonomic: HolonomicHeuristic, region: Box, room: np.ndarray
) -> np.ndarray:
    """States whose inscribed circles have less than some room (nx, ny) [m], or leave the region: (HEADINGS, nx, ny)."""
    widest = pooled(field.values)
    nx, ny = widest.shape
    x = holonomic.xmin + (np.arange(nx) + 0.5) * holonomic.cell
    y = holonomic.ymin + (np.arange(ny) + 0.5) * holonomic.cell
    half_width = 0.5 * vehicle.width
    least = half_width + np.maximum(0.5 * field.half_diagonal, room)  # in-between headings need some
    first, last = half_width - vehicle.rear_hang, vehicle.wheelbase + vehicle.front_hang - half_width
    blocked = np.zeros((HEADINGS, nx, ny), dtype=bool)
    for k in range(HEADINGS):
        angle = 2 * math.pi * k / HEADINGS
        for along in np.linspace(first, last, math.ceil(max(last - first, 0.0) / half_width) + 1):
            i = np.clip(((x + along * math.cos(angle) - holonomic.xmin) / holonomic.cell).astype(int), 0, nx - 1)
            j = np.clip(((y + along * math.sin(angle) - holonomic.ymin) / holonomic.cell).astype(int), 0, ny - 1)
            blocked[k] |= widest[np.ix_(i, j)] < least
            inside = [
                np.abs(centres - 0.5 * (low + high)) < 0.5 * (high - low) - half_width + 0.5 * holonomic.cell
                for centres, low, high in (
                    (x + along * math.cos(angle), region[0], region[1]),
                    (y + along * math.sin(angle), region[2], region[3]),
                )
            ]
            blocked[k] |= ~(inside[0][:, None] & inside[1])
    return blocked


def _moves(cell: float, radius: float) -> list[list[tuple[int, int, int, float]]]:
    """Per heading the moves: displacement in cells, new heading, length [m]."""
    turn = 2 * math.pi / HEADINGS
    chord, arc = 2.0 * radius * math.sin(0.5 * turn), radius * turn
    moves: list[list[tuple[int, int, int, float]]] = []
    for k in range(HEADINGS):
        longest = max(abs(math.cos(k * turn)), abs(math.sin(k * turn)))
        step = 1 if k % (HEADINGS // 8) == 0 else 2  # a knight's move between the eight directions of the grid
        i, j = round(step * math.cos(k * turn) / longest), round(step * math.sin(k * turn) / longest)
        own = [(gear * i, gear * j, k, cell * math.hypot(i, j)) for gear in (1, -1)]
        for gear in (1, -1):
            for side in (1, -1):
                direction = (k + 0.5 * gear * side) * turn
                i, j = (round(gear * chord * f(direction) / cell) for f in (math.cos, math.sin))
                own.append((i, j, (k + gear * side) % HEADINGS, arc))
        moves.append(own)
    return moves


def _lengths(
    blocked: np.ndarray,
    target: tuple[int, int, int],
    moves: list[list[tuple[int, int, int, float]]],
    budget: Budget,
) -> np.ndarray:
    """Shortest lengths to the target state [m], infinite at blocked states."""
    _, nx, ny = blocked.shape
    # a frame that is blocked: no move leaves the array, and those that are longer than it lead as far
    frame = min(max(max(abs(i), abs(j)) for own in moves for i, j, _, _ in own), max(nx, ny))
    is_free = np.zeros((HEADINGS, nx + 2 * frame, ny + 2 * frame), dtype=bool)
    is_free[:, frame : frame + nx, frame : frame + ny] = ~blocked
    offsets, lengths = np.zeros((HEADINGS, len(moves[0])), dtype=int), np.zeros((HEADINGS, len(moves[0])))
    count = np.zeros(HEADINGS, dtype=int)
    row, plane = is_free.shape[2], is_free[0].size
    for k, own in enumerate(moves):
        for i, j, after, length in own:
            i, j = min(max(i, -frame), frame), min(max(j, -frame), frame)
            offsets[after, count[after]] = (k - after) * plane - i * row - j
            lengths[after, count[after]] = length
            count[after] += 1
    values = np.full(is_free.size, np.inf)
    start = np.ravel_multi_index((target[0], frame + target[1], frame + target[2]), is_free.shape)
    values[start] = 0.0
    relax(values, is_free.ravel(), offsets, lengths, np.array([start]), budget, CHANGE)
    return values.reshape(is_free.shape)[:, frame : frame + nx, frame : frame + ny]
