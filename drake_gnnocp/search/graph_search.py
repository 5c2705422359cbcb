r"""One Hybrid A* search: from a root pose to a target pose at one resolution of the grid.

Nodes are continuous poses; of those in one cell of (x, y, theta) only the cheapest is kept. A node's successors are
the collision-free motion primitives, shortened where they would collide. Nodes are expanded in the order of

    f = g + weight * max(V(x, y), RS(pose), lattice(pose)).

V and RS are Dolgov's two heuristics: V, holonomic with obstacles, is the way of a disc around the rear axle's middle,
and RS, non-holonomic without obstacles, is the length of the shortest Reeds-Shepp path. The lattice is an optional
third. V is computed when a node is generated, the others only when the node comes to the front of the queue, since
most nodes never get there; where they raise its f, the node goes back into the queue. From some nodes, the nearer the
target the more of them, Reeds-Shepp paths to the target are tried, the cheapest first. After the first success the
search goes on for a while: the first path is rarely the best.

Around a tight root (every primitive from it is blocked, as in a short slot) the cells are much finer: a car that
wriggles out moves by centimetres and degrees. There are few free poses there, so this costs little.
"""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass
from enum import Enum
from functools import partial

import numpy as np

from drake_gnnocp.budget import Budget
from drake_gnnocp.search.collision import Box, FootprintTest
from drake_gnnocp.search.connection import connect
from drake_gnnocp.search.heuristic import HolonomicHeuristic
from drake_gnnocp.search.lattice import Lattice
from drake_gnnocp.search.motion_primitives import MotionPrimitives, placed
from drake_gnnocp.search.moves import Costs, Move
from drake_gnnocp.search.reeds_shepp import path_length

Pose = tuple[float, float, float]  # x, y, theta [m, m, rad]

CLOCK_EVERY = 4  # expansions between looks at the clock: less than 20 ms
CANDIDATES = 6  # Reeds-Shepp paths tried from one node
TRY_PER_METRE = 0.3  # expansions to wait until the next Reeds-Shepp trial, per metre of weighted heuristic
POLISHING = 40  # expansions after the first path
TIGHT_RADIUS = 2.5  # m, around a tight root, within which the cells are fine
TIGHT_SPACING = 0.03  # m, largest distance between the poses at which a motion primitive may end there


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
    primitive_length: float  # m, of the motion primitives
    steering_levels: int  # from full left to full right, odd so that straight is one of them
    weight: float  # of the heuristic; above 1 is greedy
    tight_position: float  # m, side of a cell around a tight root
    tight_heading: float  # rad, heading cell there


@dataclass(frozen=True, eq=False)
class Query:
    """What one search is asked."""

    root: np.ndarray  # (3,) pose to search from [m, m, rad]
    target: np.ndarray  # (3,) pose to reach [m, m, rad]
    driven_backwards: bool  # the path will be driven from target to root: its forward moves cost what reversing costs
    holonomic: HolonomicHeuristic  # to the target, with obstacles
    lattice: Lattice | None  # to the target: better than the other two and slow, where it has been computed


