"""What the planner tries, in order, until a plan is verified and no better one is looked for.

All limits are numbers of steps and iterations: a plan does not depend on how busy the machine is. The budget of time
only ends the work.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

from drake_gnnocp.budget import Budget
from drake_gnnocp.guesses import Guess, GuessSource, GuessUnavailable, HybridAStar, Learned, NoGuess, Straight
from drake_gnnocp.guesses.hybrid_astar import timed
from drake_gnnocp.ocp.formulation import formulate
from drake_gnnocp.ocp.sqp import LEARNED, SqpSteps, sqp_steps
from drake_gnnocp.planner import tight_paths
from drake_gnnocp.planner.attempt import Attempt, attempt
from drake_gnnocp.planner.horizon import Fixed, Horizon, MinimumTime
from drake_gnnocp.planner.options import SOURCES, PlanOptions
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.search.hybrid_astar import direct
from drake_gnnocp.search.moves import Costs
from drake_gnnocp.search.reachability import NoPath
from drake_gnnocp.search.stages import HybridAStarOptions

logger = logging.getLogger(__name__)

# where Hybrid A* comes next: SQP steps to choose a hypothesis (at most 95 led to one in 190 tasks), and the probability
# that they converge from one, below which they cost more than they save
MOST_SQP_STEPS, LEAST_PROBABILITY = 100, 0.25
NO_GUESSES = "the source made no guess"
FAR = "start and goal are farther apart than what the network was trained on"
NONE_CONVERGED = "the optimiser got near a plan from none of the guesses that were likely to lead to one"
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
    goal: int = 0  # index of the scenario's goal among all there are
    attempts: list[Attempt] = field(default_factory=list)

    def automatic(self) -> None:
        """A move shorter than the car where there is one, the network's best hypothesis, then Hybrid A*."""
        self.quick()
        if self._may_go_on:
            self.try_source(SOURCES["hybrid_astar"](self.options))

    def quick(self) -> None:
        """What `automatic` tries before it searches."""
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
            if isinstance(network, Learned) and network.is_far(self.scenario):
                self._try(NoGuess(network.name, FAR))
            else:
                self._try_hypotheses(network, only_best=True)

    def try_source(self, source: GuessSource) -> None:
        """The guesses of one source, by the way in which it makes them."""
        if source.proposes_many:
            self._try_hypotheses(source, only_best=False)
            return
        for i, guess in enumerate(source.guesses(self.scenario, self.budget)):
            if i > 0 and self.budget.is_over:
                return
            self._try_path(source, guess)
            if self._is_done or self.attempts[-1].is_refused:
                return
        if not self.attempts:
            self._try(NoGuess(source.name, NO_GUESSES))

    @property
    def is_verified(self) -> bool:
        """Whether there is a verified plan."""
        return any(made.verified for made in self.attempts)

    def refuse(self, prove: Callable[[Scenario], NoPath | None]) -> bool:
        """Add an attempt that says why there is no path, if that can be proven; whether it can."""
        begin = time.monotonic()
        proof = None if self.budget.is_over else prove(self.scenario)
        if proof is not None:
            seconds = time.monotonic() - begin
            made = Attempt("reachability", seconds, None, reason=proof.text, no_path=proof, goal=self.goal)
            self.attempts.append(made)
        return proof is not None

    @property
    def _is_done(self) -> bool:
        """Whether there is no reason, or no leave, for another attempt."""
        if self.is_verified and not isinstance(self.horizon, MinimumTime):
            return True
        return self.options.most_attempts is not None and len(self.attempts) >= self.options.most_attempts

    @property
    def _may_go_on(self) -> bool:
        """Whether there is a reason for another attempt, and time and leave for it."""
        return not self._is_done and (not self.attempts or not self.budget.is_over)

    def _try(self, guess: Guess | NoGuess, steps: SqpSteps | None = None, closely: bool | None = None) -> Attempt:
        made = attempt(self.scenario, guess, self.horizon, self.budget, self.options, steps, closely)
        made = replace(made, goal=self.goal)
        logger.info("%s: %s", made.source, made.reason or "verified")
        self.attempts.append(made)
        return made

    def _try_path(self, source: GuessSource, guess: Guess | NoGuess) -> None:
        """A searched path, and where time is minimised other ones; where that fails, the path in other ways."""
        if isinstance(guess, NoGuess) or guess.path is None:
            self._try(guess)
            gave_up = isinstance(guess, NoGuess) and guess.no_path is None
            if gave_up and isinstance(source, HybridAStar) and source.goes_to_the_end and self._may_go_on:
                self._try_hypotheses(Straight(self.options.knots), only_best=True)  # seldom enough
            return
        # a search finds no shorter path for the next attempt than the one before
        closely = tight_paths.is_tight(self.scenario, guess)
        if self._try(guess, closely=closely).is_refused:
            return
        if isinstance(self.horizon, MinimumTime) and isinstance(source, HybridAStar):
            self._try_other_searches()
        if not self.is_verified and self._may_go_on:
            self._try(replace(guess, seconds=0.0), closely=not closely)

    def _try_other_searches(self) -> None:
        """Searches by time with finer moves from the beginning: other paths to optimise."""
        for first in (1, 2):
            if not self._may_go_on:
                return
            search = HybridAStar(self.options.knots, HybridAStarOptions(costs=QUICK), first)
            found = self._first(search)
            if isinstance(found, Guess):
                self._try(found)

    def _try_hypotheses(self, source: GuessSource, only_best: bool) -> None:
        """The hypotheses that SQP steps converge from, in turn.

        Args:
            source: of hypotheses.
            only_best: whether only the first of them is solved, since there is a surer next attempt than another one.
                Otherwise all are, and the most promising hypothesis as it is where none leads to a plan.
        """
        if isinstance(self.horizon, Fixed):  # SQP steps were not made for a duration that is not the hypothesis's
            self._try(self._first(source))
            return
        begin, limits = time.monotonic(), (MOST_SQP_STEPS, LEAST_PROBABILITY) if only_best else ()
        for guess, steps in screened(self.scenario, source, self.budget, self.options, *limits):
            self._try(guess, steps)
            if only_best or self._is_done:
                return
        if only_best:
            reason = self.budget.ended_before("a hypothesis was chosen") if self.budget.ended else NONE_CONVERGED
            self._try(NoGuess(source.name, reason, time.monotonic() - begin))
        elif self._may_go_on:
            self._try(self._first(source))

    def _first(self, source: GuessSource) -> Guess | NoGuess:
        return next(source.guesses(self.scenario, self.budget), NoGuess(source.name, NO_GUESSES))


