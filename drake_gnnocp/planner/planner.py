"""The planner: guess, optimise, verify; and the next strategy where that gives no verified plan."""

from __future__ import annotations

import logging
import time
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any

from drake_gnnocp.guesses.sources import check_available, straight_guess
from drake_gnnocp.ocp.refine import TOO_LATE, Optimised, RefineOptions, badness, optimise
from drake_gnnocp.planner.many_shifts import fine_guess, fine_refine
from drake_gnnocp.planner.minimum_time import QUICKER, polished, worth_polishing
from drake_gnnocp.planner.result import Attempt, Plan
from drake_gnnocp.planner.schedule import Horizon, PlanOptions, Strategy, strategies
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.timing.minimum_effort import gently_timed, with_duration
from drake_gnnocp.trajectory import Trajectory

logger = logging.getLogger(__name__)

LONGEST = 1000.0  # s, longest duration that is planned: the verification looks at every 10 ms of it
LEAST_SECONDS = 5.0  # s, given to an attempt before any is kept for the next one
ROUNDING = 1e-9  # relative, of the length of a path
MOST_QUICKER = 4  # solves that follow a verified plan with a free horizon


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
        guess: source of the first guess, one of `drake_gnnocp.guesses.sources.GUESSES`; "auto" is the best there is.
        horizon: t_final [s], or "guess" to take it from the guess, or "free" to optimise it with a weight on time
            along several paths.
        max_seconds: wall-clock budget [s]; when it ends, the best attempt so far is returned. Loading the network,
            at a process's first plan with it, is not part of it.
        options: see `PlanOptions`.

    Raises:
        ValueError: guess, horizon or max_seconds is not one of the above.
    """
    options = options or PlanOptions()
    check_available(guess, options.guess)
    check_horizon(horizon)
    if not max_seconds > 0:
        raise ValueError(f"max_seconds: must be positive, not {max_seconds!r}")
    begin = time.monotonic()
    x0, y0, _ = scenario.start  # work near the origin, see Scenario.translated
    local = scenario.translated(-x0, -y0)
    tried = _try_all(local, guess, horizon, options, begin + max_seconds)
    if horizon == "free":
        tried = _all_polished(local, tried, options, begin + max_seconds)
    best = _best(tried, horizon)
    if best.start is None:  # nothing was found in time: the least there is to show
        shown = straight_guess(local, options.guess).trajectory
        best = replace(best, start=shown, attempt=replace(best.attempt, guess="straight"))
    return _result(scenario, best, tried, time.monotonic() - begin)


def check_horizon(horizon: Horizon) -> None:
    """Raise ValueError unless the horizon is "guess", "free" or a duration in (0, LONGEST] [s]."""
    is_duration = isinstance(horizon, int | float) and not isinstance(horizon, bool)
    if horizon not in ("guess", "free") and not (is_duration and 0 < float(horizon) <= LONGEST):
        raise ValueError(f"horizon: must be 'guess', 'free' or 0 to {LONGEST:g} seconds, not {horizon!r}")


@dataclass(frozen=True)
class _Tried:
    """An attempt with what it leaves behind, near the origin."""

    attempt: Attempt
    start: Trajectory | None  # the guess the solver started from, or would have
    outcome: Optimised | None = None  # None where nothing was solved


def _try_all(scenario: Scenario, guess: str, horizon: Horizon, options: PlanOptions, deadline: float) -> list[_Tried]:
    """Try one strategy after the other until a plan is verified, and no better is looked for, or the time is over."""
    tried: list[_Tried] = []
    for strategy in islice(strategies(scenario, guess, horizon, options, deadline), options.most_attempts):
        verified = any(each.attempt.verified for each in tried)
        if tried and time.monotonic() >= deadline - options.refine.reserve:
            break
        if verified and not strategy.improves:
            continue
        tried.append(_try(scenario, strategy, horizon, options, deadline))
        attempt = tried[-1].attempt
        logger.info("%s: %s", attempt.guess, attempt.reason or "verified")
        refused = tried[-1].start is not None and tried[-1].outcome is None
        # a search finds no shorter path for the next attempt than the one before, but perhaps than the network
        if (refused and strategy.source != "gnn") or (attempt.verified and horizon != "free"):
            break
    return tried


def _try(scenario: Scenario, strategy: Strategy, horizon: Horizon, options: PlanOptions, deadline: float) -> _Tried:
    begin = time.monotonic() - strategy.guess_seconds
    start = strategy.guess.trajectory
    if start is None:
        return _Tried(_unsolved(strategy, time.monotonic() - begin, strategy.guess.reason), None)
    duration = start.duration * strategy.slack if isinstance(horizon, str) else float(horizon)
    reason = _refusal(start, duration, scenario)
    if reason:
        return _Tried(_unsolved(strategy, time.monotonic() - begin, reason), start)
    start = _timed(scenario, strategy, horizon, options, duration)
    now = time.monotonic()
    left = deadline - now
    seconds = max(strategy.share * left, min(left, LEAST_SECONDS))
    outcome = _optimised(scenario, start, strategy, horizon, options, now + seconds)
    if not outcome.rounds:
        return _Tried(_unsolved(strategy, now - begin, outcome.reason or TOO_LATE), start)
    return _Tried(_solved(strategy, now - begin, outcome), start, outcome)


def _timed(
    scenario: Scenario, strategy: Strategy, horizon: Horizon, options: PlanOptions, duration: float
) -> Trajectory:
    """The strategy's guess with the knots and the timing the optimiser starts from."""
    start, path = strategy.guess.trajectory, strategy.guess.path
    assert start is not None
    if strategy.fine and path is not None:
        start = fine_guess(path, scenario.vehicle, start, strategy.slack, options.guess.speed, options.fine)
        return start if isinstance(horizon, str) else with_duration(start, duration)
    if horizon == "free" or strategy.timed:  # plans end near the limits, where the speed planner's timing already is
        return with_duration(start, duration)
    return gently_timed(start, duration, scenario.vehicle)


