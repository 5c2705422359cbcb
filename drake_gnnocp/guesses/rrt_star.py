"""RRT*, gears and headings for its path, and the speed planner: the paper's baseline."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass

from drake_gnnocp.budget import Budget
from drake_gnnocp.guesses.base import Guess, GuessUnavailable, NoGuess
from drake_gnnocp.guesses.hybrid_astar import timed
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.search.polyline import geared
from drake_gnnocp.search.rrt_star import MOST_ITERATIONS, is_available, rrt_star_path


@dataclass(frozen=True)
class RrtStar:
    """The path of a sampling search that knows nothing of steering."""

    knots: int  # at least: a path of many gear changes gets more
    seed: int = 0
    name: str = "rrt_star"
    proposes_many: bool = False

    def check_available(self) -> None:
        """Raise GuessUnavailable where OMPL is not installed."""
        if not is_available():
            raise GuessUnavailable("guess: 'rrt_star' needs OMPL: pip install ompl, or pip install -e .[rrt_star]")

    def guesses(self, scenario: Scenario, budget: Budget) -> Iterator[Guess | NoGuess]:
        """The path found, or why there is none."""
        begin = time.monotonic()
        line = rrt_star_path(scenario, budget, self.seed)
        if line is None:
            no_path = f"no path ({MOST_ITERATIONS} iterations at most in each search)"
            reason = f"RRT*: {budget.ended_before('it found a path') if budget.ended else no_path}"
            yield NoGuess(self.name, reason, time.monotonic() - begin)
            return
        path = geared(line, scenario.start, scenario.goal, scenario.vehicle)
        trajectory = timed(path, scenario.vehicle, self.knots)
        yield Guess(self.name, trajectory, time.monotonic() - begin, path)
