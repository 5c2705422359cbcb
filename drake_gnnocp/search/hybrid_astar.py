r"""Hybrid A*: a collision-free path with gears among exact polygons (Dolgov et al. 2008), in plain Python and numpy.

Two searches take turns, one from the start and one from the goal: the car's kinematics is reversible, and getting out
of a slot is much easier to search than getting in. Heading cells of 45 degrees (the paper's) are coarse. When both
searches end without a path, or take too many expansions, the next stage of `SCHEDULE` looks with finer headings,
shorter motion primitives, a smaller safety margin and the better heuristic of `lattice`. The path is then shortened,
see `shortcut`.

Every stage searches first the surroundings of start and goal, then the whole map, where that is more; see `regions`.
A region in which the holonomic heuristic proves that there is no way is left out.

Where the first stage finds nothing, `reachability` tries to prove that there is no path. Later on the search gives up
where the states that can be reached from the start, or from which the goal can be, are exhausted at the finest
resolution. That is tried early, for few expansions, from an end whose states a coarser stage exhausted: from a slot in
which the car can hardly move there are few. Where there are more, the place is `CONFINED`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import takewhile

import numpy as np

from drake_gnnocp.budget import Budget
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.search.collision import Box, FootprintTest, Margins
from drake_gnnocp.search.connection import connect
from drake_gnnocp.search.distance_field import DistanceField
from drake_gnnocp.search.graph_search import CANDIDATES, GraphSearch, Outcome, Query, Resolution
from drake_gnnocp.search.heuristic import HolonomicHeuristic
from drake_gnnocp.search.lattice import Lattice
from drake_gnnocp.search.moves import Costs, Move, backwards, merged, poses_along
from drake_gnnocp.search.path import GearedPath
from drake_gnnocp.search.reachability import NoPath, has_many_corners, no_path
from drake_gnnocp.search.reeds_shepp import path_length
from drake_gnnocp.search.regions import search_regions
from drake_gnnocp.search.shortcut import shortened
from drake_gnnocp.vehicle import Vehicle

INSTALMENT = 100  # expansions of one search before the other's turn
MOST_CELLS = (60_000, 150_000)  # of the distance fields of surroundings and map; larger areas get larger cells
SMALLEST_CELL = 0.2  # m
TIGHT_POSITION = 0.07  # m, side of a cell around an end where every motion primitive is blocked
TIGHT_HEADING = 0.066  # rad, heading cell there: a move of 0.2 m at full lock turns the car by one cell


@dataclass(frozen=True)
class Stage:
    """One entry of the schedule; lengths and angles are factors of those in the options or above."""

    position: float  # factor of the position resolution
    heading: float  # factor of the heading resolution
    length: float  # factor of the length of the motion primitives
    margin: float  # factor of the safety margin
    tight: float  # factor of TIGHT_POSITION and TIGHT_HEADING
    lattice: bool  # whether to use the better, slower heuristic
    expansions: int  # most expansions of each of the two searches


SCHEDULE = (
    Stage(position=1.0, heading=1.0, length=1.0, margin=1.0, tight=1.0, lattice=False, expansions=150),
    Stage(position=1.0, heading=1.0, length=1.0, margin=1.0, tight=0.6, lattice=True, expansions=500),
    Stage(position=1.0, heading=1 / 3, length=0.7, margin=0.6, tight=0.3, lattice=True, expansions=1500),
    Stage(position=1.0, heading=1 / 6, length=0.5, margin=0.25, tight=0.3, lattice=True, expansions=3000),
    Stage(position=0.7, heading=1 / 9, length=0.4, margin=0.08, tight=0.3, lattice=True, expansions=15000),
    Stage(position=0.5, heading=1 / 15, length=0.3, margin=0.04, tight=0.2, lattice=True, expansions=30000),
)
# after a stage that exhausted the states of an end, where they are not few: long moves are worth more than fine cells
CONFINED = Stage(position=1.0, heading=1 / 6, length=1.0, margin=0.04, tight=0.3, lattice=True, expansions=3000)
FEW_STATES = 1500  # expansions at the finest resolution, to see whether the states of an end are exhausted
LEAST_CLEARANCE = 0.05  # m, at an end: where there is less, moves too small for any of these resolutions may help
MOST_COST = 2.0  # of a direct path over the length of the car


@dataclass(frozen=True)
class HybridAStarOptions:
    """What a user may set; the resolutions are the paper's."""

    position_resolution: float = 0.2  # m
    heading_resolution: float = 0.785  # rad
    primitive_length: float = 1.0  # m, of the motion primitives
    steering_levels: int = 5  # from full left to full right
    margin: float = 0.12  # m, the car is grown by this on all sides
    heuristic_weight: float = 3.0  # above 1: faster, less cheap paths
    costs: Costs = field(default_factory=Costs)


