"""What planning returns: the plan, the attempts that led to it, and the files that hold them."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from drake_gnnocp.files import write_atomically
from drake_gnnocp.ocp.cost import Cost
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.verification import Verification

OUT_OF_TIME = "Wall time exceeded"  # what Ipopt says


@dataclass(frozen=True)
class Attempt:
    """One guess and what became of it."""

    guess: str  # source of the guess
    guess_seconds: float  # s
    build_seconds: float  # s, all rounds
    solve_seconds: float  # s, all rounds
    convex_steps: int  # before the first round
    iterations: int  # of Ipopt, all rounds
    first_iterations: int  # the same, first round
    refinements: int  # rounds after the first solve
    solver_status: str  # Ipopt's last word, "" where there was no solve
    cost: float | None  # J, None where there was no solve
    verified: bool  # a guess that was never optimised is not, whatever it is like
    reason: str  # why it was given up; empty when verified


@dataclass(frozen=True, eq=False)
class Plan:
    """A planned trajectory with its verification; `status` says whether it may be driven."""

    scenario: Scenario
    status: str  # "verified" | "unverified" (optimised, but the check found faults) | "failed" (nothing was solved)
    guess_source: str
    trajectory: Trajectory | None  # None where nothing was solved, as are verification and cost
    guess: Trajectory | None  # what the solver started from in the attempt that is reported
    verification: Verification | None
    cost: Cost | None
    attempts: tuple[Attempt, ...]
    total_seconds: float  # s

    @property
    def verified(self) -> bool:
        """Whether the independent check passed."""
        return self.status == "verified"

    @property
    def cut_short(self) -> bool:
        """Whether the plan is verified, but the budget ended before Ipopt was at its optimum."""
        if not self.verified or self.cost is None:
            return False
        reported = [attempt for attempt in self.attempts if attempt.verified and attempt.cost == self.cost.J]
        return any(attempt.solver_status == OUT_OF_TIME for attempt in reported)

    @property
    def summary(self) -> str:
        """What came out in one line, and one more for every attempt that was given up."""
        line = f"{self.scenario.name}: {self.status} in {self.total_seconds:.2f} s (guess {self.guess_source}"
        line += f", {sum(each.iterations for each in self.attempts)} iterations, {len(self.attempts)} attempts)"
        if self.trajectory is not None and self.cost is not None and self.verification is not None:
            clearance = self.verification.min_clearance_m
            line += f"; {self.trajectory.duration:.1f} s long, cost {self.cost.J:.2f}, clearance {clearance:.2f} m"
        if self.cut_short:
            line += "; stopped by the budget: not yet at its optimum"
        reasons = [f"  {each.guess}: {each.reason}" for each in self.attempts if each.reason]
        return "\n".join([line, *reasons])

    def to_dict(self) -> dict[str, Any]:
        """The content of result.json."""
        return {
            "scenario": self.scenario.name,
            "status": self.status,
            "guess": self.guess_source,
            "total_seconds": self.total_seconds,
            "t_final": None if self.trajectory is None else self.trajectory.duration,
            "cost": None if self.cost is None else asdict(self.cost),
            "attempts": [asdict(attempt) for attempt in self.attempts],
            "verification": None if self.verification is None else self.verification.to_dict(),
        }

    def save(self, folder: Path | str) -> None:
        """Write scenario.json, trajectory.csv, guess.csv and, last, result.json into a folder, made where missing.

        Where nothing was solved, trajectory.csv is the guess: the best there is, and marked "failed" in result.json.
        """
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "result.json").unlink(missing_ok=True)  # an older one would speak of the new files
        self.scenario.save(folder / "scenario.json")
        for name, trajectory in (("trajectory.csv", self.trajectory or self.guess), ("guess.csv", self.guess)):
            if trajectory is None:
                (folder / name).unlink(missing_ok=True)  # an older plan's would be taken for this one's
            else:
                trajectory.save_csv(folder / name)
        write_atomically(folder / "result.json", json.dumps(self.to_dict(), indent=1, allow_nan=False) + "\n")
