"""Which pairs of poses of a map a plain grid search with the exact footprint can connect; nothing of the package's.

States are the points of a square lattice (STEP cells apart) with 32 headings, those of short lattice vectors. An edge
is a straight line along a heading to the next lattice point, or a straight line, an arc of the smallest radius and a
straight line to a lattice point and another heading, exactly. It is driven forwards, or backwards the other way: states
are connected where edges lead from one to the other, in any number. An edge is free where no cell that the footprint
sweeps is occupied. A pose that is no state is joined to states nearby by the same kind of moves. So what is connected
can be driven, by a car that steers while it stands. The footprint is larger than the car by GROWN all around, as it may
reach that much farther between samples. That, the lattice and the few kinds of edges make the search miss passages that
are little wider than the car: it is a lower bound of what can be connected.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from lattice_edges import GROWN, HEADINGS, SAMPLES, STEP, VECTORS, Move, edges_of, moves_between
from map_tasks import TaskMap, footprints

from drake_gnnocp import Vehicle

COARSE, FINER = 0.2, 25  # m, and how much finer a move from a pose is sampled where it is near something
NEAR = 1.3  # turning radii and half a metre: how far away states are joined to a pose
MOST_TRIED, MOST_JOINED = 300, 24  # states, drawn from all those near
ROOMY = 3000  # states: a pose that is joined to so many is not hemmed in
ESCAPES, MOST_MOVED = 3, 40  # moves before that, and poses they lead to, where it is
SAME = 1e-12  # m, says which way an arc is driven


@dataclass(eq=False)
class Oracle:
    """A map and a vehicle, with the states that were found to be connected so far."""

    map: TaskMap
    vehicle: Vehicle
    groups: int = 0  # found so far
    _margin: int = field(init=False)  # lattice points around the map

    def __post_init__(self) -> None:
        self.edges = edges_of(self.vehicle, self.map.cells.cell)
        self.shape = tuple(n // STEP + 1 for n in self.map.cells.occupied.shape)
        self._margin = max(int(np.abs(runs).max()) for runs in self.edges.sweeps) // STEP + 2
        before = self._before()
        self.leaving: list[list[tuple[int, int, np.ndarray]]] = [[] for _ in VECTORS]  # heading, shift, free
        for edge, runs in zip(self.edges.all, self.edges.sweeps, strict=True):
            free, shift = self._free(before, runs).ravel(), edge.offset[1] * self.shape[1] + edge.offset[0]
            self.leaving[edge.start].append((edge.end, shift, free))
            backwards = np.zeros_like(free)  # from the edge's end to its start
            at = np.flatnonzero(free)
            backwards[at + shift] = True
            self.leaving[edge.end].append((edge.start, -shift, backwards))
        self.group = np.zeros((len(VECTORS), self.shape[0] * self.shape[1]), dtype=np.int32)  # 0: not known yet
        standing = [self.edges.swept(i, Move(0.0, 0.0, 0.0)) for i in range(len(VECTORS))]
        self.free = np.stack([self._free(before, runs) for runs in standing])

    def _before(self) -> list[list[np.ndarray]]:
        """How many occupied cells of a row come before a column, for every STEP-th row and column from each of them."""
        margin = STEP * self._margin
        padded = np.pad(self.map.cells.occupied, ((margin, margin), (margin, margin)), constant_values=True)
        before = np.zeros((padded.shape[0], padded.shape[1] + 1), dtype=np.int32)
        np.cumsum(padded, axis=1, out=before[:, 1:])
        return [[np.ascontiguousarray(before[i::STEP, j::STEP]) for j in range(STEP)] for i in range(STEP)]

    def _free(self, before: list[list[np.ndarray]], runs: np.ndarray) -> np.ndarray:
        """At which lattice points (ny, nx) none of some runs of cells is occupied."""
        ny, nx = self.shape
        found = np.zeros((ny, nx), dtype=np.int32)
        for row, begin, end in (runs + STEP * self._margin).tolist():
            (i, y), (j, x), (k, z) = divmod(row, STEP), divmod(begin, STEP), divmod(end, STEP)
            found += before[y][z][i : i + ny, k : k + nx]
            found -= before[y][x][i : i + ny, j : j + nx]
        return found == 0

    def connects(self, start: np.ndarray, goal: np.ndarray) -> bool:
        """Whether moves and edges lead from a pose (3,) to another one [m, m, rad]."""
        ends = [np.reshape(pose, (1, 3)) for pose in (start, goal)]
        groups = [self._groups_near(poses) for poses in ends]
        for _ in range(ESCAPES):
            if groups[0] & groups[1]:
                return True
            sizes = np.bincount(self.group.ravel())
            for k, poses in enumerate(ends):
                if all(sizes[group] < ROOMY for group in groups[k]):  # the pose is hemmed in
                    ends[k] = self._moved(poses)
                    groups[k] |= self._groups_near(ends[k])
        return bool(groups[0] & groups[1])

    def _groups_near(self, poses: np.ndarray) -> set[int]:
        """The groups of states that one move leads to from poses (N, 3)."""
        return {self._group_of(*state) for pose in poses for state in self.joined(pose)}

    def _moved(self, poses: np.ndarray) -> np.ndarray:
        """Where one arc or straight line leads to from poses (N, 3), forwards and backwards: (M, 3), some of them."""
        lengths = self.edges.radius * np.array([-0.8, -0.4, -0.2, 0.2, 0.4, 0.8])
        moves = [Move(float(length), 0.0, 0.0) for length in lengths]
        moves += [
            Move(math.copysign(SAME, s), side * abs(s) / self.edges.radius, 0.0) for s in lengths for side in (-1, 1)
        ]
        ends = [
            move.poses(pose, self.edges.radius, self.edges.reach, 1.0)[-1]
            for pose in poses
            for move in moves
            if not self._is_blocked(move, pose)
        ]
        return np.random.default_rng(0).permutation(np.array(ends).reshape(-1, 3))[:MOST_MOVED]

    def joined(self, pose: np.ndarray) -> list[tuple[int, int]]:
        """The states that one move leads to from a pose: heading and number of the lattice point."""
        cells, spacing = self.map.cells, self.edges.spacing
        near = NEAR * self.edges.radius + 0.5
        centre, most = np.round((pose[:2] - cells.origin) / spacing).astype(int), math.ceil(near / spacing)
        h, y, x = (part.ravel() for part in np.indices((len(VECTORS), 2 * most + 1, 2 * most + 1)))
        x, y = x - most + centre[0], y - most + centre[1]
        inside = (0 <= x) & (x < self.shape[1]) & (0 <= y) & (y < self.shape[0])
        h, y, x = h[inside], y[inside], x[inside]
        is_free = self.free[h, y, x]
        h, y, x = h[is_free], y[is_free], x[is_free]
        turn = np.remainder(HEADINGS[h] - pose[2] + math.pi, 2 * math.pi) - math.pi
        offset = cells.origin + spacing * np.column_stack([x, y]) - pose[:2]
        usual = (np.abs(turn) > 1e-6) & (np.abs(turn) < 0.6 * math.pi)
        lengths = moves_between(offset, np.full(len(h), pose[2]), np.where(usual, turn, 1.0), self.edges.radius)
        possible = np.flatnonzero(usual & np.isfinite(lengths[:, 0]) & (np.abs(lengths).sum(axis=1) <= near))
        found = []
        for k in np.random.default_rng(0).permutation(possible)[:MOST_TRIED]:
            move = Move(float(lengths[k, 0]), float(turn[k]), float(lengths[k, 1]))
            if not self._is_blocked(move, pose):
                found.append((int(h[k]), int(y[k] * self.shape[1] + x[k])))
            if len(found) == MOST_JOINED:
                break
        return found

    def _is_blocked(self, move: Move, pose: np.ndarray) -> bool:
        def hits(spacing: float, grown: float) -> bool:
            poses = move.poses(pose, self.edges.radius, self.edges.reach, spacing)
            return bool(self.map.cells.hits(footprints(self.vehicle, poses, grown)).any())

        if hits(COARSE, 0.0):  # most that are blocked are so at a few poses
            return True
        return hits(SAMPLES, GROWN) and hits(SAMPLES / FINER, GROWN / FINER)

    def _group_of(self, heading: int, point: int) -> int:
        """The number of the group of states that are connected with one."""
        if not self.group[heading, point]:
            self.groups += 1
            self._fill(heading, point)
        return int(self.group[heading, point])

    def _fill(self, heading: int, point: int) -> None:
        self.group[heading, point] = self.groups
        front = {heading: [np.array([point])]}
        while front:
            reached: dict[int, list[np.ndarray]] = {}
            for i, parts in front.items():
                at = np.concatenate(parts)
                for j, shift, free in self.leaving[i]:
                    new = at[free[at]] + shift
                    new = new[self.group[j, new] == 0]
                    if len(new):
                        self.group[j, new] = self.groups
                        reached.setdefault(j, []).append(new)
            front = reached
