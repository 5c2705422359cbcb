"""One attempt: a guess is timed, optimised and verified. The only place where that is done."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from drake_gnnocp.budget import Budget
from drake_gnnocp.guesses import Guess, NoGuess
from drake_gnnocp.ocp.costs import Cost, evaluate_cost
from drake_gnnocp.ocp.formulation import formulate
from drake_gnnocp.ocp.ipopt import USUAL
from drake_gnnocp.ocp.refine import Refined, Solve, counted, refine
from drake_gnnocp.ocp.sqp import SEARCHED, SqpSteps, sqp_steps
from drake_gnnocp.planner import minimum_time, tight_paths
from drake_gnnocp.planner.horizon import LONGEST, Fixed, Horizon, MinimumTime
from drake_gnnocp.planner.options import PlanOptions
from drake_gnnocp.planner.relaxed import relaxed
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.search.path import n_sections
from drake_gnnocp.search.reachability import NoPath
from drake_gnnocp.timing.minimum_effort import with_duration, with_minimum_effort
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import Input, State
from drake_gnnocp.verification import Verification, verify

# where SQP steps from a searched path have not converged: what is not solved soon is solved closely, and quicker
BRIEF = replace(USUAL, max_iterations=60)
AT_REST = "at_rest"  # the source of the guess where there is nothing to drive
SAME_LENGTH = 1e-9  # relative: a path no longer than this over what can be driven can be driven


@dataclass(frozen=True, eq=False)
class Attempt:
    """A guess and what became of it."""

    source: str  # of the guess
    guess_seconds: float  # s, making the guess and timing it
    start: Trajectory | None  # the timed guess the solver started from, or would have
    probability: float | None = None  # that the network gave the guess, see `learning.ranking`
    sqp_steps: int = 0  # before the first solve
    sqp_seconds: float = 0.0  # s
    solves: tuple[Solve, ...] = ()
    best: int | None = None  # index into solves of what the attempt led to; None where nothing was solved
    cost: Cost | None = None  # None where nothing was solved
    reason: str = ""  # why it was given up; empty when verified
    no_path: NoPath | None = None  # where that is because there is no path
    goal: int = 0  # index of the goal that it went for, see `Scenario.targets`

    @property
    def trajectory(self) -> Trajectory | None:
        """The optimised trajectory."""
        return None if self.best is None else self.solves[self.best].trajectory

    @property
    def verification(self) -> Verification | None:
        """What the check of it found."""
        return None if self.best is None else self.solves[self.best].verification

    @property
    def verified(self) -> bool:
        """Whether the trajectory passed the check; a guess that was never optimised does not, whatever it is like."""
        return self.verification is not None and self.verification.verified

    @property
    def is_refused(self) -> bool:
        """Whether there is a guess, but nothing was solved from it."""
        return self.start is not None and self.best is None

    @property
    def build_seconds(self) -> float:
        """Building the programs of all solves [s]."""
        return sum(solve.build_seconds for solve in self.solves)

    @property
    def solve_seconds(self) -> float:
        """SQP steps and all solves [s]."""
        return self.sqp_seconds + sum(solve.solve_seconds for solve in self.solves)

    @property
    def iterations(self) -> int:
        """Ipopt's, of all solves."""
        return sum(solve.iterations for solve in self.solves)

    @property
    def first_iterations(self) -> int:
        """Ipopt's, of the first solve."""
        return self.solves[0].iterations if self.solves else 0

    @property
    def refinements(self) -> int:
        """Solves after the first one."""
        return max(0, len(self.solves) - 1)

    @property
    def solver_status(self) -> str:
        """Ipopt's last word, empty where there was no solve."""
        return self.solves[-1].status if self.solves else ""

    def to_dict(self) -> dict[str, Any]:
        """The attempt in the keys of result.json."""
        return {
            "guess": self.source,
            "goal": self.goal,
            "guess_seconds": self.guess_seconds,
            "guess_probability": self.probability,
            "build_seconds": self.build_seconds,
            "solve_seconds": self.solve_seconds,
            "convex_steps": self.sqp_steps,
            "iterations": self.iterations,
            "first_iterations": self.first_iterations,
            "refinements": self.refinements,
            "solver_status": self.solver_status,
            "cost": None if self.cost is None else self.cost.J,
            "verified": self.verified,
            "reason": self.reason,
        }

    def placed(self, dx: float, dy: float, unit: float) -> Attempt:
        """The attempt in metres, at the task moved by (dx, dy) [m]; lengths are in a unit [m]."""
        solves = tuple(solve.placed(dx, dy, unit) for solve in self.solves)
        no_path = self.no_path and self.no_path.placed(dx, dy, unit)
        reason = self.reason if no_path is None else no_path.text
        start = self.start and self.start.scaled(unit).translated(dx, dy)
        return replace(self, start=start, solves=solves, no_path=no_path, reason=reason)


