"""The planner: guess, optimise, verify; and the next attempt where that gives no verified plan."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from numbers import Real
from pathlib import Path
from reprlib import repr as shown
from threading import RLock

import numpy as np

from drake_gnnocp.budget import Budget
from drake_gnnocp.ends import nearest_target
from drake_gnnocp.guesses import Given, GuessSource
from drake_gnnocp.guesses.base import check_numbers
from drake_gnnocp.guesses.straight import straight_line
from drake_gnnocp.planner.attempt import Attempt, at_rest
from drake_gnnocp.planner.goals import Goals, has_choice
from drake_gnnocp.planner.horizon import Fixed, Horizon, horizon_of
from drake_gnnocp.planner.one_goal import attempts_of, reported
from drake_gnnocp.planner.options import PlanOptions, source_named
from drake_gnnocp.planner.result import Plan
from drake_gnnocp.planner.schedule import Schedule
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.trajectory import Trajectory

SAME_POSE = 1e-3  # m and rad: start and goal that differ by less are the same
STANDING = 0.1  # s, a plan of no way
OBJECTS = 100_000  # that are new before Python's garbage collection looks at them, if that is on
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
    max_seconds: float | Budget = 60.0,
    options: PlanOptions | None = None,
    clearance: float | None = None,
) -> Plan:
    """Plan a trajectory and verify it.

    Args:
        scenario: the task, or what `Scenario.load` reads one from: the name of a bundled one or a file.
        guess: where the first guess comes from: "auto" for the best there is, the name of a source ("gnn",
            "hybrid_astar", "rrt_star", "straight"), a source of your own, or a trajectory in the scenario's frame.
        horizon: t_final [s], or "guess" to take it from the guess, or "free" to minimise it with a weight on time along
            several paths; or the same as `FromGuess`, `Fixed` or `MinimumTime`.
        max_seconds: wall-clock budget [s], reading the scenario included; or one that has begun. When it ends, the best
            attempt so far is returned. Loading the network, at a process's first plan with it, is not part of it, nor
            is waiting for the plans of other threads: they are made one after the other.
        options: see `PlanOptions`.
        clearance: kept at all times [m], by the rule of `Scenario`; None: what the scenario asks for.

    Raises:
        ValueError: scenario, guess, horizon, clearance or max_seconds is not one of the above, before anything is
            planned; or a source of your own makes a guess that is not one (see `Guess`).
        PlanInterrupted: Ctrl-C was pressed; it has the best plan so far.
    """
    budget, options, horizon = budget_of(max_seconds), options or PlanOptions(), horizon_of(horizon)
    if not isinstance(options, PlanOptions):
        raise ValueError(f"options: must be PlanOptions, not {shown(options)}")
    if isinstance(scenario, str | Path):
        scenario = Scenario.load(scenario)
    if not isinstance(scenario, Scenario):
        raise ValueError(f"scenario: must be a Scenario, a bundled name or a file, not {shown(scenario)}")
    if clearance is not None:
        scenario = replace(scenario, clearance=clearance)
    with budget.standing_still():
        source = _source(scenario, guess, options)
        ONE_AT_A_TIME.acquire()
    try:
        with _fewer_collections():
            return _planned(scenario, source, horizon, budget, options)
    finally:
        ONE_AT_A_TIME.release()


@contextmanager
def _fewer_collections() -> Iterator[None]:
    """Meanwhile Python looks less often for unreachable cycles among all that is loaded: 8 % of the time."""
    before = gc.get_threshold()
    gc.set_threshold(max(before[0], OBJECTS) if before[0] else 0, *before[1:])
    try:
        yield
    finally:
        gc.set_threshold(*before)


def budget_of(value: float | Budget) -> Budget:
    """The budget that a user means: one as it is, or so many seconds from now on.

    Raises:
        ValueError: it is none of these.
    """
    if isinstance(value, Budget):
        return value
    if not isinstance(value, Real) or isinstance(value, bool) or not value > 0:
        raise ValueError(f"max_seconds: must be positive, not {value!r}")
    return Budget.of(float(value))


def _planned(
    scenario: Scenario, source: GuessSource | None, horizon: Horizon, budget: Budget, options: PlanOptions
) -> Plan:
    if (reached := _goal_at_start(scenario)) is not None:
        seconds = horizon.seconds if isinstance(horizon, Fixed) else STANDING
        standing = replace(at_rest(scenario, seconds, options), goal=reached)
        return Plan(scenario, (standing,), 0, budget.spent)
    schedule = Schedule(scenario.as_planned, horizon, budget, options)
    several = Goals(scenario, source, horizon, budget, options) if has_choice(scenario) else None
    try:
        attempts = attempts_of(schedule, source) if several is None else several.plan()
    except KeyboardInterrupt:
        begun = schedule.attempts if several is None else several.attempts
        solved = [made for made in begun if made.best is not None]
        raise PlanInterrupted(_plan(scenario, schedule, solved, several) if solved else None) from None
    except SystemExit as stop:  # Drake's way to refuse numbers that are not finite
        raise RuntimeError(f"Drake: {stop}") from stop
    return _plan(scenario, schedule, attempts, several)


def _goal_at_start(scenario: Scenario) -> int | None:
    """Index of a goal at which the car is already; None where there is none."""
    beyond = [float(np.abs(target.excess(scenario.start)).max()) for target in scenario.targets]
    return next((i for i, most in enumerate(beyond) if most <= SAME_POSE), None)


def _plan(scenario: Scenario, schedule: Schedule, attempts: list[Attempt], several: Goals | None) -> Plan:
    """The plan that attempts near the origin led to, where the scenario is."""
    if all(made.start is None and made.no_path is None for made in attempts):  # the least there is to show
        line = straight_line(schedule.scenario, schedule.options.knots)
        goal, reason = (
            nearest_target(scenario.targets, scenario.goal),
            "not solved: shown since there is no other guess",
        )
        attempts.append(Attempt("straight", 0.0, line, reason=reason, goal=goal))
    best = reported(attempts, schedule.horizon) if several is None else several.reported(attempts)
    x0, y0, _ = scenario.start
    moved = tuple(made.placed(float(x0), float(y0), schedule.scenario.unit) for made in attempts)
    return Plan(scenario, moved, best, schedule.budget.spent, schedule.budget.ended)


def _source(scenario: Scenario, guess: str | GuessSource | Trajectory, options: PlanOptions) -> GuessSource | None:
    """The source of guesses that is meant, ready for use and near the origin; None for "auto"."""
    if isinstance(guess, str):
        return source_named(guess, options)
    if isinstance(guess, Trajectory):
        check_numbers(guess)
        x0, y0, _ = scenario.start
        local = guess.translated(-x0, -y0).scaled(1 / scenario.in_car_lengths.unit)
        return Given(local.resampled(max(len(guess), options.knots)))
    if not hasattr(guess, "guesses"):
        raise ValueError(f"guess: must be a name, a source or a trajectory, not {shown(guess)}")
    guess.check_available()
    return guess
