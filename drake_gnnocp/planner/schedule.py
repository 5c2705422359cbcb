"""What the planner tries, in order: where each guess comes from, and how it is given to the optimiser."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import chain, islice

from drake_gnnocp.guesses.sources import (
    Guess,
    GuessOptions,
    gnn_guesses,
    has_network,
    hybrid_astar_guess,
    rrt_star_guess,
    straight_guess,
)
from drake_gnnocp.ocp.convex_step import ConvexSteps
from drake_gnnocp.ocp.refine import RefineOptions
from drake_gnnocp.planner.hypotheses import settled_hypotheses
from drake_gnnocp.planner.many_shifts import FineOptions
from drake_gnnocp.planner.minimum_time import PolishOptions
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.search.hybrid_astar import SCHEDULE, HybridAStarOptions
from drake_gnnocp.search.moves import Costs
from drake_gnnocp.search.path import n_sections

Horizon = float | str  # seconds, "guess" or "free"
SEARCH_SHARE = 0.7  # of the budget, at most, for Hybrid A* or RRT*
CHOOSING = 2.0  # s, for choosing a hypothesis before any time is kept for Hybrid A*: half of what is left, at most
# where time is what counts, reversing and turning cost nothing, but a car that stops, turns its wheels and drives off
# again could have gone 5 m
QUICK = Costs(reverse=0.0, steering=0.0, gear_change=5.0, steering_change=0.2)


def other_searches() -> tuple[HybridAStarOptions, ...]:
    """Searches by time with finer moves from the beginning: other paths to optimise where the horizon is free."""
    return tuple(HybridAStarOptions(costs=QUICK, schedule=SCHEDULE[first:]) for first in (1, 2))


@dataclass(frozen=True)
class PlanOptions:
    """How to plan."""

    guess: GuessOptions = field(default_factory=GuessOptions)
    refine: RefineOptions = field(default_factory=RefineOptions)
    slack: float = 1.1  # duration given to the optimiser over the guess's, with the horizon "guess"
    retry_slack: float = 1.6  # the same where the first attempts gave no verified plan
    fine: FineOptions = field(default_factory=FineOptions)
    hypotheses: int = 12  # of the network, the best by its ranking: those whose convex steps settle are solved
    learned_share: float = 0.1  # of the time, for the solve of each; with "auto" for choosing among them as well
    other_searches: tuple[HybridAStarOptions, ...] = field(default_factory=other_searches)  # with the horizon "free"
    most_attempts: int | None = None  # strategies that are tried; None: all there are
    polish: PolishOptions = field(default_factory=PolishOptions)  # with the horizon "free"


@dataclass(frozen=True)
class Strategy:
    """One way to try."""

    source: str  # of the guess
    guess: Guess
    guess_seconds: float  # s, to make it; 0 where an earlier strategy had it made
    slack: float  # duration given to the optimiser over the guess's
    share: float = 1.0  # of the time that is left, to be used at most
    fine: bool = False  # whether to plan finely, see `plan.fine`
    timed: bool = False  # whether the guess has the timing of an optimum already
    stepped: ConvexSteps | None = None  # what convex steps made of the guess, where they were taken to choose it
    improves: bool = False  # whether to try it although there is a verified plan: it may be quicker


def strategies(
    scenario: Scenario, guess: str, horizon: Horizon, options: PlanOptions, deadline: float
) -> Iterator[Strategy]:
    """The strategies in turn, each with its guess made when its turn comes.

    Args:
        scenario: the task, near the origin.
        guess: source of the first guess.
        horizon: see `planner.plan`.
        options: see `PlanOptions`.
        deadline: instant of `time.monotonic()` [s].
    """
    if guess == "straight":
        yield Strategy("straight", straight_guess(scenario, options.guess), 0.0, options.slack)
        return
    if guess == "gnn" or (guess == "auto" and has_network(options.guess)):
        yield from _learned(scenario, guess, horizon, options, deadline)
    if guess == "gnn":
        return
    if guess == "rrt_star":
        first = _sampled(scenario, options, deadline)
    else:
        first = _searched(scenario, options, options.guess.search, deadline)
    if first.guess.path is None:
        yield first
        if guess == "rrt_star":
            return
        straight = straight_guess(scenario, options.guess)  # seldom enough, but an attempt to look at
        yield Strategy("straight", straight, 0.0, options.slack, share=0.5)
        return
    again = replace(first, guess_seconds=0.0)
    yield replace(first, share=0.4, improves=horizon == "free")
    for search in options.other_searches if horizon == "free" and guess != "rrt_star" else ():
        found = _searched(scenario, options, search, deadline)
        if found.guess.path is not None:
            yield replace(found, share=0.5, improves=True)
    if not first.fine:
        yield replace(again, share=0.6, fine=True)
    if isinstance(horizon, str):  # to a fixed one the slack makes no difference
        yield replace(again, slack=options.retry_slack)


def _learned(
    scenario: Scenario, guess: str, horizon: Horizon, options: PlanOptions, deadline: float
) -> Iterator[Strategy]:
    """The network's hypotheses that are worth a solve; the first takes the time of making all.

    With a duration that is not theirs it is the first: convex steps were not made for it.
    """
    begin = time.monotonic()
    made = gnn_guesses(scenario, options.guess)
    best = next(made)
    improves = guess == "gnn" and horizon == "free"
    first = Strategy("gnn", Guess(best), 0.0, 1.0, options.learned_share, timed=True, improves=improves)
    if isinstance(horizon, str):
        spent = time.monotonic() - begin
        left = deadline - begin
        kept = max(options.learned_share * left, min(CHOOSING, left / 2))
        until = begin + kept if guess == "auto" else deadline
        hypotheses = islice(chain([best], made), options.hypotheses)
        for candidate in settled_hypotheses(scenario, hypotheses, options.refine, until):
            seconds, spent = spent + candidate.seconds, 0.0
            yield replace(first, guess=Guess(candidate.guess), guess_seconds=seconds, stepped=candidate.stepped)
            if guess == "auto":  # Hybrid A* is the surer second attempt
                return
            begin = time.monotonic()
        seconds = time.monotonic() - begin
        if guess == "auto":
            reason = "convex steps settled from no hypothesis"
            yield replace(first, guess=Guess(None, reason), guess_seconds=seconds)
            return
        first = replace(first, guess_seconds=seconds)
    else:
        share = options.learned_share if guess == "auto" else 1.0
        first = replace(first, guess_seconds=time.monotonic() - begin, share=share)
    yield first


def _sampled(scenario: Scenario, options: PlanOptions, deadline: float) -> Strategy:
    begin = time.monotonic()
    guess = rrt_star_guess(scenario, options.guess, begin + SEARCH_SHARE * (deadline - begin))
    return Strategy("rrt_star", guess, time.monotonic() - begin, options.slack)


def _searched(scenario: Scenario, options: PlanOptions, search: HybridAStarOptions, deadline: float) -> Strategy:
    begin = time.monotonic()
    until = begin + SEARCH_SHARE * (deadline - begin)
    guess = hybrid_astar_guess(scenario, replace(options.guess, search=search), until)
    fine = guess.path is not None and n_sections(guess.path) >= options.fine.sections
    return Strategy("hybrid_astar", guess, time.monotonic() - begin, options.slack, fine=fine)
