"""Several goals, or one whose heading is free: which poses are planned to, in which order, and which plan is taken.

A free heading gives a few poses: the optimiser turns them. All poses are ordered by what the network guesses that their
plans cost: it looks at all of them in one pass. (From such guesses the costs of the plans were 0.75 to 1.2 of what was
guessed, in 30 tasks of which the dearest cost 5 times the cheapest.) Where there is no network, or goals are farther
than it knows, the shorter way comes first.

The first few poses are planned to as if each were the only one. Those with no plan yet get a short search. What has the
best plan is taken: comparing plans is surer than comparing guesses. Only where there is none, the next few are looked
at, and at last the searches go on to their ends, for one goal after the other until there is a plan.
"""

from __future__ import annotations

import logging
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from drake_gnnocp.budget import Budget
from drake_gnnocp.guesses import Given, GuessSource, GuessUnavailable, HybridAStar, Learned
from drake_gnnocp.guesses.learned import load_network
from drake_gnnocp.ocp.costs import evaluate_cost
from drake_gnnocp.planner import minimum_time
from drake_gnnocp.planner.attempt import Attempt, polished
from drake_gnnocp.planner.horizon import Horizon, MinimumTime
from drake_gnnocp.planner.one_goal import duration_of, settled
from drake_gnnocp.planner.options import PlanOptions
from drake_gnnocp.planner.schedule import Schedule
from drake_gnnocp.scenario import Scenario, ScenarioError
from drake_gnnocp.search.reachability import NoPath, no_passage
from drake_gnnocp.search.ways import ways

FEW = 6  # poses that are planned to before it is asked whether there is a plan
OF_A_GOAL, APART = 4, math.radians(40.0)  # of these with one goal, and between their headings: others lead to the same
SEARCHED = 2  # poses of a goal that a short search is for, and goals where time is minimised
STAGES = 3  # of a short search
MOST_LOOKED_AT = 48  # poses that the network looks at, those with the shortest ways
SURELY = 0.9  # of a way: no plan is shorter, though the heuristic counts cells of a grid

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Aim:
    """A pose to plan to."""

    goal: int  # index of the goal
    heading: float  # rad
    way: float = 0.0  # in the unit of planning, see `ways`


@dataclass(eq=False)
class _Tried:
    """What was tried for an aim."""

    schedule: Schedule
    attempts: list[Attempt]  # of the schedule, or what they were replaced by