def _optimised(
    scenario: Scenario, start: Trajectory, strategy: Strategy, horizon: Horizon, options: PlanOptions, deadline: float
) -> Optimised:
    free = _free(options)
    if strategy.fine:
        refine = fine_refine(scenario, start, options.refine, options.fine)  # stays near, which a free horizon cannot
    else:  # convex steps are for a duration: that comes first, and a quicker one after it
        refine = free if horizon == "free" and strategy.stepped is None else options.refine
    outcome = optimise(scenario, start, refine, deadline, strategy.stepped)
    return _quicker(scenario, outcome, free, deadline) if horizon == "free" else outcome


def _free(options: PlanOptions) -> RefineOptions:
    return replace(options.refine, problem=replace(options.refine.problem, free_horizon=True))


def _quicker(scenario: Scenario, outcome: Optimised, free: RefineOptions, deadline: float) -> Optimised:
    """Solve a verified plan with a free horizon, again while that makes it quicker: the rows follow the knots."""
    for _ in range(MOST_QUICKER):
        if not outcome.verification.verified or time.monotonic() >= deadline - free.reserve:
            break
        again = optimise(scenario, outcome.trajectory, free, deadline)
        better = again.trajectory.duration < QUICKER * outcome.trajectory.duration
        kept = again if better and again.verification.verified else outcome
        outcome = replace(kept, rounds=outcome.rounds + again.rounds)
        if kept is not again:
            break
    return outcome


def _all_polished(scenario: Scenario, tried: list[_Tried], options: PlanOptions, deadline: float) -> list[_Tried]:
    """The attempts, the quickest of their plans polished as long as there is time."""
    plans = [(i, each.outcome) for i, each in enumerate(tried) if each.outcome and each.attempt.verified]
    result = list(tried)
    for which in worth_polishing([plan.trajectory.duration for _, plan in plans], options.polish):
        i, before = plans[which]
        now = time.monotonic()
        until = now + options.polish.share * (deadline - now)
        outcome = polished(scenario, before, _free(options), until, options.polish)
        attempt = tried[i].attempt
        result[i] = replace(tried[i], attempt=replace(attempt, **_work(outcome), cost=outcome.cost.J), outcome=outcome)
        logger.info("%s: from %.2f s to %.2f s", attempt.guess, before.trajectory.duration, outcome.trajectory.duration)
    return result


def _refusal(guess: Trajectory, duration: float, scenario: Scenario) -> str:
    """Why a guess cannot be driven in a duration [s], or an empty text."""
    if duration > LONGEST:
        return f"the guess takes {duration:.0f} s, more than the {LONGEST:g} s that are planned"
    length = guess.path_length
    reach = scenario.vehicle.v_max * duration
    if length > reach * (1 + ROUNDING):
        return f"the guess's path is {length:.1f} m long, and {duration:g} s at v_max are {reach:.1f} m"
    return ""


def _unsolved(strategy: Strategy, guess_seconds: float, reason: str) -> Attempt:
    return Attempt(strategy.source, guess_seconds, 0.0, 0.0, 0, 0, 0, 0, "", None, False, reason)


def _solved(strategy: Strategy, guess_seconds: float, outcome: Optimised) -> Attempt:
    return Attempt(
        guess=strategy.source,
        guess_seconds=guess_seconds,
        convex_steps=outcome.rounds[0].convex_steps,
        first_iterations=outcome.rounds[0].iterations,
        cost=outcome.cost.J,
        verified=outcome.verification.verified,
        reason=outcome.reason,
        **_work(outcome),
    )


def _work(outcome: Optimised) -> dict[str, Any]:
    """The fields of an attempt that all its solves add to."""
    rounds = outcome.rounds
    return {
        "build_seconds": sum(r.build_seconds for r in rounds),
        "solve_seconds": sum(r.solve_seconds for r in rounds),
        "iterations": sum(r.iterations for r in rounds),
        "refinements": len(rounds) - 1,
        "solver_status": rounds[-1].status,
    }


def _best(tried: list[_Tried], horizon: Horizon) -> _Tried:
    """The best of what was solved (the quickest, where the horizon is free), else the last that has a guess."""
    solved = [each for each in tried if each.outcome is not None]
    verified = [each for each in solved if each.attempt.verified]
    if horizon == "free" and verified:
        return min(verified, key=lambda each: each.outcome.trajectory.duration if each.outcome else 0.0)
    if solved:
        return min(solved, key=lambda each: badness(each.outcome.verification) if each.outcome else (0, 0.0, 0.0))
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
