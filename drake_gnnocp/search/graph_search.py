r"""One Hybrid A* search: from a root pose to a target pose at one resolution of the grid.

Nodes are continuous poses; of those in one cell of (x, y, theta) only the cheapest is kept. A node's successors are arcs
of one length, every steering level in both gears, driven without collision. The order is that of

    f = g + weight * max(V(x, y), RS(pose)),

V the obstacle-aware cost-to-go of the rear axle's middle and RS the length of the shortest Reeds-Shepp path among no
obstacles. V is known when a node is generated; RS only when it comes to the front of the queue, which then may take it back
(most nodes never get there). From some nodes, the nearer the target the more of them, Reeds-Shepp paths to the target
are tried, the cheapest first. After the first success the search goes on for a while: the first path is rarely the best.
"""

from __future__ import annotations

import bisect
import heapq
import math
import time
from dataclasses import dataclass
from enum import Enum

import numpy as np

from drake_gnnocp.search.collision import Box, FootprintTest
from drake_gnnocp.search.heuristic import CostToGo
from drake_gnnocp.search.lattice import Lattice
from drake_gnnocp.search.moves import Costs, Move, advance, drive, moves_of
from drake_gnnocp.search.reeds_shepp import all_paths, path_length

CLOCK_EVERY = 8  # expansions between looks at the clock: about 5 ms
CANDIDATES = 6  # Reeds-Shepp paths tried from one node
TRY_PER_METRE = 0.3  # expansions to wait until the next Reeds-Shepp trial, per metre to go
POLISH_SHARE = 0.5  # after the first path, as many more expansions as this share of those before ...
POLISH_LEAST = 40  # ... but at least these
TIGHT_REACH = 2.5  # m around a root where every primitive is blocked, as in a short slot: cells are fine there
TIGHT_SPACING = 0.03  # m, largest distance between the poses at which a primitive may end there


class Outcome(Enum):
    """How a run of the search ended."""

    FINISHED = "finished"  # nothing better is to be found; `best` is the path, if there is any
    PAUSED = "paused"  # used the expansions it was given
    OUT_OF_TIME = "out of time"


@dataclass(frozen=True)
class Resolution:
    """How finely one search looks."""

    position: float  # m, side of a cell
    heading: float  # rad, heading cell
    primitive_length: float  # m
    steering_levels: int  # from full left to full right, odd so that straight is one of them
    weight: float  # of the heuristic; above 1 is greedy
    tight_position: float  # m, side of a cell around a tight root
    tight_heading: float  # rad, heading cell there


