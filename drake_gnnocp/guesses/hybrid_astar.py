"""Hybrid A* and the speed planner."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, field

from drake_gnnocp.budget import Budget
from drake_gnnocp.guesses.base import Guess, NoGuess
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.search.hybrid_astar import SearchResult, search
from drake_gnnocp.search.path import GearedPath, length_of, n_sections
from drake_gnnocp.search.stages import SCHEDULE, HybridAStarOptions
from drake_gnnocp.timing.speed_planner import FEWEST_INTERVALS, plan_speed
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import Vehicle

# m, in units in which the car has its usual length: knots farther apart than the radius of a turn do not show the turn
SPACING = 0.6
MOST_BY_LENGTH = 600  # knots


@dataclass(frozen=True)
class HybridAStar:
    """The path of a search, with the timing of the speed planner."""

    knots: int  # at least: a path of many gear changes gets more
    options: HybridAStarOptions = field(default_factory=HybridAStarOptions)
    first_stage: int = 0  # see `search.hybrid_astar.search`, as for the next
    last_stage: int = len(SCHEDULE)
    name: str = "hybrid_astar"
    proposes_many: bool = False

    @property
    def goes_to_the_end(self) -> bool:
        """Whether all is searched that can be."""
        return self.last_stage == len(SCHEDULE)

    def check_available(self) -> None:
        """Nothing is needed."""

    def guesses(self, scenario: Scenario, budget: Budget) -> Iterator[Guess | NoGuess]:
        """The path found, or why there is none."""
        begin = time.monotonic()
        found = search(scenario, budget, self.options, self.first_stage, self.last_stage)
        if found.path is None:
            why = budget.ended_before("it found a path") if budget.ended else _reason(found)
            yield NoGuess(self.name, why, time.monotonic() - begin, found.no_path)
            return
        trajectory = timed(found.path, scenario.vehicle, self.knots)
        yield Guess(self.name, trajectory, time.monotonic() - begin, found.path)


def _reason(found: SearchResult) -> str:
    if found.no_path is not None:
        return found.no_path.text
    how = "ran out of time" if found.status == "out of time" else "found no path and gave up"
    return f"the search {how} after {found.expansions} expansions"


def timed(path: GearedPath, vehicle: Vehicle, knots: int) -> Trajectory:
    """A path with the timing of the speed planner, at no fewer knots than its gear changes and its length need."""
    by_length = min(MOST_BY_LENGTH, math.ceil(length_of(path) / SPACING))
    return plan_speed(path, vehicle, max(knots, FEWEST_INTERVALS * n_sections(path) + 1, by_length))
