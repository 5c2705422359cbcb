"""Guesses and where they come from: what every source has in common."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from drake_gnnocp.budget import Budget
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.search.path import GearedPath
from drake_gnnocp.search.reachability import NoPath
from drake_gnnocp.trajectory import Trajectory

EQUAL_STEPS = 1e-6  # relative: time steps that differ by less are equally long


class GuessUnavailable(ValueError):
    """A guess of the kind asked for cannot be made here; the message says what is missing."""


@dataclass(frozen=True, eq=False)
class Guess:
    """A trajectory to begin with: any quality, knots equally spaced in time.

    Raises:
        ValueError: a number is not finite, or the knots are not equally spaced.
    """

    source: str  # name of where it comes from
    trajectory: Trajectory
    seconds: float = 0.0  # s, that it took
    path: GearedPath | None = None  # that the trajectory puts a time to, where there is one
    probability: float | None = None  # that the planner's SQP steps from it converge, where that is predicted
    is_timed: bool = False  # whether it has the timing of an optimum already, and the duration that is wanted

    def __post_init__(self) -> None:
        check_numbers(self.trajectory)
        steps = np.diff(self.trajectory.t)
        if np.ptp(steps) > EQUAL_STEPS * steps.mean():
            raise ValueError(f"guess: {self.source!r}: the knots must be equally spaced in time")


def check_numbers(trajectory: Trajectory) -> None:
    """Refuse what no solver can begin with.

    Raises:
        ValueError: a number is not finite, or the times do not increase; the message names the first such knot.
    """
    if trajectory.flaw:
        raise ValueError(f"guess: {trajectory.flaw}")


@dataclass(frozen=True)
class NoGuess:
    """Why a source has no guess."""

    source: str
    reason: str
    seconds: float = 0.0  # s, that were spent
    no_path: NoPath | None = None  # where that is because there is no path


class GuessSource(Protocol):
    """Where guesses come from. A new one is a class with these four members."""

    @property
    def name(self) -> str:
        """What it is called in results."""
        ...

    @property
    def proposes_many(self) -> bool:
        """Whether its guesses are many and cheap: then only those are solved that SQP steps converge from."""
        ...

    def check_available(self) -> None:
        """Load what is needed.

        Raises:
            GuessUnavailable: something is missing.
        """
        ...

    def guesses(self, scenario: Scenario, budget: Budget) -> Iterator[Guess | NoGuess]:
        """The guesses for a task, the most promising first, each made when it is asked for.

        Args:
            scenario: the task, with its start at the origin.
            budget: to stop at.
        """
        ...


@dataclass(frozen=True, eq=False)
class Given:
    """A trajectory that the user has, in the frame of the scenario that it is given with."""

    trajectory: Trajectory
    name: str = "given"
    proposes_many: bool = False

    def check_available(self) -> None:
        """It is there."""

    def guesses(self, scenario: Scenario, budget: Budget) -> Iterator[Guess | NoGuess]:
        """The trajectory itself."""
        yield Guess(self.name, self.trajectory, is_timed=True)