def screened(
    scenario: Scenario,
    source: GuessSource,
    budget: Budget,
    options: PlanOptions,
    most_steps: float = math.inf,
    least_probability: float = 0.0,
) -> Iterator[tuple[Guess, SqpSteps]]:
    """The hypotheses that SQP steps converge from, in the order given, each looked for when it is asked for.

    Hypotheses are cheap, and SQP steps cost a tenth of a second. On validation maps, steps that had converged led to a
    verified plan practically always and within a few iterations of Ipopt, and steps that had not mostly to none.

    Args:
        scenario: the task, near the origin.
        source: of hypotheses, the most promising first.
        budget: when it is over, no hypothesis is looked at.
        options: see `PlanOptions`.
        most_steps: SQP steps in all, after which no further hypothesis is looked at.
        least_probability: of a hypothesis that is looked at, where one is predicted.

    Yields:
        The hypothesis, with the time spent since the last one, and where the steps led.
    """
    begin, taken = time.monotonic(), 0
    for guess in source.guesses(scenario, budget):
        if not options.sqp or isinstance(guess, NoGuess) or taken >= most_steps or budget.is_over:
            break
        if guess.probability is not None and guess.probability < least_probability:
            continue
        formulation = formulate(scenario.exact, guess.trajectory, options.cost, options.margin)
        steps = sqp_steps(formulation, LEARNED, budget)
        taken += steps.steps
        if steps.converged:
            yield replace(guess, seconds=time.monotonic() - begin - steps.seconds), steps
            begin = time.monotonic()