class GraphSearch:
    """A search that can be run in instalments.

    Args:
        query: from where to where, with the heuristics.
        test: the collision test.
        region: xmin, xmax, ymin, ymax of all poses [m].
        turning_radius: smallest radius [m].
        costs: what a path costs.
        resolution: the grid and the motion primitives.
        fine: whether the cells around the root are fine even where it is not tight.
    """

    def __init__(
        self,
        query: Query,
        test: FootprintTest,
        region: Box,
        turning_radius: float,
        costs: Costs,
        resolution: Resolution,
        fine: bool = False,
    ) -> None:
        self.best: list[Move] | None = None
        self.best_cost = math.inf
        self.expansions = 0
        self._query, self._test, self._radius = query, test, turning_radius
        self._costs, self._resolution = costs, resolution
        self._xmin, self._ymin, self._height = region[0], region[2], region[3] - region[2]
        self._sign = -1.0 if query.driven_backwards else 1.0
        length, levels = resolution.primitive_length, resolution.steering_levels
        self._primitives = MotionPrimitives(length, levels, turning_radius, costs, self._sign)
        self._shapes = self._primitives.sampled(test.spacing)
        self._tight_shapes = self._primitives.sampled(min(test.spacing, TIGHT_SPACING))
        x, y, theta = map(float, query.root)
        free = self._free_steps(placed(self._shapes, (x, y, theta)))
        self.root_is_tight = fine or bool((free < self._shapes.shape[1]).all())
        # the nodes, column by column
        self._poses: list[Pose] = []
        self._g: list[float] = []
        self._parents: list[int] = []
        self._arrivals: list[int] = []  # the motion primitive each node was reached by, -1 for the root
        self._shares: list[float] = []  # how much of that primitive was driven
        self._keys: list[int] = []
        self._complete: list[bool] = []  # whether the node's f has all of the heuristic
        self._cheapest: dict[int, float] = {}  # g of the cheapest node of a cell
        self._closed: set[int] = set()
        self._queue: list[tuple[float, int]] = []
        self._next_try = 0
        self._last_expansion = math.inf  # where polishing ends
        self._offer((x, y, theta), 0.0, -1, -1, 0.0, self._key(query.root[None])[0], 0.0)

    @property
    def is_exhausted(self) -> bool:
        """Whether every state that can be reached from the root at this resolution was expanded, without a path."""
        return not self._queue and self.best is None

    def run(self, expansions: int, budget: Budget) -> Outcome:
        """Search on for a number of expansions, or until the budget is over."""
        pause = self.expansions + expansions
        while self._queue:
            if self.expansions % CLOCK_EVERY == 0 and budget.is_over:
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

    def _key(self, poses: np.ndarray) -> list[int]:
        """The cell of each pose (N, 3) as one integer; those of the fine cells around a tight root are negative."""
        resolution, root = self._resolution, self._query.root
        keys = self._cells(poses, resolution.position, resolution.heading)
        if self.root_is_tight:
            is_fine = np.hypot(poses[:, 0] - root[0], poses[:, 1] - root[1]) < TIGHT_RADIUS
            keys[is_fine] = -1 - self._cells(poses[is_fine], resolution.tight_position, resolution.tight_heading)
        result: list[int] = keys.tolist()
        return result

    def _cells(self, poses: np.ndarray, side: float, heading: float) -> np.ndarray:
        headings = max(1, round(2 * math.pi / heading))
        i = ((poses[:, 0] - self._xmin) / side).astype(np.int64)
        j = ((poses[:, 1] - self._ymin) / side).astype(np.int64)
        turn = (poses[:, 2] - self._query.root[2]) * (headings / (2 * math.pi))
        return np.asarray((i * int(self._height / side + 2) + j) * headings + np.rint(turn).astype(np.int64) % headings)

    def _free_steps(self, poses: np.ndarray) -> np.ndarray:
        """How many of the K poses of each primitive, (P, K, 3), are driven before it collides: (P,)."""
        count = poses.shape[1]
        hit = self._test.collides(poses.reshape(-1, 3)).reshape(-1, count)
        return np.where(hit.any(axis=1), hit.argmax(axis=1), count)

    def _put_back(self, f: float, node: int) -> bool:
        """Complete the heuristic of a node; when that raises its f, queue the node again."""
        if self._complete[node]:
            return False
        self._complete[node] = True
        to_go = path_length(self._poses[node], self._query.target, self._radius)  # non-holonomic, without obstacles
        if self._query.lattice is not None:
            to_go = max(to_go, self._query.lattice.at(*self._poses[node]))
        complete = self._g[node] + self._resolution.weight * to_go
        if complete <= f:
            return False
        heapq.heappush(self._queue, (complete, node))
        return True

    def _expand(self, node: int) -> None:
        is_tight = self._keys[node] < 0
        shapes = self._tight_shapes if is_tight else self._shapes
        costs = [self._g[node] + cost for cost in self._primitives.costs_after[self._arrivals[node]]]
        keys = self._key(placed(shapes[:, -1], self._poses[node]))
        wanted = [
            p
            for p, key in enumerate(keys)
            if is_tight  # the primitive may not get as far as its end
            or (key not in self._closed and costs[p] < min(self._cheapest.get(key, math.inf), self.best_cost))
        ]
        if not wanted:
            return
        poses = placed(shapes[wanted], self._poses[node])
        free = self._free_steps(poses)
        reached = poses[np.arange(len(wanted)), free - 1]
        to_go = self._query.holonomic.at(reached[:, 0], reached[:, 1]).tolist()
        keys = self._key(reached)
        rows = zip(wanted, (free / poses.shape[1]).tolist(), reached.tolist(), keys, to_go, strict=True)
        for p, share, (x, y, theta), key, to_go_there in rows:
            if share > 0.0:
                cost = costs[p] - self._primitives.own_costs[p] * (1.0 - share)
                self._offer((x, y, theta), cost, node, p, share, key, to_go_there)

    def _offer(self, pose: Pose, g: float, parent: int, primitive: int, share: float, key: int, to_go: float) -> None:
        """Queue a new node, unless its cell has a cheaper one or the target cannot be reached from it."""
        if to_go == math.inf or key in self._closed or g >= self._cheapest.get(key, math.inf):
            return
        self._cheapest[key] = g
        self._poses.append(pose)
        self._g.append(g)
        self._parents.append(parent)
        self._arrivals.append(primitive)
        self._shares.append(share)
        self._keys.append(key)
        self._complete.append(False)
        heapq.heappush(self._queue, (g + self._resolution.weight * to_go, len(self._poses) - 1))

    def _try_to_finish(self, node: int) -> None:
        """Keep the cheapest free Reeds-Shepp path from a node to the target, if it is the best so far."""
        before = self._primitives.moves[self._arrivals[node]] if self._arrivals[node] >= 0 else None
        pose, g, cost_of = np.array(self._poses[node]), self._g[node], partial(self._cost, before)
        limit = self.best_cost - g
        found = connect(pose, self._query.target, self._radius, self._test, cost_of, limit, CANDIDATES)
        if found is not None:
            if self.best is None:
                self._last_expansion = self.expansions + POLISHING
            self.best_cost, self.best = g + found[0], self._moves_to(node) + found[1]

    def _cost(self, before: Move | None, moves: list[Move]) -> float:
        """Cost of moves after the move before them, in the direction they will be driven."""
        as_driven = [Move(move.curvature, self._sign * move.length) for move in moves]
        if before is not None:
            before = Move(before.curvature, self._sign * before.length)
        return self._costs.of(as_driven, 1.0 / self._radius, before)

    def _moves_to(self, node: int) -> list[Move]:
        moves: list[Move] = []
        while self._parents[node] >= 0:
            primitive = self._primitives.moves[self._arrivals[node]]
            moves.append(Move(primitive.curvature, self._shares[node] * primitive.length))
            node = self._parents[node]
        return moves[::-1]
