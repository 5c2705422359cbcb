"""The straight line from start to goal, through whatever is there."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from drake_gnnocp.budget import Budget
from drake_gnnocp.guesses.base import Guess, NoGuess
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import State

SPEED = 0.5  # of v_max, in the mean
LEAST_DURATION = 10.0  # s


@dataclass(frozen=True)
class Straight:
    """Constant speed along the straight line, the heading turning evenly."""

    knots: int
    name: str = "straight"
    proposes_many: bool = False

    def check_available(self) -> None:
        """Nothing is needed."""

    def guesses(self, scenario: Scenario, budget: Budget) -> Iterator[Guess | NoGuess]:
        """The one line."""
        yield Guess(self.name, straight_line(scenario, self.knots))


def straight_line(scenario: Scenario, knots: int) -> Trajectory:
    """The straight guess of a scenario, at equally spaced knots."""
    start, goal = scenario.start, scenario.goal
    turn = math.remainder(goal[2] - start[2], 2 * math.pi)
    change = np.array([goal[0] - start[0], goal[1] - start[1], turn])
    distance = float(np.hypot(change[0], change[1]))
    duration = max(distance / (SPEED * scenario.vehicle.v_max), LEAST_DURATION)
    t = np.linspace(0.0, duration, knots)
    states = np.zeros((knots, 5))
    states[:, :3] = start + (t / duration)[:, None] * change
    along = change[0] * np.cos(states[:, State.THETA]) + change[1] * np.sin(states[:, State.THETA])
    states[1:-1, State.V] = along[1:-1] / duration
    return Trajectory(t, states, np.zeros((knots, 2)))
