"""The planner: guess, optimise, verify; and the next guess where that gives no verified plan."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

from drake_gnnocp.ocp.refine import Optimised, RefineOptions, optimise
from drake_gnnocp.plan.guess import (
    Guess,
    GuessOptions,
    check_available,
    hybrid_astar_guess,
    straight_guess,
)
from drake_gnnocp.plan.result import Attempt, Plan
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.search.retiming import gently_timed, with_duration
from drake_gnnocp.trajectory import Trajectory

logger = logging.getLogger(__name__)

Horizon = float | str  # seconds, "guess" or "free"
LONGEST = 1000.0  # s, longest duration that is planned: the verification looks at every 10 ms of it


@dataclass(frozen=True)
class PlanOptions:
    """How to plan."""

    guess: GuessOptions = field(default_factory=GuessOptions)
    refine: RefineOptions = field(default_factory=RefineOptions)
    slack: float = 1.1  # duration given to the optimiser over the guess's, with the horizon "guess"
    retry_slack: float = 1.6  # the same where the first attempt gave no verified plan


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
    check_available(guess)
    check_horizon(horizon)
    if not max_seconds > 0:
        raise ValueError(f"max_seconds: must be positive, not {max_seconds!r}")
    begin = time.monotonic()
    deadline = begin + max_seconds
    options = options or PlanOptions()
    if horizon == "free":
        problem = replace(options.refine.problem, free_horizon=True)
        options = replace(options, refine=replace(options.refine, problem=problem))

    x0, y0, _ = scenario.start  # work near the origin, see Scenario.translated
    local = scenario.translated(-x0, -y0)
    attempts: list[Attempt] = []
    best: tuple[str, Trajectory, Optimised] | None = None
    for source, make_guess, slack in _strategies(local, guess, options, deadline):
        attempt, start, outcome = _attempt(local, source, make_guess, slack, horizon, options, deadline)
        attempts.append(attempt)
        logger.info("%s: %s", source, attempt.reason or "verified")
        if start is not None and outcome is not None and (best is None or _is_better(outcome, best[2])):
            best = (source, start, outcome)
        if attempt.verified or time.monotonic() >= deadline:
            break
    seconds = time.monotonic() - begin
    return _result(scenario, guess, best, attempts, seconds)


def check_horizon(horizon: Horizon) -> None:
    """Raise ValueError unless the horizon is "guess", "free" or a duration in (0, LONGEST] [s]."""
    is_duration = isinstance(horizon, int | float) and not isinstance(horizon, bool)
    if horizon not in ("guess", "free") and not (is_duration and 0 < float(horizon) <= LONGEST):
        raise ValueError(f"horizon: must be 'guess', 'free' or 0 to {LONGEST:g} seconds, not {horizon!r}")


def _strategies(
    scenario: Scenario, guess: str, options: PlanOptions, deadline: float
) -> Iterator[tuple[str, Callable[[], Guess], float]]:
    """The attempts in their order: source, how to make the guess, slack of its duration."""
    if guess == "straight":
        yield "straight", lambda: straight_guess(scenario, options.guess), options.slack
        return
    found: list[Guess] = []  # the search is deterministic: a second attempt takes its path again

    def searched() -> Guess:
        if not found:
            found.append(hybrid_astar_guess(scenario, options.guess, deadline))
        return found[0]

    yield "hybrid_astar", searched, options.slack
    if found[0].trajectory is not None:
        yield "hybrid_astar", searched, options.retry_slack


def _attempt(
    scenario: Scenario,
    source: str,
    make_guess: Callable[[], Guess],
    slack: float,
    horizon: Horizon,
    options: PlanOptions,
    deadline: float,
) -> tuple[Attempt, Trajectory | None, Optimised | None]:
    begin = time.monotonic()
    made = make_guess()
    start = made.trajectory
    if start is None:
        seconds = time.monotonic() - begin
        return Attempt(source, seconds, 0.0, 0.0, 0, 0, "", None, False, made.reason), None, None
    duration = float(horizon) if not isinstance(horizon, str) else start.duration * slack
    if duration > LONGEST:
        reason = f"the guess takes {duration:.0f} s, more than the {LONGEST:g} s that are planned"
        return Attempt(source, time.monotonic() - begin, 0.0, 0.0, 0, 0, "", None, False, reason), None, None
    # with a free horizon plans end near the limits, where the speed planner's timing already is
    start = with_duration(start, duration) if horizon == "free" else gently_timed(start, duration, scenario.vehicle)
    guess_seconds = time.monotonic() - begin
    outcome = optimise(scenario, start, options.refine, deadline)
    rounds = outcome.rounds
    attempt = Attempt(
        guess=source,
        guess_seconds=guess_seconds,
        build_seconds=sum(r.build_seconds for r in rounds),
        solve_seconds=sum(r.solve_seconds for r in rounds),
        iterations=sum(r.iterations for r in rounds),
        refinements=max(0, len(rounds) - 1),
        solver_status=rounds[-1].status if rounds else "",
        cost=outcome.cost.J,
        verified=outcome.verification.verified,
        reason=outcome.reason,
    )
    return attempt, start, outcome


def _is_better(first: Optimised, second: Optimised) -> bool:
    def rank(outcome: Optimised) -> tuple[bool, int, int]:
        return not outcome.verification.verified, len(outcome.verification.faults), -len(outcome.rounds)

    return rank(first) < rank(second)


def _result(
    scenario: Scenario,
    guess: str,
    best: tuple[str, Trajectory, Optimised] | None,
    attempts: list[Attempt],
    seconds: float,
) -> Plan:
    if best is None:
        source = attempts[-1].guess if attempts else guess
        return Plan(scenario, "failed", source, None, None, None, None, tuple(attempts), seconds)
    source, start, outcome = best
    x0, y0, _ = scenario.start
    solved = "verified" if outcome.verification.verified else "unverified"
    return Plan(
        scenario=scenario,
        status=solved if outcome.rounds else "failed",
        guess_source=source,
        trajectory=outcome.trajectory.translated(x0, y0),
        guess=start.translated(x0, y0),
        verification=outcome.verification,
        cost=outcome.cost,
        attempts=tuple(attempts),
        total_seconds=seconds,
    )
