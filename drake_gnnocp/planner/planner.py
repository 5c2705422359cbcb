"""The planner: guess, optimise, verify; and the next attempt where that gives no verified plan."""

from __future__ import annotations

import time
from numbers import Real
from pathlib import Path
from reprlib import repr as shown
from threading import RLock

from drake_gnnocp.budget import Budget
from drake_gnnocp.guesses import Given, GuessSource
from drake_gnnocp.guesses.base import check_numbers
from drake_gnnocp.guesses.straight import straight_line
from drake_gnnocp.planner import minimum_time
from drake_gnnocp.planner.attempt import Attempt, polished
from drake_gnnocp.planner.horizon import Horizon, MinimumTime, horizon_of
from drake_gnnocp.planner.options import PlanOptions, source_named
from drake_gnnocp.planner.result import Plan
from drake_gnnocp.planner.schedule import Schedule
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.trajectory import Trajectory

# Drake's conversions of arguments are not thread-safe: a thread that finds another one inside of them gets a TypeError
ONE_AT_A_TIME = RLock()  # reentrant: a source of guesses may plan itself


class PlanInterrupted(KeyboardInterrupt):
    """Ctrl-C while planning."""

    def __init__(self, plan: Plan | None) -> None:
        super().__init__()
        self.plan = plan  # the best of the attempts that had ended; None where nothing was solved


def plan(
    scenario: Scenario | str | Path,
    guess: str | GuessSource | Trajectory = "auto",
    horizon: Horizon | float | str = "guess",
    max_seconds: float = 60.0,
    options: PlanOptions | None = None,
) -> Plan:
    """Plan a trajectory and verify it.

    Args:
        scenario: the task, or what `Scenario.load` reads one from: the name of a bundled one or a file.
        guess: where the first guess comes from: "auto" for the best there is, the name of a source ("gnn",
            "hybrid_astar", "rrt_star", "straight"), a source of your own, or a trajectory in the scenario's frame.
        horizon: t_final [s], or "guess" to take it from the guess, or "free" to minimise it with a weight on time along
            several paths; or the same as `FromGuess`, `Fixed` or `MinimumTime`.
        max_seconds: wall-clock budget [s]; when it ends, the best attempt so far is returned. Loading the network,
            at a process's first plan with it, is not part of it, nor is waiting for the plans of other threads: they
            are made one after the other.
        options: see `PlanOptions`.

    Raises:
        ValueError: scenario, guess, horizon or max_seconds is not one of the above, before anything is planned; or a
            source of your own makes a guess that is not one (see `Guess`).
        PlanInterrupted: Ctrl-C was pressed; it has the best plan so far.
    """
    options, horizon = options or PlanOptions(), horizon_of(horizon)
    if not isinstance(options, PlanOptions):
        raise ValueError(f"options: must be PlanOptions, not {shown(options)}")
    if isinstance(scenario, str | Path):
        scenario = Scenario.load(scenario)
    if not isinstance(scenario, Scenario):
        raise ValueError(f"scenario: must be a Scenario, a bundled name or a file, not {shown(scenario)}")
    source = _source(scenario, guess, options)
    if not isinstance(max_seconds, Real) or not max_seconds > 0:
        raise ValueError(f"max_seconds: must be positive, not {max_seconds!r}")
    with ONE_AT_A_TIME:
        begin = time.monotonic()
        x0, y0, _ = scenario.start  # work near the origin, see Scenario.translated
        schedule = Schedule(scenario.translated(-x0, -y0), horizon, Budget.of(max_seconds), options)
        try:
            attempts = _attempts(schedule, source)
        except KeyboardInterrupt:
            solved = [made for made in schedule.attempts if made.best is not None]
            raise PlanInterrupted(_plan(scenario, schedule, solved, begin) if solved else None) from None
        except SystemExit as stop:  # Drake's way to refuse numbers that are not finite
            raise RuntimeError(f"Drake: {stop}") from stop
        return _plan(scenario, schedule, attempts, begin)


def _attempts(schedule: Schedule, source: GuessSource | None) -> list[Attempt]:
    """All that is tried with one source, or in the usual order."""
    if source is None:
        schedule.automatic()
    else:
        schedule.try_source(source)
    return _all_polished(schedule) if isinstance(schedule.horizon, MinimumTime) else schedule.attempts


def _plan(scenario: Scenario, schedule: Schedule, attempts: list[Attempt], begin: float) -> Plan:
    """The plan that attempts near the origin led to, where the scenario is."""
    if all(made.start is None for made in attempts):  # nothing was found: the least there is to show
        line = straight_line(schedule.scenario, schedule.options.knots)
        attempts.append(Attempt("straight", 0.0, line, reason="not solved: shown since there is no other guess"))
    reported = _reported(attempts, schedule.horizon)
    moved = tuple(made.translated(*scenario.start[:2]) for made in attempts)
    return Plan(scenario, moved, reported, time.monotonic() - begin)


def _source(scenario: Scenario, guess: str | GuessSource | Trajectory, options: PlanOptions) -> GuessSource | None:
    """The source of guesses that is meant, ready for use and near the origin; None for "auto"."""
    if isinstance(guess, str):
        return source_named(guess, options)
    if isinstance(guess, Trajectory):
        check_numbers(guess)
        x0, y0, _ = scenario.start
        return Given(guess.translated(-x0, -y0).resampled(max(len(guess), options.knots)))
    if not hasattr(guess, "guesses"):
        raise ValueError(f"guess: must be a name, a source or a trajectory, not {shown(guess)}")
    guess.check_available()
    return guess


def _all_polished(schedule: Schedule) -> list[Attempt]:
    """The attempts, the quickest of their plans polished as long as there is time."""
    attempts = list(schedule.attempts)
    verified = [i for i, made in enumerate(attempts) if made.verified]
    for which in minimum_time.worth_polishing([_duration(attempts[i]) for i in verified]):
        budget = schedule.budget.share(minimum_time.POLISHING_SHARE)
        i = verified[which]
        attempts[i] = polished(schedule.scenario, attempts[i], budget, schedule.options)
    return attempts


def _duration(made: Attempt) -> float:
    return made.trajectory.duration if made.trajectory is not None else float("inf")


def _reported(attempts: list[Attempt], horizon: Horizon) -> int:
    """Index of the best of what was solved (the quickest, where time is minimised), else the last that has a guess."""
    solved = [i for i, made in enumerate(attempts) if made.best is not None]
    verified = [i for i in solved if attempts[i].verified]
    if verified and isinstance(horizon, MinimumTime):
        return min(verified, key=lambda i: _duration(attempts[i]))
    if solved:
        return min(solved, key=lambda i: attempts[i].solves[attempts[i].best or 0].merit)
    return max(i for i, made in enumerate(attempts) if made.start is not None)
