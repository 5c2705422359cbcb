"""One region that Hybrid A* searches: its distances, its heuristics, and both searches of a stage."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import takewhile
from operator import itemgetter

import numpy as np

from drake_gnnocp.budget import Budget
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.search.collision import Box, FootprintTest, Margins
from drake_gnnocp.search.distance_field import DistanceField
from drake_gnnocp.search.graph_search import GraphSearch, Outcome, Query
from drake_gnnocp.search.heuristic import HolonomicHeuristic
from drake_gnnocp.search.lattice import Lattice
from drake_gnnocp.search.moves import Costs, Move, backwards, merged
from drake_gnnocp.search.stages import SCHEDULE, HybridAStarOptions, Stage, resolution_of
from drake_gnnocp.vehicle import Vehicle

INSTALMENT = 100  # expansions of one search before the other's turn
CELL_COUNTS = (60_000, 150_000)  # of the distance fields of surroundings and map: larger areas get larger cells ...
SMALLEST_CELL = 0.2  # m
LARGE_CELL = 0.4  # m ... up to this size, in which the lattice still sees the gaps that the car fits through ...
MOST_CELLS = 1_000_000  # ... and beyond it in the largest
PER_METRE = 10  # expansions of one search for a metre of the way, where lattices know one
LONG_WAY = 100.0  # m: lattices of longer ones take so much time that one search goes first ...
PER_METRE_ALONE = 3  # ... with so many expansions for a metre of the way; most need half of them
FEW_STATES = 500  # expansions at the finest resolution, to see whether the states of an end are exhausted
LEAST_CLEARANCE = 0.05  # m, at an end: where there is less, moves too small for any of these resolutions may help


@dataclass(frozen=True, eq=False)
class Run:
    """What both searches of one stage came to."""

    outcome: Outcome
    moves: list[Move] | None  # of the path, None without one
    test: FootprintTest
    expansions: int
    exhausted: tuple[int, ...]  # states from the start, and from the goal, where that search exhausted them, else 0


class Arena:
    """One region with its distances and heuristics, which are made when they are first needed."""

    def __init__(
        self, scenario: Scenario, region: Box, cells: int, options: HybridAStarOptions, budget: Budget
    ) -> None:
        self._scenario, self._region, self._cells = scenario, region, cells
        self._options, self._budget = options, budget
        self._with_lattice: dict[tuple[int, float], Query] = {}

    @cached_property
    def _field(self) -> DistanceField:
        # where the budget ends it, the field is incomplete, and the search ends before it looks there
        rings = takewhile(lambda _: not self._budget.is_over, self._scenario.convex_obstacles)
        return distance_field(
            rings,
            self._scenario.vehicle,
            self._region,
            self._cells,
            max(self._options.margin, self._scenario.clearance),
        )

    @cached_property
    def _queries(self) -> list[Query]:
        return _queries(self._scenario, self._field, self._budget)

    def _query(self, which: int, room: float | None) -> Query:
        """What the search from the start, 0, or the goal, 1, is asked, with a lattice of states with some room [m]."""
        query, opposite = self._queries[which], self._queries[1 - which]
        if room is None:
            return query
        if (which, room) not in self._with_lattice:
            lattice = Lattice.of(
                self._field,
                self._scenario.vehicle,
                query.root,
                query.target,
                query.holonomic,
                opposite.holonomic,
                self._region,
                room,
                self._budget,
            )
            self._with_lattice[which, room] = replace(query, lattice=lattice)
        return self._with_lattice[which, room]

    @cached_property
    def way(self) -> float:
        """Length of the disc's way from start to goal [m]; infinite where there was no time to compute it."""
        start = self._scenario.start
        return float(self._queries[0].holonomic.at(start[:1], start[1:2])[0])

    @property
    def has_no_way(self) -> bool:
        """Whether the holonomic heuristic proves that there is no path, or there was no time to compute it."""
        return math.isinf(self.way)

    def knows_way(self, room: float) -> bool:
        """Whether the lattices of states with some room [m] have a way for the car."""
        lattices = [self._query(which, room).lattice for which in self._at_first]
        return all(lattice is not None and lattice.knows_way for lattice in lattices)

    @cached_property
    def _at_first(self) -> tuple[int, ...]:
        """Which searches a stage with lattices begins with.

        Both, or where the way is long the one from the end that is nearer to obstacles: getting out of a slot is
        easier than getting in.
        """
        return (0, 1) if self.way < LONG_WAY else (int(np.argmin(self._scenario.nearest_at_ends)),)

    @cached_property
    def encloses_an_end(self) -> bool:
        """Whether start or goal is walled in on all sides: then no larger region has a way either."""
        return self.has_no_way and not all(query.holonomic.reaches_the_rim for query in self._queries)

    def run(self, stage: Stage) -> Run:
        """Search at one stage."""
        test, resolution = self.test(stage), resolution_of(self._options, stage)
        searches: dict[int, GraphSearch] = {}

        def begin(which: int) -> GraphSearch:
            if which not in searches:
                searches[which] = GraphSearch(self._query(which, stage.room), test, *self._common, resolution)
            return searches[which]

        most, outcome = stage.expansions, Outcome.PAUSED
        if stage.room is not None and self.knows_way(stage.room):
            most = max(most, math.ceil(PER_METRE * self.way))
            if len(self._at_first) == 1:
                outcome = begin(self._at_first[0]).run(math.ceil(PER_METRE_ALONE * self.way), self._budget)
        if outcome is not Outcome.OUT_OF_TIME and all(one.best is None for one in searches.values()):
            outcome = _take_turns([begin(0), begin(1)], most, self._budget)
        exhausted = tuple(searches[k].expansions if k in searches and searches[k].is_exhausted else 0 for k in (0, 1))
        return Run(outcome, _best(searches), test, sum(one.expansions for one in searches.values()), exhausted)

    def few_states(self, exhausted: tuple[int, ...]) -> int:
        """How many states there are at the finest resolution from an end whose states a stage exhausted.

        0 where they are not few, or where the finest resolution is not fine enough to tell. In a slot in which the car
        shuffles out by moves of a few centimetres, it is so in fine cells only.
        """
        finest = resolution_of(self._options, SCHEDULE[-1])
        for query, at_stage, nearest in zip(self._queries, exhausted, self._scenario.nearest_at_ends, strict=True):
            if at_stage and nearest > LEAST_CLEARANCE:
                one = GraphSearch(query, self.test(SCHEDULE[-1]), *self._common, finest, fine=True)
                if one.run(FEW_STATES, self._budget) is Outcome.FINISHED and one.is_exhausted:
                    return one.expansions
        return 0

    def test(self, stage: Stage) -> FootprintTest:
        """The collision test of a stage."""
        margin = max(stage.margin * self._options.margin, self._scenario.clearance)
        return FootprintTest(self._scenario, self._field, self._region, Margins.of(self._scenario, margin))

    @property
    def _common(self) -> tuple[Box, float, Costs]:
        """What all searches of the arena are given."""
        return self._region, self._scenario.vehicle.turning_radius, self._options.costs


