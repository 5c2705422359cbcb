"""All that is tried for one goal, and which of the attempts is reported."""

from __future__ import annotations

from drake_gnnocp.guesses import GuessSource
from drake_gnnocp.planner import minimum_time
from drake_gnnocp.planner.attempt import Attempt, polished
from drake_gnnocp.planner.horizon import Horizon, MinimumTime
from drake_gnnocp.planner.options import SOURCES
from drake_gnnocp.planner.schedule import Schedule
from drake_gnnocp.search.reachability import no_passage, no_path


def attempts_of(schedule: Schedule, source: GuessSource | None) -> list[Attempt]:
    """All that is tried with one source, or in the usual order where that is None, and proofs that there is no path."""
    if schedule.refuse(no_passage):
        return schedule.attempts
    if source is None:
        schedule.automatic()
    else:
        schedule.try_source(source)
    attempts = all_polished(schedule) if isinstance(schedule.horizon, MinimumTime) else schedule.attempts
    return settled(schedule, attempts, source)


def settled(schedule: Schedule, attempts: list[Attempt], source: GuessSource | None) -> list[Attempt]:
    """Attempts, and where they led to no plan, one among the exact obstacles and a proof that there is no path.

    Args:
        schedule: that made them.
        attempts: polished or not.
        source: of guesses; None for the usual ones.
    """
    is_settled = any(made.verified or (made.no_path and made.no_path.proven) for made in attempts)
    if not is_settled and (exact := schedule.scenario.without_covers) is not None:
        again = Schedule(exact, schedule.horizon, schedule.budget, schedule.options, schedule.goal)
        again.try_source(source or SOURCES["hybrid_astar"](schedule.options))
        attempts = [made for made in attempts if made.no_path is None] + again.attempts
    if not any(made.verified or made.no_path for made in attempts):
        n = len(schedule.attempts)
        schedule.refuse(no_path)
        attempts = attempts + schedule.attempts[n:]
    return attempts


def all_polished(schedule: Schedule) -> list[Attempt]:
    """The attempts, the quickest of their plans polished as long as there is time."""
    attempts = list(schedule.attempts)
    verified = [i for i, made in enumerate(attempts) if made.verified]
    for which in minimum_time.worth_polishing([duration_of(attempts[i]) for i in verified]):
        i = verified[which]
        attempts[i] = polished(schedule.scenario, attempts[i], schedule.budget, schedule.options)
    return attempts


def duration_of(made: Attempt) -> float:
    """Of the plan of an attempt [s], infinite where there is none."""
    return made.trajectory.duration if made.trajectory is not None else float("inf")


def reported(attempts: list[Attempt], horizon: Horizon) -> int:
    """Index of the best of what was solved (the quickest, where time is minimised), else the last that has a guess.

    Where none is verified and there is no path, it is the attempt that says so.
    """
    solved = [i for i, made in enumerate(attempts) if made.best is not None]
    verified = [i for i in solved if attempts[i].verified]
    if verified and isinstance(horizon, MinimumTime):
        return min(verified, key=lambda i: duration_of(attempts[i]))
    without_path = [i for i, made in enumerate(attempts) if made.no_path is not None]
    if without_path and not verified:
        return without_path[-1]
    if solved:
        return min(solved, key=lambda i: attempts[i].solves[attempts[i].best or 0].merit)
    return max(i for i, made in enumerate(attempts) if made.start is not None)
