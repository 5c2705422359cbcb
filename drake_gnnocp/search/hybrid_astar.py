r"""Hybrid A*: a collision-free path with gears among exact polygons (Dolgov et al. 2008), in plain Python and numpy.

Two searches take turns, one from the start and one from the goal: the car's kinematics is reversible, and getting out
of a slot is much easier to search than getting in. On long ways one of them goes first. Heading cells of 45 degrees
(the paper's) are coarse. When both searches end without a path, or take too many expansions, the next stage of
`SCHEDULE` looks with finer headings, shorter motion primitives, a smaller safety margin and the better heuristic of
`lattice`. That one takes gaps for ways that are too tight to be driven through, so one stage looks early for a way that
has some room everywhere. The path is then shortened, see `shortcut`.

Every stage searches first the surroundings of start and goal, then the whole map, where that is more; see `regions`.
A region in which the holonomic heuristic proves that there is no way is left out.

Where the first stage finds nothing, `reachability` tries to prove that there is no path. Later on the search gives up
where the states that can be reached from the start, or from which the goal can be, are exhausted at the finest
resolution. That is tried early, for few expansions, from an end whose states a coarser stage exhausted: from a slot in
which the car can hardly move there are few. Where there are more, the place is `CONFINED`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import islice

from drake_gnnocp.budget import Budget
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.search.arena import CELL_COUNTS, FEW_STATES, Arena, Run
from drake_gnnocp.search.connection import connect
from drake_gnnocp.search.graph_search import CANDIDATES, Outcome
from drake_gnnocp.search.moves import Move, poses_along
from drake_gnnocp.search.path import GearedPath
from drake_gnnocp.search.reachability import NoPath, has_many_corners, no_path
from drake_gnnocp.search.reeds_shepp import path_length
from drake_gnnocp.search.regions import search_regions
from drake_gnnocp.search.shortcut import shortened
from drake_gnnocp.search.stages import CONFINED, SCHEDULE, HybridAStarOptions, Stage, resolution_of

MOST_COST = 2.0  # of a direct path over the length of the car


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
    regions = zip(search_regions(scenario), CELL_COUNTS, strict=False)
    arenas = [Arena(scenario, region, cells, options, budget) for region, cells in regions]
    if arenas[0].encloses_an_end:
        arenas = []
    stages, expansions = list(SCHEDULE[first_stage:last_stage]), 0
    for number, stage in enumerate(stages):
        run = None
        for arena in _in_order(arenas, stage):
            run = arena.run(stage)
            expansions += run.expansions
            if run.moves is not None:
                moves = shortened(scenario, run.moves, run.test, options.costs, budget)
                return SearchResult(_geared_path(scenario, moves, run.test.spacing), "found", expansions)
            if run.outcome is Outcome.OUT_OF_TIME:
                return SearchResult(None, "out of time", expansions)
        # where there are many corners the proof takes long, and comes where all has failed
        is_worth_it = run is None or not has_many_corners(scenario)
        if number == 0 and is_worth_it and not budget.is_over and (proof := no_path(scenario)) is not None:
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
    arena = Arena(scenario, search_regions(scenario)[0], CELL_COUNTS[0], options, Budget.unlimited())
    test, cost_of = arena.test(SCHEDULE[0]), partial(options.costs.of, sharpest=1.0 / radius)
    limit = MOST_COST * longest
    found = connect(scenario.start, scenario.goal, radius, test, cost_of, limit, CANDIDATES)
    return None if found is None else _geared_path(scenario, found[1], test.spacing)


def _in_order(arenas: Sequence[Arena], stage: Stage) -> Iterator[Arena]:
    """The arenas that a stage searches, those that seem to have a way first.

    Without lattices that is the first one, with those of states with room only those that have a way.
    """
    possible = (arena for arena in arenas if not arena.has_no_way)
    if stage.room is None:
        yield from islice(possible, 1)
        return
    later = []
    for arena in possible:
        if arena.knows_way(stage.room):
            yield arena
        elif stage.room == 0.0:
            later.append(arena)
    yield from later


def _all_states(stage: Stage, run: Run, arena: Arena | None) -> int:
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
    cell, angle = (getattr(resolution_of(options, SCHEDULE[-1]), name) for name in ("position", "heading"))
    resolution = f"cells of {{length}} and {math.degrees(angle):.2g} degrees or finer"
    why = f"the search exhausted all {states} states at its finest resolution ({resolution}), which is not a proof"
    return NoPath(why, proven=False, length=cell)


def _geared_path(scenario: Scenario, moves: list[Move], step: float) -> GearedPath:
    """The poses along moves, the last one moved by its rounding error onto the goal."""
    path = poses_along(scenario.start, moves, step)
    turns = round((path.poses[-1, 2] - scenario.goal[2]) / (2 * math.pi))
    path.poses[-1] = scenario.goal + (0.0, 0.0, 2 * math.pi * turns)
    return path