@dataclass(frozen=True)
class SearchResult:
    """What a search found."""

    path: GearedPath | None  # from the start to the goal exactly, poses at most 0.2 m apart
    status: str  # "found", "no path" or "out of time"
    expansions: int  # nodes expanded in all stages
    no_path: NoPath | None = None  # why there is none, where that is proven or the search space is exhausted


DEFAULT_OPTIONS = HybridAStarOptions()


def search(
    scenario: Scenario,
    budget: Budget,
    options: HybridAStarOptions = DEFAULT_OPTIONS,
    first_stage: int = 0,
    last_stage: int = len(SCHEDULE),
) -> SearchResult:
    """Find a path with gears from the scenario's start to its goal.

    Coordinates should be near the origin (see `Scenario.translated`). The same input gives the same output unless the
    budget ends the search.

    Args:
        scenario: the task.
        budget: when it is over, the search gives up.
        options: resolutions and costs.
        first_stage: index into `SCHEDULE`; later stages look more finely and find other paths.
        last_stage: index after that of the last one.
    """
    if budget.is_over:
        return SearchResult(None, "out of time", 0)
    regions = zip(search_regions(scenario), MOST_CELLS, strict=False)
    arenas = [_Arena(scenario, region, cells, options, budget) for region, cells in regions]
    if arenas[0].encloses_an_end:
        arenas = []
    stages, expansions = list(SCHEDULE[first_stage:last_stage]), 0
    for number, stage in enumerate(stages):
        run = None
        for arena in arenas:
            if arena.has_no_way:
                continue
            run = arena.run(stage)
            expansions += run.expansions
            if run.moves is not None:
                moves = shortened(scenario, run.moves, run.test, options.costs, budget)
                return SearchResult(_geared_path(scenario, moves, run.test.spacing), "found", expansions)
            if run.outcome is Outcome.OUT_OF_TIME:
                return SearchResult(None, "out of time", expansions)
        is_quick = not has_many_corners(scenario)  # the proof; otherwise it comes where all has failed
        if number == 0 and is_quick and not budget.is_over and (proof := no_path(scenario)) is not None:
            return SearchResult(None, "no path", expansions, proof)
        if run is None or not any(run.exhausted):
            continue
        if states := _all_states(stage, run, None if CONFINED in stages else arenas[-1]):
            return SearchResult(None, "no path", expansions, _exhausted(states, options))
        if CONFINED not in stages:
            stages.insert(number + 1, CONFINED)
    # heuristics that were cut short are infinite where they did not get to, which proves nothing
    return SearchResult(None, "out of time" if budget.ended else "no path", expansions)


def direct(scenario: Scenario, options: HybridAStarOptions = DEFAULT_OPTIONS) -> GearedPath | None:
    """A free path without a search, where start and goal are so near that it is no longer than the car; else None.

    Args:
        scenario: the task, near the origin.
        options: costs and margin.
    """
    radius, longest = scenario.vehicle.turning_radius, scenario.vehicle.length
    if path_length(tuple(scenario.start), scenario.goal, radius) > longest:
        return None
    arena = _Arena(scenario, search_regions(scenario)[0], MOST_CELLS[0], options, Budget.unlimited())
    test, cost_of = arena.test(SCHEDULE[0]), partial(options.costs.of, sharpest=1.0 / radius)
    limit = MOST_COST * longest
    found = connect(scenario.start, scenario.goal, radius, test, cost_of, limit, CANDIDATES)
    return None if found is None else _geared_path(scenario, found[1], test.spacing)


def _all_states(stage: Stage, run: _Run, arena: _Arena | None) -> int:
    """How many states there are at the finest resolution from start or goal; 0 where that is not known.

    Args:
        stage: the last one.
        run: its, which exhausted the states of an end.
        arena: of the whole map, to look for few states in; None where that was done.
    """
    if arena is not None:
        return arena.few_states(run.exhausted)
    states = max(run.exhausted)
    return states if stage is SCHEDULE[-1] and states > FEW_STATES else 0


def _exhausted(states: int, options: HybridAStarOptions) -> NoPath:
    cell, angle = (getattr(_resolution(options, SCHEDULE[-1]), name) for name in ("position", "heading"))
    resolution = f"cells of {{length}} and {math.degrees(angle):.2g} degrees or finer"
    why = f"the search exhausted all {states} states at its finest resolution ({resolution}), which is not a proof"
    return NoPath(why, proven=False, length=cell)


@dataclass(frozen=True, eq=False)
class _Run:
    """What both searches of one stage came to."""

    outcome: Outcome
    moves: list[Move] | None  # of the path, None without one
    test: FootprintTest
    expansions: int
    exhausted: tuple[int, ...]  # states from the start, and from the goal, where that search exhausted them, else 0