def distance_field(
    rings: Iterable[np.ndarray], vehicle: Vehicle, region: Box, cells: int, margin: float
) -> DistanceField:
    """Distances to convex rings over a region, in about so many cells where these are not too large; margin [m]."""
    area = (region[1] - region[0]) * (region[3] - region[2])
    cell = max(SMALLEST_CELL, min(math.sqrt(area / cells), LARGE_CELL), math.sqrt(area / MOST_CELLS))
    cut_off = vehicle.width + 2.0 * (margin + cell)  # beyond it every covering circle is free
    return DistanceField.of(rings, region, cell, cut_off)


def _queries(scenario: Scenario, field: DistanceField, budget: Budget) -> list[Query]:
    """The search from the start and the one from the goal."""
    start, goal, vehicle = scenario.start, scenario.goal, scenario.vehicle
    return [
        Query(start, goal, False, HolonomicHeuristic.of(field, vehicle, goal, budget), None),
        Query(goal, start, True, HolonomicHeuristic.of(field, vehicle, start, budget), None),
    ]


def _take_turns(searches: Sequence[GraphSearch], most: int, budget: Budget) -> Outcome:
    """Run both searches in turn until one has a path or none can go on."""
    outcomes = [Outcome.PAUSED, Outcome.PAUSED]
    tight = [one.root_is_tight for one in searches]
    instalments = [INSTALMENT if tight[k] or not tight[1 - k] else INSTALMENT // 4 for k in (0, 1)]
    for _ in range(math.ceil(most / INSTALMENT)):
        for which, one in enumerate(searches):
            if outcomes[which] is Outcome.PAUSED:
                outcomes[which] = one.run(instalments[which], budget)
            found = outcomes[which] is Outcome.FINISHED and one.best is not None
            if found or outcomes[which] is Outcome.OUT_OF_TIME:
                return outcomes[which]
        if outcomes == [Outcome.FINISHED, Outcome.FINISHED]:
            break
    return Outcome.FINISHED


def _best(searches: Mapping[int, GraphSearch]) -> list[Move] | None:
    """The moves of the cheaper path, from the start on, of the searches from the start, 0, and the goal, 1."""
    found = [(one.best_cost, which, one.best) for which, one in searches.items() if one.best is not None]
    if not found:
        return None
    _, which, moves = min(found, key=itemgetter(0, 1))
    return merged(moves if which == 0 else backwards(moves))