def attempt(
    scenario: Scenario,
    guess: Guess | NoGuess,
    horizon: Horizon,
    budget: Budget,
    options: PlanOptions,
    steps: SqpSteps | None = None,
    closely: bool | None = None,
) -> Attempt:
    """Time a guess, optimise it, and verify what comes out.

    Args:
        scenario: the task with one goal, near the origin.
        guess: where to begin, or why there is nothing to begin with.
        horizon: how long the plan is to take.
        budget: to stop at.
        options: see `PlanOptions`.
        steps: where SQP steps led from the guess, where they were taken to choose it.
        closely: whether to plan as `tight_paths` does; None: where the guess is one.
    """
    if isinstance(guess, NoGuess):
        return Attempt(guess.source, guess.seconds, None, reason=guess.reason, no_path=guess.no_path)
    begin = time.monotonic() - guess.seconds
    slack = 1.0 if guess.is_timed else options.slack
    duration = horizon.seconds if isinstance(horizon, Fixed) else slack * guess.trajectory.duration
    reason = _refusal(guess.trajectory, duration, scenario)
    if not reason and budget.is_over:
        reason = budget.ended_before("the first solve")
    if reason:
        return Attempt(guess.source, time.monotonic() - begin, guess.trajectory, reason=reason)
    closely = tight_paths.is_tight(scenario, guess) if closely is None else closely
    start = _timed(scenario, guess, horizon, duration, slack, closely)
    seconds = time.monotonic() - begin
    minimise = isinstance(horizon, MinimumTime)
    # SQP steps are for a duration: that comes first, and a quicker one after it
    free = minimise and steps is None and not closely
    exact = scenario.exact  # a tolerance at the goal comes in once there is a plan, or there is none
    problem = (start, options.cost, options.margin, free, options.comfort)
    formulation = formulate(exact, *problem)
    if closely:
        formulation, steps = tight_paths.kept_near(exact, formulation), None
    elif steps is None and options.sqp and not free:
        steps = sqp_steps(formulation, SEARCHED, budget)
    settings = BRIEF if guess.path is not None and not closely and not minimise else USUAL
    refined = refine(exact, formulation, budget, steps, settings)
    if exact is not scenario and not refined.verified and not budget.is_over:
        again = refine(scenario, formulate(scenario, *problem), budget)
        refined = refined.followed_by(again, again.verified or refined.best is None)
    refined = _finished(scenario, refined, minimise, budget, options)
    made = Attempt(guess.source, seconds, start, guess.probability, reason=_reason(guess, refined))
    if steps is not None and refined.solves:
        made = replace(made, sqp_steps=steps.steps, sqp_seconds=steps.seconds)
    return _with_solves(scenario, made, refined, options)


def _finished(scenario: Scenario, refined: Refined, minimise: bool, budget: Budget, options: PlanOptions) -> Refined:
    """What there is, made quicker where time is minimised, else cheaper where the goal leaves a choice."""
    exact = scenario.exact
    if minimise:
        for task in (exact, scenario) if exact is not scenario else (scenario,):
            refined = minimum_time.quicker(task, refined, options.cost, options.margin, budget)
    elif exact is not scenario:
        refined = relaxed(scenario, refined, options, budget)
    return refined


def polished(scenario: Scenario, verified: Attempt, budget: Budget, options: PlanOptions) -> Attempt:
    """An attempt with a verified plan, which is made quicker where that can be; see `minimum_time`."""
    refined = Refined(verified.solves, verified.best, "")
    refined = minimum_time.polished(scenario, refined, options.cost, options.margin, budget)
    return _with_solves(scenario, verified, refined, options)


def at_rest(scenario: Scenario, seconds: float, options: PlanOptions) -> Attempt:
    """The plan of a car that is at its goal already: it stands for some time [s]."""
    t = np.linspace(0.0, seconds, options.knots)
    states = np.zeros((len(t), len(State)))
    states[:, : State.V] = scenario.start
    standing = Trajectory(t, states, np.zeros((len(t), len(Input))))
    solve = Solve(0.0, 0.0, 0, True, "", (), 0, 0, standing, verify(scenario, standing))
    made = Attempt(AT_REST, 0.0, standing)
    return _with_solves(scenario, made, Refined((solve,), 0, ""), options)


def _reason(guess: Guess, refined: Refined) -> str:
    """Why there is no verified plan, beginning with what a search found; empty where there is one."""
    if guess.path is None or not refined.reason:
        return refined.reason
    changes = n_sections(guess.path) - 1
    return f"the search found a path with {counted(changes, 'change')} of gear; {refined.reason}"


def _with_solves(scenario: Scenario, made: Attempt, refined: Refined, options: PlanOptions) -> Attempt:
    trajectory = refined.trajectory
    cost = None if trajectory is None else evaluate_cost(trajectory, scenario, options.cost)
    return replace(made, solves=refined.solves, best=refined.best, cost=cost)


def _refusal(guess: Trajectory, duration: float, scenario: Scenario) -> str:
    """Why a guess cannot be driven in a duration [s], or an empty text."""
    if duration > LONGEST:
        return f"the guess takes {duration:.0f} s, more than the {LONGEST:g} s that are planned"
    length, longest = guess.path_length, scenario.vehicle.v_max * duration
    if length > longest * (1 + SAME_LENGTH):
        in_metres = scenario.unit * length, scenario.unit * longest
        return f"the guess's path is {in_metres[0]:.1f} m long, and {duration:g} s at v_max are {in_metres[1]:.1f} m"
    return ""


def _timed(
    scenario: Scenario, guess: Guess, horizon: Horizon, duration: float, slack: float, closely: bool
) -> Trajectory:
    """The guess with the knots and the timing that the optimiser starts from."""
    if closely and guess.path is not None:
        fine = tight_paths.timed(guess.path, scenario.vehicle, guess.trajectory, slack)
        return with_duration(fine, duration) if isinstance(horizon, Fixed) else fine
    if isinstance(horizon, MinimumTime) or guess.is_timed:  # plans end near the limits, as the speed planner's do
        return with_duration(guess.trajectory, duration)
    return with_minimum_effort(guess.trajectory, duration, scenario.vehicle)