class Goals:
    """One task with a choice of goals, and the attempts so far."""

    def __init__(
        self, scenario: Scenario, source: GuessSource | None, horizon: Horizon, budget: Budget, options: PlanOptions
    ) -> None:
        self._scenario, self._source = scenario, source
        self._horizon, self._budget, self._options = horizon, budget, options
        x0, y0, _ = scenario.start
        self._origin = -float(x0), -float(y0)
        self._near = scenario.translated(*self._origin).in_car_lengths
        self._tried: dict[Aim, _Tried] = {}
        self._wanted: set[int] = set()  # goals at which the car may stand
        self._minimise = isinstance(horizon, MinimumTime)

    @property
    def attempts(self) -> list[Attempt]:
        """All attempts, goal by goal in the order in which they were begun."""
        return [made for tried in self._tried.values() for made in tried.attempts]

    def plan(self) -> list[Attempt]:
        """Plan to the goals; returns all attempts."""
        found = aims_of(self._scenario)
        self._wanted = {aim.goal for aim in found}
        aims = self._ordered(found)
        first = _well_apart(aims)
        for some in (first, [aim for aim in aims if aim not in set(first)]):
            for k in range(0, len(some), FEW):
                if not (self._is_verified() or (self._tried and self._budget.is_over)):
                    self._try_some(some[k : k + FEW])
        if not self._is_verified():
            self._go_on(aims)
        if self._minimise:
            self._polish()
        return self.attempts

    def _ordered(self, aims: list[Aim]) -> list[Aim]:
        """Aims, the most promising first."""
        if isinstance(self._source, Given):
            return [self._nearest(aims, self._source.trajectory.poses[-1])]
        tasks = [self._near.aimed(aim.goal, aim.heading) for aim in aims]
        lengths = ways(self._near, np.stack([task.goal for task in tasks]), self._budget)
        order = np.argsort(lengths, kind="stable").tolist()
        aims = [replace(aim, way=float(length)) for aim, length in zip(aims, lengths, strict=True)]
        looked_at = [i for i in order[:MOST_LOOKED_AT] if not Learned.is_far(tasks[i])]
        if not self._minimise and (costs := self._guessed_costs([tasks[i] for i in looked_at])):
            by_cost = [i for _, i in sorted(zip(costs, looked_at, strict=True), key=lambda pair: pair[0])]
            order = by_cost + [i for i in order if i not in set(by_cost)]
        return [aims[i] for i in order]

    def _guessed_costs(self, tasks: Sequence[Scenario]) -> list[float]:
        """What the network guesses that plans of tasks cost; empty where it is not to be had or not asked for."""
        if not tasks or not (self._source is None or isinstance(self._source, Learned)):
            return []
        try:
            network = load_network(self._options.weights)
        except GuessUnavailable:  # of which the attempts tell
            return []
        from drake_gnnocp.learning.predict import first_looks

        looks = first_looks(network, self._near, tasks, self._options.knots)
        return [evaluate_cost(look, self._near, self._options.cost).J for look in looks]

    def _nearest(self, aims: Sequence[Aim], end: np.ndarray) -> Aim:
        """The aim that is nearest to a pose (3,), a radian counting as the unit of length."""

        def away(aim: Aim) -> float:
            change = self._near.aimed(aim.goal, aim.heading).goal - end
            return float(np.hypot(*change[:2]) + abs(math.remainder(change[2], 2 * math.pi)))

        return min(aims, key=away)

    def _schedule(self, aim: Aim) -> Schedule:
        """The attempts for an aim, which plan as if it were the only one."""
        if aim not in self._tried:
            alone = self._scenario.aimed(aim.goal, aim.heading).translated(*self._origin).in_car_lengths
            schedule = Schedule(alone, self._horizon, self._budget, self._options, aim.goal)
            self._tried[aim] = _Tried(schedule, schedule.attempts)
        return self._tried[aim].schedule

    def _is_verified(self, goal: int | None = None) -> bool:
        return any(made.verified and goal in (None, made.goal) for made in self.attempts)

    def _is_hopeless(self, aim: Aim) -> bool:
        """Whether an aim needs no plan: there is none, none that could be the best, or no time."""
        if any(made.no_path and made.no_path.proven for made in self.attempts if made.goal == aim.goal):
            return True
        if self._minimise and self._is_verified():
            best = min(duration_of(made) for made in self.attempts if made.verified)
            tolerance = float(np.hypot(*self._near.targets[aim.goal].half_sizes[:2]))
            if SURELY * aim.way - tolerance >= self._near.vehicle.v_max * best:
                return True
        return bool(self._tried) and self._budget.is_over

    def _try_some(self, aims: Sequence[Aim]) -> None:
        """Try what is quick for each of some aims, and short searches where that leads to no plan."""
        for aim in aims:
            if self._is_hopeless(aim):
                continue
            schedule = self._schedule(aim)
            if schedule.refuse(no_passage):
                continue
            if self._source is None:
                schedule.quick()
            elif not isinstance(self._source, HybridAStar):
                schedule.try_source(self._source)
        if self._source is None or isinstance(self._source, HybridAStar):
            self._search_shortly(aims)

    def _search_shortly(self, aims: Sequence[Aim]) -> None:
        """Short searches for aims without a plan; where time is minimised, for those with the quickest plans too.

        Of several headings at a goal, those come first that are next to one with a plan: they can be reached.
        """
        search, searched = replace(self._search, last_stage=STAGES), Counter[int]()
        for aim in sorted(aims, key=self._best_duration if self._minimise else self._turn_from_a_plan):
            has_plan = math.isfinite(self._best_duration(aim))
            is_enough = self._minimise and self._is_verified() and searched.total() >= SEARCHED
            if is_enough or searched[aim.goal] == SEARCHED or self._is_hopeless(aim):
                continue
            if self._minimise or not has_plan:
                searched[aim.goal] += 1
                self._schedule(aim).try_source(search)

    @property
    def _search(self) -> HybridAStar:
        if isinstance(self._source, HybridAStar):
            return self._source
        return HybridAStar(self._options.knots, self._options.search)

    def _best_duration(self, aim: Aim) -> float:
        made = self._tried[aim].attempts if aim in self._tried else []
        return min((duration_of(one) for one in made if one.verified), default=math.inf)

    def _turn_from_a_plan(self, aim: Aim) -> float:
        """How much an aim's heading differs from those of plans to its goal, 0 where there is none [rad]."""
        plans = (made.trajectory for made in self.attempts if made.verified and made.goal == aim.goal)
        ends = [float(found.poses[-1, 2]) for found in plans if found is not None]
        return min((abs(math.remainder(aim.heading - end, 2 * math.pi)) for end in ends), default=0.0)

    def _go_on(self, aims: Sequence[Aim]) -> None:
        """Search to the end for the first aim of each goal, until one leads to a plan."""
        goals: set[int] = set()
        for aim in aims:
            if aim.goal in goals or self._is_hopeless(aim):
                continue
            goals.add(aim.goal)
            schedule = self._schedule(aim)
            if self._source is None or isinstance(self._source, HybridAStar):
                schedule.try_source(self._search)
            self._tried[aim].attempts = settled(schedule, schedule.attempts, self._source)
            if self._is_verified():
                return

    def _polish(self) -> None:
        """Polish the quickest plans, whatever goals they lead to."""
        for tried in self._tried.values():
            tried.attempts = list(tried.attempts)
        verified = [
            (tried, i) for tried in self._tried.values() for i, made in enumerate(tried.attempts) if made.verified
        ]
        for which in minimum_time.worth_polishing([duration_of(tried.attempts[i]) for tried, i in verified]):
            tried, i = verified[which]
            made = polished(tried.schedule.scenario, tried.attempts[i], self._budget, self._options)
            tried.attempts[i] = made

    def reported(self, attempts: list[Attempt]) -> int:
        """Index of the best of the attempts: the cheapest verified one, or the quickest where time is minimised.

        Where there is no path to any goal, an attempt that says so is added.
        """
        verified = [i for i, made in enumerate(attempts) if made.verified]
        if verified:
            return min(verified, key=lambda i: self._price(attempts[i]))
        if self._refused.keys() == self._wanted:
            no_path = self._no_path_to_any(self._refused)
            attempts.append(Attempt("reachability", 0.0, None, reason=no_path.text, no_path=no_path))
            return len(attempts) - 1
        solved = [i for i, made in enumerate(attempts) if made.best is not None]
        if solved:
            return min(solved, key=lambda i: attempts[i].solves[attempts[i].best or 0].merit)
        guessed = [i for i, made in enumerate(attempts) if made.start is not None]
        return guessed[-1] if guessed else len(attempts) - 1

    @property
    def _refused(self) -> dict[int, NoPath]:
        """Goals to which there is no path; what exhausts the states around one pose of several says nothing."""
        found: dict[int, NoPath] = {}
        for made in self.attempts:
            if made.no_path and (made.no_path.proven or self._near.targets[made.goal].is_exact):
                found[made.goal] = made.no_path
        return found

    def _price(self, made: Attempt) -> float:
        return duration_of(made) if self._minimise or made.cost is None else made.cost.J

    def _no_path_to_any(self, refused: dict[int, NoPath]) -> NoPath:
        """Why there is no path to any goal, from the reasons for each."""
        first = refused[min(refused)]
        if len(refused) == 1:
            return first
        x0, y0 = self._origin
        texts = (
            f"{self._scenario.name_of_goal(goal)}: {no_path.placed(-x0, -y0, self._near.unit).text}"
            for goal, no_path in sorted(refused.items())
        )
        why = "; ".join(texts).replace("{", "{{").replace("}", "}}")
        return NoPath(why, all(no_path.proven for no_path in refused.values()), first.place, first.width)


def has_choice(scenario: Scenario) -> bool:
    """Whether there is more than one pose to plan to; a tolerance alone makes none."""
    return bool(scenario.goals)


def aims_of(scenario: Scenario) -> list[Aim]:
    """Poses of all goals at which the car may stand; those at which it may not are warned of."""
    aims = []
    for goal in range(len(scenario.targets)):
        try:
            aims += [Aim(goal, float(heading)) for heading in scenario.headings_at(goal)]
        except ScenarioError as error:
            logger.warning("%s; it is left out", error)
    return aims


def _well_apart(aims: Sequence[Aim]) -> list[Aim]:
    """The first few aims of each goal, in their order: those with headings well apart as long as there are any."""
    chosen: set[Aim] = set()
    for least in (APART, 0.0):
        for aim in aims:
            same = [other for other in chosen if other.goal == aim.goal]
            turns = (abs(math.remainder(aim.heading - other.heading, 2 * math.pi)) for other in same)
            if len(same) < OF_A_GOAL and all(turn >= least for turn in turns):
                chosen.add(aim)
    return [aim for aim in aims if aim in chosen]