class _Arena:
    """One region with its distances and heuristics, which are made when they are first needed."""

    def __init__(
        self, scenario: Scenario, region: Box, most_cells: int, options: HybridAStarOptions, budget: Budget
    ) -> None:
        self._scenario, self._region, self._most_cells = scenario, region, most_cells
        self._options, self._budget = options, budget

    @cached_property
    def _field(self) -> DistanceField:
        # where the budget ends it, the field is incomplete, and the search ends before it looks there
        rings = takewhile(lambda _: not self._budget.is_over, self._scenario.convex_obstacles)
        return distance_field(
            rings,
            self._scenario.vehicle,
            self._region,
            self._most_cells,
            max(self._options.margin, self._scenario.clearance),
        )

    @cached_property
    def _queries(self) -> list[Query]:
        return _queries(self._scenario, self._field, self._budget)

    @cached_property
    def _queries_with_lattice(self) -> list[Query]:
        with_lattice = partial(_with_lattice, field=self._field, region=self._region, budget=self._budget)
        return [with_lattice(query, self._scenario) for query in self._queries]

    @cached_property
    def has_no_way(self) -> bool:
        """Whether the holonomic heuristic proves that there is no path, or there was no time to compute it."""
        start = self._scenario.start
        return math.isinf(self._queries[0].holonomic.at(start[:1], start[1:2])[0])

    @cached_property
    def encloses_an_end(self) -> bool:
        """Whether start or goal is walled in on all sides: then no larger region has a way either."""
        return self.has_no_way and not all(query.holonomic.reaches_the_rim for query in self._queries)

    def run(self, stage: Stage) -> _Run:
        """Search at one stage."""
        queries = self._queries_with_lattice if stage.lattice else self._queries
        test, resolution = self.test(stage), _resolution(self._options, stage)
        searches = [GraphSearch(query, test, *self._common, resolution) for query in queries]
        outcome = _take_turns(searches, stage.expansions, self._budget)
        exhausted = tuple(one.expansions if one.is_exhausted else 0 for one in searches)
        return _Run(outcome, _best(searches), test, sum(one.expansions for one in searches), exhausted)

    def few_states(self, exhausted: tuple[int, ...]) -> int:
        """How many states there are at the finest resolution from an end whose states a stage exhausted.

        0 where they are not few, or where the finest resolution is not fine enough to tell.
        """
        finest = _resolution(self._options, SCHEDULE[-1])
        for query, at_stage, nearest in zip(self._queries, exhausted, self._scenario.nearest_at_ends, strict=True):
            if at_stage and nearest > LEAST_CLEARANCE:
                one = GraphSearch(query, self.test(SCHEDULE[-1]), *self._common, finest)
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
    rings: Iterable[np.ndarray], vehicle: Vehicle, region: Box, most_cells: int, margin: float
) -> DistanceField:
    """Distances to convex rings over a region, as coarse as makes it no more than so many cells; margin [m]."""
    cell = max(SMALLEST_CELL, math.sqrt((region[1] - region[0]) * (region[3] - region[2]) / most_cells))
    cut_off = vehicle.width + 2.0 * (margin + cell)  # beyond it every covering circle is free
    return DistanceField.of(rings, region, cell, cut_off)


def _queries(scenario: Scenario, field: DistanceField, budget: Budget) -> list[Query]:
    """The search from the start and the one from the goal."""
    start, goal, vehicle = scenario.start, scenario.goal, scenario.vehicle
    return [
        Query(start, goal, False, HolonomicHeuristic.of(field, vehicle, goal, budget), None),
        Query(goal, start, True, HolonomicHeuristic.of(field, vehicle, start, budget), None),
    ]


def _with_lattice(query: Query, scenario: Scenario, field: DistanceField, region: Box, budget: Budget) -> Query:
    lattice = Lattice.of(field, scenario.vehicle, query.target, query.holonomic, region, budget)
    return replace(query, lattice=lattice)


def _resolution(options: HybridAStarOptions, stage: Stage) -> Resolution:
    return Resolution(
        position=stage.position * options.position_resolution,
        heading=stage.heading * options.heading_resolution,
        primitive_length=stage.length * options.primitive_length,
        steering_levels=options.steering_levels,
        weight=options.heuristic_weight,
        tight_position=stage.tight * TIGHT_POSITION,
        tight_heading=stage.tight * TIGHT_HEADING,
    )


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


def _best(searches: Sequence[GraphSearch]) -> list[Move] | None:
    from_start, from_goal = searches
    if from_start.best is None and from_goal.best is None:
        return None
    if from_start.best is not None and from_start.best_cost <= from_goal.best_cost:
        return merged(from_start.best)
    assert from_goal.best is not None
    return merged(backwards(from_goal.best))


def _geared_path(scenario: Scenario, moves: list[Move], step: float) -> GearedPath:
    """The poses along moves, the last one moved by its rounding error onto the goal."""
    path = poses_along(scenario.start, moves, step)
    turns = round((path.poses[-1, 2] - scenario.goal[2]) / (2 * math.pi))
    path.poses[-1] = scenario.goal + (0.0, 0.0, 2 * math.pi * turns)
    return path
