"""The planner: guess, optimise, verify; and the next guess where that gives no verified plan."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from drake_gnnocp.ocp.refine import TOO_LATE, Optimised, RefineOptions, badness, optimise
from drake_gnnocp.plan.guess import (
    Guess,
    GuessOptions,
    GuessUnavailable,
    check_available,
    gnn_guesses,
    hybrid_astar_guess,
    load_network,
    rrt_star_guess,
    straight_guess,
)
from drake_gnnocp.plan.result import Attempt, Plan
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.search.retiming import gently_timed, with_duration
from drake_gnnocp.trajectory import Trajectory

logger = logging.getLogger(__name__)

Horizon = float | str  # seconds, "guess" or "free"
LONGEST = 1000.0  # s, longest duration that is planned: the verification looks at every 10 ms of it
LEAST_SECONDS = 5.0  # s, given to an attempt before any is kept for the next one
SEARCH_SHARE = 0.7  # of the budget, at most, for Hybrid A* or RRT*
ROUNDING = 1e-9  # relative, of the length of a path


@dataclass(frozen=True)
class PlanOptions:
    """How to plan."""

    guess: GuessOptions = field(default_factory=GuessOptions)
    refine: RefineOptions = field(default_factory=RefineOptions)
    slack: float = 1.1  # duration given to the optimiser over the guess's, with the horizon "guess"
    retry_slack: float = 1.6  # the same where the first attempt gave no verified plan
    hypotheses: int = 3  # of the network, tried one after the other with the guess "gnn"
    hypotheses_first: int = 1  # the same with "auto", before Hybrid A* is asked
    learned_share: float = 0.25  # of the time that is left, for each of them at most


def plan(
    scenario: Scenario,
    guess: str = "auto",
    horizon: Horizon = "guess",
    max_seconds: float = 60.0,
    options: PlanOptions | None = None,
) -> Plan:
    """Plan a trajectory and verify it.

    Args:
        scenario: the task.
        guess: source of the first guess, one of `drake_gnnocp.plan.guess.GUESSES`; "auto" is the best there is.
        horizon: t_final [s], or "guess" to take it from the guess, or "free" to optimise it with a weight on time.
        max_seconds: wall-clock budget [s]; when it ends, the best attempt so far is returned.
        options: see `PlanOptions`.

    Raises:
        ValueError: guess, horizon or max_seconds is not one of the above.
    """
    options = _with_horizon(options or PlanOptions(), horizon)
    check_available(guess, options.guess)
    check_horizon(horizon)
    if not max_seconds > 0:
        raise ValueError(f"max_seconds: must be positive, not {max_seconds!r}")
    begin = time.monotonic()
    x0, y0, _ = scenario.start  # work near the origin, see Scenario.translated
    local = scenario.translated(-x0, -y0)
    tried = _try_all(local, guess, horizon, options, begin + max_seconds)
    best = _best(tried)
    if best.start is None:  # nothing was found in time: the least there is to show
        best = replace(best, start=straight_guess(local, options.guess).trajectory)
    return _result(scenario, best, tried, time.monotonic() - begin)


def check_horizon(horizon: Horizon) -> None:
    """Raise ValueError unless the horizon is "guess", "free" or a duration in (0, LONGEST] [s]."""
    is_duration = isinstance(horizon, int | float) and not isinstance(horizon, bool)
    if horizon not in ("guess", "free") and not (is_duration and 0 < float(horizon) <= LONGEST):
        raise ValueError(f"horizon: must be 'guess', 'free' or 0 to {LONGEST:g} seconds, not {horizon!r}")


def _with_horizon(options: PlanOptions, horizon: Horizon) -> PlanOptions:
    if horizon != "free":
        return options
    problem = replace(options.refine.problem, free_horizon=True)
    return replace(options, refine=replace(options.refine, problem=problem))


@dataclass(frozen=True)
class _Tried:
    """An attempt with what it leaves behind, near the origin."""

    attempt: Attempt
    start: Trajectory | None  # the guess the solver started from, or would have
    outcome: Optimised | None = None  # None where nothing was solved


@dataclass(frozen=True)
class _Strategy:
    """One way to try."""

    source: str  # of the guess
    make_guess: Callable[[], Guess]
    slack: float  # duration given to the optimiser over the guess's
    share: float = 1.0  # of the time that is left after the guess, to be used at most
    timed: bool = False  # whether the guess's timing is that of an optimum already


def _try_all(scenario: Scenario, guess: str, horizon: Horizon, options: PlanOptions, deadline: float) -> list[_Tried]:
    """Try one strategy after the other until a plan is verified or the time is over."""
    tried = []
    for strategy in _strategies(scenario, guess, horizon, options, deadline):
        tried.append(_try(scenario, strategy, horizon, options, deadline))
        attempt = tried[-1].attempt
        logger.info("%s: %s", attempt.guess, attempt.reason or "verified")
        if attempt.verified or time.monotonic() >= deadline:
            break
    return tried


def _strategies(
    scenario: Scenario, guess: str, horizon: Horizon, options: PlanOptions, deadline: float
) -> Iterator[_Strategy]:
    straight = _Strategy("straight", lambda: straight_guess(scenario, options.guess), options.slack)
    if guess == "straight":
        yield straight
        return
    if guess == "gnn" or guess == "auto" and _has_network(options):
        yield from _learned_strategies(scenario, guess, options)
    if guess == "gnn":
        return
    now = time.monotonic()
    source, search = ("rrt_star", rrt_star_guess) if guess == "rrt_star" else ("hybrid_astar", hybrid_astar_guess)
    found: list[Guess] = []  # the searches are deterministic: a second attempt takes the path again

    def searched() -> Guess:
        if not found:
            found.append(search(scenario, options.guess, now + SEARCH_SHARE * (deadline - now)))
        return found[0]

    fixed = not isinstance(horizon, str)  # the slack has no effect: a second attempt would be the same solve
    yield _Strategy(source, searched, options.slack, share=1.0 if fixed else 0.5)
    if found[0].trajectory is None:
        if source == "hybrid_astar":
            yield replace(straight, share=0.5)  # seldom enough, but an attempt to look at
    elif not fixed:
        yield _Strategy(source, searched, options.retry_slack)


def _learned_strategies(scenario: Scenario, guess: str, options: PlanOptions) -> Iterator[_Strategy]:
    """The network's best hypotheses, the first of which takes the time of making all."""
    made: list[Guess] = []

    def first() -> Guess:
        made.extend(gnn_guesses(scenario, options.guess))
        return made[0]

    learned = _Strategy("gnn", first, slack=1.0, share=options.learned_share, timed=True)
    yield learned
    tries = options.hypotheses if guess == "gnn" else options.hypotheses_first
    for other in made[1:tries]:
        yield replace(learned, make_guess=partial(_same, other))


