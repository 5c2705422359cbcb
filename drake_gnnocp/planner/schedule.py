"""What the planner tries, in order, until a plan is verified and no better one is looked for."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

from drake_gnnocp.budget import Budget
from drake_gnnocp.guesses import Guess, GuessSource, GuessUnavailable, HybridAStar, NoGuess, Straight
from drake_gnnocp.guesses.hybrid_astar import timed
from drake_gnnocp.ocp.formulation import formulate
from drake_gnnocp.ocp.refine import RESERVE
from drake_gnnocp.ocp.sqp import LEARNED, SqpSteps, sqp_steps
from drake_gnnocp.planner import many_shifts
from drake_gnnocp.planner.attempt import Attempt, attempt
from drake_gnnocp.planner.horizon import Fixed, Horizon, MinimumTime
from drake_gnnocp.planner.options import SOURCES, PlanOptions
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.search.hybrid_astar import HybridAStarOptions, direct
from drake_gnnocp.search.moves import Costs

logger = logging.getLogger(__name__)

LEAST_SECONDS = 5.0  # s, given to an attempt before any is kept for the next one
SEARCH_SHARE = 0.7  # of the time, at most, for a search
CHOOSING_SHARE, CHOOSING_SECONDS = 0.1, 2.0  # of the time, and s (but half of it at most), for choosing a hypothesis
HYPOTHESIS_SHARE, FIRST_SHARE, OTHER_SHARE = 0.1, 0.4, 0.5  # of the time that is left, for a solve
NO_GUESSES = "the source made no guess"
NONE_CONVERGED = "the optimiser got near a plan from none of the guesses"
# where time is what counts, reversing and turning cost nothing, but a car that stops, turns its wheels and drives off
# again could have gone 5 m
QUICK = Costs(reverse=0.0, steering=0.0, gear_change=5.0, steering_change=0.2)


@dataclass
class Schedule:
    """One task with the attempts so far."""

    scenario: Scenario  # near the origin
    horizon: Horizon
    budget: Budget
    options: PlanOptions
    attempts: list[Attempt] = field(default_factory=list)

    def automatic(self) -> None:
        """A move shorter than the car where there is one, the network's best hypothesis, then Hybrid A*."""
        if (path := direct(self.scenario, self.options.search)) is not None:
            self._try(Guess("reeds_shepp", timed(path, self.scenario.vehicle, self.options.knots), path=path))
            if not self._may_go_on:
                return
        network = SOURCES["gnn"](self.options)
        try:
            network.check_available()
        except GuessUnavailable as error:
            logger.warning("%s; going on with Hybrid A*", error)
        else:
            self._try_hypotheses(network, only_best=True)
        if self._may_go_on:
            self.try_source(SOURCES["hybrid_astar"](self.options))

    def try_source(self, source: GuessSource) -> None:
        """The guesses of one source, by the way in which it makes them."""
        if source.proposes_many:
            self._try_hypotheses(source, only_best=False)
            return
        for guess in source.guesses(self.scenario, self.budget.share(SEARCH_SHARE)):
            self._try_path(source, guess)
            if not self._may_go_on or self.attempts[-1].is_refused:
                return
        if not self.attempts:
            self._try(NoGuess(source.name, NO_GUESSES))

    @property
    def _is_verified(self) -> bool:
        return any(made.verified for made in self.attempts)

    @property
    def _may_go_on(self) -> bool:
        """Whether there is a reason for another attempt, and time and leave for it."""
        if self._is_verified and not isinstance(self.horizon, MinimumTime):
            return False
        if self.options.most_attempts is not None and len(self.attempts) >= self.options.most_attempts:
            return False
        return not self.attempts or not self.budget.without(RESERVE).is_over

    def _try(
        self,
        guess: Guess | NoGuess,
        share: float = 1.0,
        steps: SqpSteps | None = None,
        closely: bool | None = None,
    ) -> Attempt:
        budget = self.budget.share(share, at_least=LEAST_SECONDS)
        made = attempt(self.scenario, guess, self.horizon, budget, self.options, steps, closely)
        logger.info("%s: %s", made.source, made.reason or "verified")
        self.attempts.append(made)
        return made

    def _try_path(self, source: GuessSource, guess: Guess | NoGuess) -> None:
        """A searched path, and where time is minimised other ones; where that fails, the path in other ways."""
        if isinstance(guess, NoGuess) or guess.path is None:
            self._try(guess)
            gave_up = isinstance(guess, NoGuess) and guess.no_path is None
            if gave_up and isinstance(source, HybridAStar) and self._may_go_on:
                straight = Straight(self.options.knots)  # seldom enough, but an attempt to look at
                self._try(self._first(straight), OTHER_SHARE)
            return
        # a search finds no shorter path for the next attempt than the one before
        if self._try(guess, FIRST_SHARE).is_refused:
            return
        if isinstance(self.horizon, MinimumTime) and isinstance(source, HybridAStar):
            self._try_other_searches()
        if self._may_go_on and not self._is_verified and not many_shifts.has_many(guess):
            self._try(replace(guess, seconds=0.0), closely=True)

    def _try_other_searches(self) -> None:
        """Searches by time with finer moves from the beginning: other paths to optimise."""
        for first in (1, 2):
            if not self._may_go_on:
                return
            search = HybridAStar(self.options.knots, HybridAStarOptions(costs=QUICK), first)
            found = self._first(search, SEARCH_SHARE)
            if isinstance(found, Guess):
                self._try(found, OTHER_SHARE)

    def _try_hypotheses(self, source: GuessSource, only_best: bool) -> None:
        """The hypotheses that SQP steps converge from, in turn.

        Args:
            source: of hypotheses.
            only_best: whether only the first of them is solved, since there is a surer next attempt than another one.
                Otherwise all are, and the most promising hypothesis as it is where none leads to a plan.
        """
        if isinstance(self.horizon, Fixed):  # SQP steps were not made for a duration that is not the hypothesis's
            self._try(self._first(source), HYPOTHESIS_SHARE if only_best else 1.0)
            return
        begin, left = time.monotonic(), self.budget.left
        choosing = self.budget.at_most(max(CHOOSING_SHARE * left, min(CHOOSING_SECONDS, left / 2)))
        for guess, steps in screened(self.scenario, source, choosing if only_best else self.budget, self.options):
            self._try(guess, HYPOTHESIS_SHARE, steps)
            if only_best or not self._may_go_on:
                return
        if only_best:
            self._try(NoGuess(source.name, NONE_CONVERGED, time.monotonic() - begin))
        elif self._may_go_on:
            self._try(self._first(source), HYPOTHESIS_SHARE)

    def _first(self, source: GuessSource, share: float = 1.0) -> Guess | NoGuess:
        return next(source.guesses(self.scenario, self.budget.share(share)), NoGuess(source.name, NO_GUESSES))


def screened(
    scenario: Scenario, source: GuessSource, budget: Budget, options: PlanOptions
) -> Iterator[tuple[Guess, SqpSteps]]:
    """The hypotheses that SQP steps converge from, in the order given, each looked for when it is asked for.

    Hypotheses are cheap, and SQP steps cost a tenth of a second. On validation maps, steps that had converged led to a
    verified plan practically always and within a few iterations of Ipopt, and steps that had not mostly to none.

    Args:
        scenario: the task, near the origin.
        source: of hypotheses, the most promising first.
        budget: when it is over, no hypothesis is looked at.
        options: see `PlanOptions`.

    Yields:
        The hypothesis, with the time spent since the last one, and where the steps led.
    """
    begin = time.monotonic()
    for guess in source.guesses(scenario, budget):
        if budget.is_over or not options.sqp or isinstance(guess, NoGuess):
            break
        formulation = formulate(scenario, guess.trajectory, options.cost, options.margin)
        steps = sqp_steps(formulation, LEARNED, budget)
        if steps.converged:
            yield replace(guess, seconds=time.monotonic() - begin - steps.seconds), steps
            begin = time.monotonic()