class GraphSearch:
    """A search that can be run in instalments.

    Args:
        root: (3,) pose to search from [m, m, rad].
        target: (3,) pose to reach [m, m, rad].
        test: the collision test.
        cost_to_go: distances to the target.
        region: xmin, xmax, ymin, ymax of all poses [m].
        turning_radius: smallest radius [m].
        costs: what a path costs.
        resolution: the grid and the primitives.
        lattice: lengths to the target by a better heuristic, if it has been computed.
        driven_backwards: the path found will be driven from target to root, so forward moves cost what reversing costs.
    """

    def __init__(
        self,
        root: np.ndarray,
        target: np.ndarray,
        test: FootprintTest,
        cost_to_go: CostToGo,
        region: Box,
        turning_radius: float,
        costs: Costs,
        resolution: Resolution,
        lattice: Lattice | None = None,
        driven_backwards: bool = False,
    ) -> None:
        self.best: list[Move] | None = None
        self.best_cost = math.inf
        self.expansions = 0
        self._target, self._test, self._to_go, self._lattice = target, test, cost_to_go, lattice
        self._radius, self._costs, self._resolution = turning_radius, costs, resolution
        self._sign = -1.0 if driven_backwards else 1.0
        self._root = np.asarray(root, dtype=float)
        self._xmin, self._ymin, self._height = region[0], region[2], region[3] - region[2]
        self._headings = max(1, round(2 * math.pi / resolution.heading))
        self._tight_headings = max(1, round(2 * math.pi / resolution.tight_heading))
        self._make_primitives()
        self.root_is_tight = self._is_tight()
        self._poses: list[tuple[float, float, float]] = []
        self._g: list[float] = []
        self._parents: list[int] = []
        self._arrivals: list[int] = []  # the primitive each node was reached by, -1 for the root
        self._shares: list[float] = []  # how much of that primitive was driven
        self._keys: list[int] = []
        self._exact: list[bool] = []  # whether the node's f has its Reeds-Shepp part
        self._cheapest: dict[int, float] = {}  # g of the cheapest node of a cell
        self._closed: set[int] = set()
        self._queue: list[tuple[float, int]] = []
        self._next_try = 0
        self._last_expansion = 10**9  # where polishing ends
        x, y, theta = map(float, root)
        to_go = float(cost_to_go.at(root[:1], root[1:2])[0])
        self._push((x, y, theta), 0.0, -1, -1, 0.0, self._key(root[None])[0], to_go)

    def run(self, expansions: int, deadline: float) -> Outcome:
        """Search on for a number of expansions, or until the deadline (a time.monotonic() instant)."""
        pause = self.expansions + expansions
        while self._queue:
            if self.expansions % CLOCK_EVERY == 0 and time.monotonic() > deadline:
                return Outcome.OUT_OF_TIME
            if self.expansions >= pause:
                return Outcome.PAUSED
            f, node = heapq.heappop(self._queue)
            if f >= self.best_cost or self.expansions >= self._last_expansion:
                return Outcome.FINISHED
            if self._keys[node] in self._closed or self._put_back(f, node):
                continue
            self._closed.add(self._keys[node])
            self.expansions += 1
            if self.expansions >= self._next_try:
                self._try_to_finish(node)
                self._next_try = self.expansions + 1 + int(TRY_PER_METRE * (f - self._g[node]))
            self._expand(node)
        return Outcome.FINISHED

    def _make_primitives(self) -> None:
        levels = np.linspace(-1.0, 1.0, self._resolution.steering_levels) / self._radius
        length = self._resolution.primitive_length
        self._primitives = [Move(float(kappa), gear * length) for gear in (1, -1) for kappa in levels]
        # (P, K, 3) in the frame of the node, the second with a finer K
        self._shapes = self._sampled(self._test.spacing)
        self._tight_shapes = self._sampled(min(self._test.spacing, TIGHT_SPACING))
        sharpest = 1.0 / self._radius
        own = [self._costs.of_move(Move(m.curvature, self._sign * m.length), sharpest) for m in self._primitives]
        changes = [[self._costs.of_change(a, b, sharpest) for b in self._primitives] for a in self._primitives]
        # row a, column b: cost of primitive b after primitive a; the last row is for the root, which has no before
        self._edge_costs = np.vstack([np.array(changes) + own, own]).tolist()
        self._own_costs = own

    def _sampled(self, spacing: float) -> np.ndarray:
        count = math.ceil(self._resolution.primitive_length / spacing)
        steps = np.arange(1, count + 1) / count
        return np.array([advance(np.zeros(3), move.curvature, move.length * steps) for move in self._primitives])

    def _placed(self, shapes: np.ndarray, pose: tuple[float, float, float]) -> np.ndarray:
        """Poses in the frame of a pose, (..., 3), in that of the map."""
        x, y, theta = pose
        cos, sin = math.cos(theta), math.sin(theta)
        placed = np.empty_like(shapes)
        placed[..., 0] = x + cos * shapes[..., 0] - sin * shapes[..., 1]
        placed[..., 1] = y + sin * shapes[..., 0] + cos * shapes[..., 1]
        placed[..., 2] = theta + shapes[..., 2]
        return placed

    def _key(self, poses: np.ndarray) -> list[int]:
        """The cell of each pose (N, 3) as one integer; around a tight root the cells are finer, their integers negative."""
        keys = self._cells(poses, self._resolution.position, self._headings)
        if self.root_is_tight:
            near = np.hypot(poses[:, 0] - self._root[0], poses[:, 1] - self._root[1]) < TIGHT_REACH
            if near.any():
                keys[near] = -1 - self._cells(poses[near], self._resolution.tight_position, self._tight_headings)
        result: list[int] = keys.tolist()
        return result

    def _cells(self, poses: np.ndarray, side: float, headings: int) -> np.ndarray:
        i = ((poses[:, 0] - self._xmin) / side).astype(np.int64)
        j = ((poses[:, 1] - self._ymin) / side).astype(np.int64)
        k = np.rint((poses[:, 2] - self._root[2]) * (headings / (2 * math.pi))).astype(np.int64) % headings
        return np.asarray((i * int(self._height / side + 2) + j) * headings + k)

    def _is_tight(self) -> bool:
        """Whether every primitive from the root is blocked."""
        x, y, theta = map(float, self._root)
        poses = self._placed(self._shapes, (x, y, theta))
        blocked = self._test.collides(poses.reshape(-1, 3)).reshape(poses.shape[:2])
        return bool(blocked.any(axis=1).all())

    def _push(
        self, pose: tuple[float, float, float], g: float, parent: int, arrival: int, share: float, key: int, to_go: float
    ) -> None:
        self._cheapest[key] = g
        self._poses.append(pose)
        self._g.append(g)
        self._parents.append(parent)
        self._arrivals.append(arrival)
        self._shares.append(share)
        self._keys.append(key)
        self._exact.append(False)
        heapq.heappush(self._queue, (g + self._resolution.weight * to_go, len(self._poses) - 1))

    def _put_back(self, f: float, node: int) -> bool:
        """Add the Reeds-Shepp part to a node's f; when that raises it, queue the node again."""
        if self._exact[node]:
            return False
        self._exact[node] = True
        length = path_length(self._poses[node], self._target, self._radius)
        if self._lattice is not None:
            length = max(length, self._lattice.at(*self._poses[node]))
        exact = self._g[node] + self._resolution.weight * length
        if exact <= f:
            return False
        heapq.heappush(self._queue, (exact, node))
        return True

    def _expand(self, node: int) -> None:
        is_tight = self._keys[node] < 0
        shapes = self._tight_shapes if is_tight else self._shapes
        ends = self._placed(shapes[:, -1], self._poses[node])
        edge_costs, g = self._edge_costs[self._arrivals[node]], self._g[node]
        keys = self._key(ends)
        wanted = [
            p
            for p, key in enumerate(keys)
            if is_tight  # the primitive may not get as far as its end
            or (key not in self._closed and g + edge_costs[p] < min(self._cheapest.get(key, math.inf), self.best_cost))
        ]
        if not wanted:
            return
        poses = self._placed(shapes[wanted], self._poses[node])
        count = poses.shape[1]
        blocked = self._test.collides(poses.reshape(-1, 3)).reshape(-1, count)
        free = np.where(blocked.any(axis=1), blocked.argmax(axis=1), count)  # steps: as far as it goes, which counts
        reached = poses[np.arange(len(wanted)), free - 1]  # in a tight slot, where every move ends at an obstacle
        to_go = self._to_go.at(reached[:, 0], reached[:, 1]).tolist()
        cells = self._key(reached)
        for row, (p, share) in enumerate(zip(wanted, (free / count).tolist(), strict=True)):
            if share > 0.0:
                cost = g + edge_costs[p] - self._own_costs[p] * (1.0 - share)
                self._offer(reached[row], cost, node, p, share, cells[row], to_go[row])

    def _offer(
        self, pose: np.ndarray, g: float, parent: int, primitive: int, share: float, key: int, to_go: float
    ) -> None:
        """Push a node unless its cell has a cheaper one."""
        if to_go < math.inf and key not in self._closed and g < self._cheapest.get(key, math.inf):
            x, y, theta = pose.tolist()
            self._push((x, y, theta), g, parent, primitive, share, key, to_go)

    def _try_to_finish(self, node: int) -> None:
        """Keep the cheapest free Reeds-Shepp path from a node to the target, if it is the best so far."""
        before = self._primitives[self._arrivals[node]] if self._arrivals[node] >= 0 else None
        if before is not None:
            before = Move(before.curvature, self._sign * before.length)
        sharpest, pose = 1.0 / self._radius, np.array(self._poses[node])
        choices: list[tuple[float, int, list[Move]]] = []
        for path in all_paths(pose, self._target, self._radius):  # shortest first, and none costs less than its length
            limit = self.best_cost if len(choices) < CANDIDATES else choices[CANDIDATES - 1][0]
            if self._g[node] + path.length >= limit:
                break
            moves = moves_of(path)
            as_driven = [Move(move.curvature, self._sign * move.length) for move in moves]
            cost = self._g[node] + self._costs.of(as_driven, sharpest, before)
            if cost < limit:
                bisect.insort(choices, (cost, len(choices), moves))
        del choices[CANDIDATES:]
        free = self._test.first_free([drive(pose, moves, self._test.spacing).poses for _, _, moves in choices])
        if free is not None:
            if self.best is None:
                self._last_expansion = self.expansions + POLISH_LEAST + int(POLISH_SHARE * self.expansions)
            self.best_cost, _, moves = choices[free]
            self.best = self._moves_to(node) + moves

    def _moves_to(self, node: int) -> list[Move]:
        moves: list[Move] = []
        while self._parents[node] >= 0:
            primitive = self._primitives[self._arrivals[node]]
            moves.append(Move(primitive.curvature, self._shares[node] * primitive.length))
            node = self._parents[node]
        return moves[::-1]