def _has_network(options: PlanOptions) -> bool:
    try:
        load_network(options.guess.weights)
    except GuessUnavailable:
        return False
    return True


def _same(guess: Guess) -> Guess:
    return guess


def _try(scenario: Scenario, strategy: _Strategy, horizon: Horizon, options: PlanOptions, deadline: float) -> _Tried:
    begin = time.monotonic()
    made = strategy.make_guess()
    start = made.trajectory
    if start is None:
        return _Tried(_unsolved(strategy, time.monotonic() - begin, made.reason), None)
    duration = start.duration * strategy.slack if isinstance(horizon, str) else float(horizon)
    reason = _refusal(start, duration, scenario)
    if reason:
        return _Tried(_unsolved(strategy, time.monotonic() - begin, reason), start)
    # with a free horizon plans end near the limits, where the speed planner's timing already is
    start = (
        with_duration(start, duration)
        if horizon == "free" or strategy.timed
        else gently_timed(start, duration, scenario.vehicle)
    )
    now = time.monotonic()
    left = deadline - now
    seconds = max(strategy.share * left, min(left, LEAST_SECONDS))
    outcome = optimise(scenario, start, options.refine, now + seconds)
    if not outcome.rounds:
        return _Tried(_unsolved(strategy, now - begin, outcome.reason or TOO_LATE), start)
    return _Tried(_solved(strategy, now - begin, outcome), start, outcome)


def _refusal(guess: Trajectory, duration: float, scenario: Scenario) -> str:
    """Why a guess cannot be driven in a duration [s], or an empty text."""
    if duration > LONGEST:
        return f"the guess takes {duration:.0f} s, more than the {LONGEST:g} s that are planned"
    length = float(np.linalg.norm(np.diff(guess.poses[:, :2], axis=0), axis=1).sum())
    reach = scenario.vehicle.v_max * duration
    if length > reach * (1 + ROUNDING):
        return f"the guess's path is {length:.1f} m long, and {duration:g} s at v_max are {reach:.1f} m"
    return ""


def _unsolved(strategy: _Strategy, guess_seconds: float, reason: str) -> Attempt:
    return Attempt(strategy.source, guess_seconds, 0.0, 0.0, 0, 0, 0, "", None, False, reason)


def _solved(strategy: _Strategy, guess_seconds: float, outcome: Optimised) -> Attempt:
    rounds = outcome.rounds
    return Attempt(
        guess=strategy.source,
        guess_seconds=guess_seconds,
        build_seconds=sum(r.build_seconds for r in rounds),
        solve_seconds=sum(r.solve_seconds for r in rounds),
        iterations=sum(r.iterations for r in rounds),
        first_iterations=rounds[0].iterations,
        refinements=len(rounds) - 1,
        solver_status=rounds[-1].status,
        cost=outcome.cost.J,
        verified=outcome.verification.verified,
        reason=outcome.reason,
    )


def _best(tried: list[_Tried]) -> _Tried:
    """The best of what was solved, else the last that has a guess."""
    solved = [(badness(each.outcome.verification), i) for i, each in enumerate(tried) if each.outcome is not None]
    if solved:
        return tried[min(solved)[1]]
    return next((each for each in reversed(tried) if each.start is not None), tried[0])


def _result(scenario: Scenario, best: _Tried, tried: list[_Tried], seconds: float) -> Plan:
    x0, y0, _ = scenario.start
    outcome = best.outcome
    status = "failed" if outcome is None else "verified" if outcome.verification.verified else "unverified"
    return Plan(
        scenario=scenario,
        status=status,
        guess_source=best.attempt.guess,
        trajectory=None if outcome is None else outcome.trajectory.translated(x0, y0),
        guess=None if best.start is None else best.start.translated(x0, y0),
        verification=None if outcome is None else outcome.verification,
        cost=None if outcome is None else outcome.cost,
        attempts=tuple(each.attempt for each in tried),
        total_seconds=seconds,
    )
