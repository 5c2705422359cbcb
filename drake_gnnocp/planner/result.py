"""What planning returns: the plan, the attempts that led to it, and the files that hold them."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from drake_gnnocp.files import replaced_together, write_atomically
from drake_gnnocp.ocp.costs import Cost, evaluate_cost
from drake_gnnocp.ocp.refine import counted
from drake_gnnocp.planner.attempt import AT_REST, Attempt
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.search.reachability import NoPath
from drake_gnnocp.timing.at_rate import at_rate
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import State
from drake_gnnocp.verification import Finding, Verification, verify

FILES = ("scenario.json", "trajectory.csv", "guess.csv", "result.json")  # of a plan


@dataclass(frozen=True, eq=False)
class Plan:
    """A planned trajectory with its verification; `status` says whether it may be driven."""

    scenario: Scenario
    attempts: tuple[Attempt, ...]  # what was tried, in order
    reported: int  # index of the attempt that the plan is of
    total_seconds: float  # s
    budget_ended: bool = False  # whether the budget cut work short that would have been done; if not, it played no part

    @property
    def attempt(self) -> Attempt:
        """The attempt that is reported."""
        return self.attempts[self.reported]

    @property
    def status(self) -> str:
        """What came out.

        "verified", "unverified" (the check found faults), "no_path" (see `no_path`) or "failed" (nothing was solved).
        """
        if self.no_path is not None:
            return "no_path"
        if self.attempt.trajectory is None:
            return "failed"
        return "verified" if self.attempt.verified else "unverified"

    @property
    def verified(self) -> bool:
        """Whether the independent check passed."""
        return self.attempt.verified

    @property
    def guess_source(self) -> str:
        """Name of the source of the guess."""
        return self.attempt.source

    @property
    def trajectory(self) -> Trajectory | None:
        """The planned trajectory; None where nothing was solved, as are verification and cost."""
        return self.attempt.trajectory

    @property
    def guess(self) -> Trajectory | None:
        """What the solver started from."""
        return self.attempt.start

    @property
    def verification(self) -> Verification | None:
        """What the independent check found."""
        return self.attempt.verification

    @property
    def first_fault(self) -> Finding | None:
        """What keeps the trajectory from being verified, where it is met first; None where that is not known."""
        return None if self.verification is None else self.verification.first_fault

    @property
    def cost(self) -> Cost | None:
        """What the trajectory costs."""
        return self.attempt.cost

    @property
    def no_path(self) -> NoPath | None:
        """Why there is no path, where that is proven or the search has exhausted its states; else None."""
        return self.attempt.no_path

    @property
    def goal_reached(self) -> int | None:
        """Index of the goal that the plan leads to (see `Scenario.targets`); None where it is not verified."""
        return self.attempt.goal if self.verified else None

    @property
    def _end_text(self) -> str:
        """Which goal was reached, and how the car stands there, where there was a choice."""
        goal, trajectory = self.goal_reached, self.trajectory
        if not self.scenario.goals or goal is None or trajectory is None:
            return ""
        heading = math.degrees(math.remainder(trajectory.poses[-1, State.THETA], 2 * math.pi))
        free = f" with the heading {heading:.0f} degrees" if self.scenario.targets[goal].is_free else ""
        return f"; reaches {self.scenario.name_of_goal(goal)}{free}"

    @property
    def reason(self) -> str:
        """Why the plan that is reported is not verified; empty where it is."""
        return self.attempt.reason

    @property
    def summary(self) -> str:
        """What came out in one line, and one more for every attempt that was given up."""
        if self.no_path is not None:
            proven = "proven" if self.no_path.proven else "not proven"
            return f"{self.scenario.name}: no path ({proven}) in {self.total_seconds:.2f} s: {self.no_path.text}"
        if self.guess_source == AT_REST:
            return f"{self.scenario.name}: {self.status}: start and goal are the same: nothing to drive{self._end_text}"
        iterations = sum(attempt.iterations for attempt in self.attempts)
        line = f"{self.scenario.name}: {self.status} in {self.total_seconds:.2f} s (guess {self.guess_source}"
        line += f", {counted(iterations, 'iteration')}, {counted(len(self.attempts), 'attempt')})"
        if self.trajectory is not None and self.cost is not None and self.verification is not None:
            clearance = self.verification.clearance_text
            line += f"; {self.trajectory.duration:.1f} s long, cost {self.cost.J:.2f}, {clearance}{self._end_text}"
        if self.budget_ended:
            line += "; the budget ended before all was tried"
        reasons = [f"  {self._label(attempt)}: {attempt.reason}" for attempt in self.attempts if attempt.reason]
        return "\n".join([line, *reasons])

    def _label(self, attempt: Attempt) -> str:
        """The source of an attempt's guess, and where there are several goals the one it went for."""
        several = len(self.scenario.goals) > 1
        return f"{attempt.source} to {self.scenario.name_of_goal(attempt.goal)}" if several else attempt.source

    def __repr__(self) -> str:
        return f"<Plan {self.summary}>"

    def _repr_html_(self) -> str:
        """A picture and a short table, for notebooks."""
        from drake_gnnocp.pictures import plan_html  # matplotlib is not for everyone

        return plan_html(self)

    def resampled(self, rate: float) -> Plan:
        """The plan with rows every 1 / rate [Hz], verified and costed anew as it then is; see `timing.at_rate`.

        Where the rows are too far apart for the plan's motion, the status is "unverified".

        Raises:
            ValueError: there is no trajectory, or there would be too few or too many rows.
        """
        attempt = self.attempt
        if attempt.best is None or attempt.cost is None:
            raise ValueError(f"{rate:g} Hz: there is no trajectory")
        solve, (x0, y0, _) = attempt.solves[attempt.best], self.scenario.start
        scenario = self.scenario.translated(-x0, -y0)  # near the origin, see there
        rows = at_rate(solve.trajectory.translated(-x0, -y0), scenario.vehicle, rate)
        check, cost = verify(scenario, rows), evaluate_cost(rows, scenario, attempt.cost.weights)
        solves = list(attempt.solves)
        solves[attempt.best] = replace(solve, trajectory=rows, verification=check).placed(x0, y0, unit=1.0)
        made = replace(attempt, solves=tuple(solves), cost=cost, reason="; ".join(check.faults))
        return replace(self, attempts=(*self.attempts[: self.reported], made, *self.attempts[self.reported + 1 :]))

    def to_dict(self) -> dict[str, Any]:
        """The content of result.json."""
        return {
            "scenario": self.scenario.name,
            "status": self.status,
            "guess": self.guess_source,
            "total_seconds": self.total_seconds,
            "budget_ended": self.budget_ended,
            "goal_reached": self.goal_reached,
            "t_final": None if self.trajectory is None else self.trajectory.duration,
            "cost": None if self.cost is None else self.cost.to_dict(),
            "no_path": None if self.no_path is None else self.no_path.to_dict(),
            "attempts": [attempt.to_dict() for attempt in self.attempts],
            "verification": None if self.verification is None else self.verification.to_dict(),
        }

    def save(self, folder: Path | str) -> None:
        """Write scenario.json, trajectory.csv, guess.csv and result.json into a folder, made where missing.

        Where nothing was solved, trajectory.csv is the guess: the best there is, and marked "failed" in result.json.
        Where there is no path, there is neither of them.

        Raises:
            OSError: a file could not be written; then the folder is as it was before.
        """
        with replaced_together(Path(folder), FILES) as stage:
            self.scenario.save(stage / "scenario.json")
            for name, trajectory in (("trajectory.csv", self.trajectory or self.guess), ("guess.csv", self.guess)):
                if trajectory is not None:
                    trajectory.save_csv(stage / name)
            write_atomically(stage / "result.json", json.dumps(self.to_dict(), indent=1, allow_nan=False) + "\n")
