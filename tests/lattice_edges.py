"""Edges of a lattice of poses that a vehicle drives exactly, and the cells that its footprint sweeps on them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from map_tasks import footprints
from raw_cells import covered

from drake_gnnocp import Vehicle

STEP = 5  # cells, of the lattice
QUADRANT = ((1, 0), (4, 1), (2, 1), (4, 3), (1, 1), (3, 4), (1, 2), (1, 4))  # lattice vectors, 11 to 14 degrees apart
VECTORS = np.array([*QUADRANT, *((-y, x) for x, y in QUADRANT)])
VECTORS = np.concatenate([VECTORS, -VECTORS])  # (32, 2), counter-clockwise
HEADINGS = np.arctan2(VECTORS[:, 1], VECTORS[:, 0])
TURNS = (1, 2, 3, 4, 8)  # headings, to either side
ENDS = 2  # lattice points of each turn, the nearest
SAMPLES = 0.01  # m, no corner moves farther from sample to sample
GROWN = 0.005  # m, half of it


@dataclass(frozen=True)
class Move:
    """A straight line, an arc of radius r and a straight line, backwards where the lengths are negative."""

    first: float  # m
    turn: float  # rad
    last: float  # m

    def poses(self, start: np.ndarray, r: float, reach: float, spacing: float) -> np.ndarray:
        """Poses (M, 3) from a start (3,), between which no point within the reach [m] moves farther than spacing."""
        x, y, theta = start.tolist()
        way = -1.0 if self.first + self.last < 0 else 1.0
        n = [_count(abs(self.first) / spacing), _count(abs(self.turn) * (r + reach) / spacing)]
        s = np.linspace(0.0, self.first, n[0])
        one = np.column_stack([x + s * math.cos(theta), y + s * math.sin(theta), np.full(len(s), theta)])
        heading = theta + np.linspace(0.0, self.turn, n[1])
        signed = way * math.copysign(r, self.turn)
        x, y, _ = one[-1].tolist()
        two = np.column_stack(
            [
                x + signed * (np.sin(heading) - math.sin(theta)),
                y - signed * (np.cos(heading) - math.cos(theta)),
                heading,
            ]
        )
        x, y, theta = two[-1].tolist()
        s = np.linspace(0.0, self.last, _count(abs(self.last) / spacing))
        three = np.column_stack([x + s * math.cos(theta), y + s * math.sin(theta), np.full(len(s), theta)])
        return np.concatenate([one, two, three])


def _count(intervals: float) -> int:
    return math.ceil(intervals) + 1


def moves_between(offset: np.ndarray, theta: np.ndarray, turn: np.ndarray, r: float) -> np.ndarray:
    """The straight lines before and after an arc of radius r that lead to an offset and turn the car.

    Args:
        offset: (N, 2) from start to end [m].
        theta: (N,) heading of the start [rad].
        turn: (N,) to the left, between -pi and pi, not 0 [rad].
        r: of the arc [m].

    Returns:
        (N, 2) lengths, both negative where the car drives backwards; NaN where there is no such move.
    """
    one, two = (np.stack([np.cos(angle), np.sin(angle)], axis=1) for angle in (theta, theta + turn))
    cross = np.sin(turn)
    corner = np.stack(  # where the two lines meet: so far from start and end
        [offset[:, 0] * two[:, 1] - offset[:, 1] * two[:, 0], one[:, 0] * offset[:, 1] - one[:, 1] * offset[:, 0]],
        axis=1,
    )
    legs = corner / cross[:, None]
    taken = r * np.tan(np.abs(turn) / 2)[:, None]  # by the arc
    forwards, backwards = (legs >= taken).all(axis=1), (legs <= -taken).all(axis=1)
    lengths = legs - np.where(forwards, 1.0, -1.0)[:, None] * taken
    return np.where((forwards | backwards)[:, None], lengths, np.nan)


@dataclass(frozen=True)
class Edge:
    """What leads from a heading at a lattice point to another heading at another one."""

    start: int  # index of the heading
    end: int
    offset: tuple[int, int]  # lattice points
    move: Move


@dataclass(frozen=True)
class Edges:
    """All edges of a vehicle, on a lattice over cells of some size [m]."""

    vehicle: Vehicle
    cell: float  # m

    @property
    def spacing(self) -> float:
        """Of the lattice [m]."""
        return STEP * self.cell

    @cached_property
    def radius(self) -> float:
        """Of the smallest arc, from the wheelbase and the largest steering angle [m]."""
        return self.vehicle.wheelbase / math.tan(self.vehicle.phi_max)

    @cached_property
    def reach(self) -> float:
        """From the rear axle's middle to the farthest corner [m]."""
        vehicle = self.vehicle
        return math.hypot(vehicle.wheelbase + max(vehicle.front_hang, vehicle.rear_hang), vehicle.width / 2)

    @cached_property
    def all(self) -> list[Edge]:
        """The edges from every heading."""
        edges = []
        for i, vector in enumerate(VECTORS):
            length = self.spacing * math.hypot(*vector)
            edges.append(Edge(i, i, (int(vector[0]), int(vector[1])), Move(length / 2, 0.0, length / 2)))
            for turn in TURNS:
                edges += self._turns(i, (i + turn) % len(VECTORS)) + self._turns(i, (i - turn) % len(VECTORS))
        return edges

    @cached_property
    def sweeps(self) -> list[np.ndarray]:
        """What each of them sweeps, see `swept`."""
        return [self.swept(edge.start, edge.move) for edge in self.all]

    def _turns(self, i: int, j: int) -> list[Edge]:
        turn = math.remainder(HEADINGS[j] - HEADINGS[i], 2 * math.pi)
        most = math.ceil(2 * self.radius * math.tan(abs(turn) / 2) / self.spacing) + 8
        y, x = np.indices((2 * most + 1, 2 * most + 1)).reshape(2, -1) - most
        offset, n = np.column_stack([x, y]), len(x)
        lengths = moves_between(self.spacing * offset, np.full(n, HEADINGS[i]), np.full(n, turn), self.radius)
        total = np.where(lengths.min(axis=1) >= 0, lengths.sum(axis=1), np.inf)
        best = np.argsort(total, kind="stable")[:ENDS]
        return [
            Edge(i, j, (int(x[k]), int(y[k])), Move(float(lengths[k, 0]), turn, float(lengths[k, 1])))
            for k in best
            if math.isfinite(total[k])
        ]

    def swept(self, heading: int, move: Move) -> np.ndarray:
        """The runs of cells that a move sweeps from a lattice point: (K, 3) row, first column, one after the last."""
        start = np.array([0.0, 0.0, HEADINGS[heading]])
        poses = move.poses(start, self.radius, self.reach, SAMPLES)
        runs = covered(footprints(self.vehicle, poses, GROWN) / self.cell)
        rows, first, last = runs.rows[runs.is_there], runs.first[runs.is_there], runs.last[runs.is_there]
        low = np.array([rows.min(), first.min()])
        changes = np.zeros((np.ptp(rows) + 1, last.max() - low[1] + 2), dtype=int)
        np.add.at(changes, (rows - low[0], first - low[1]), 1)
        np.add.at(changes, (rows - low[0], last + 1 - low[1]), -1)
        is_covered = np.pad(np.cumsum(changes, axis=1) > 0, ((0, 0), (1, 0)))
        row, begin = np.nonzero(np.diff(is_covered.astype(np.int8), axis=1) == 1)
        _, end = np.nonzero(np.diff(is_covered.astype(np.int8), axis=1) == -1)
        return np.column_stack([row + low[0], begin + low[1], end + low[1]])


@cache
def edges_of(vehicle: Vehicle, cell: float) -> Edges:
    """The edges of a vehicle: they are the same for all maps with cells of a size [m]."""
    return Edges(vehicle, cell)
