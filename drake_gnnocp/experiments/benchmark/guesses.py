r"""Guesses: what the solvers are given, those made bad on purpose, and measures of a guess without its optimum.

Bad guesses come from our own verified plan of the task, so what they are away from it is known:

    optimum     the plan itself
    noise A m   x and y moved by  sum_m c_m sin(m pi t / T),  m = 1..4, c_m normal, scaled to the rms A over the knots;
                theta, v, phi, a and w are left as they are, so the guess does not drive
    straight    the straight line from start to goal in the plan's duration, through whatever is there
"""

from __future__ import annotations

import math
import os
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely

from drake_gnnocp.budget import Budget
from drake_gnnocp.guesses import HybridAStar, Learned, NoGuess
from drake_gnnocp.guesses.straight import straight_line
from drake_gnnocp.ocp.dynamics import defects
from drake_gnnocp.planner.options import PlanOptions
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.timing.minimum_effort import with_duration, with_minimum_effort
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import State

MODES = 4  # of the noise
SEARCHED, OPTIMUM, STRAIGHT = "hybrid_astar", "optimum", "straight"
AMPLITUDES = {"noise 0.3 m": 0.3, "noise 0.6 m": 0.6, "noise 1.0 m": 1.0}  # m, rms of x and of y
BAD_GUESSES = (OPTIMUM, *AMPLITUDES, STRAIGHT)


@dataclass(frozen=True)
class MadeGuess:
    """A guess, or why there is none."""

    trajectory: Trajectory | None
    reason: str  # empty where there is one
    seconds: float  # s it took when it was made


def search_guess(scenario: Scenario, n_knots: int, max_seconds: float) -> MadeGuess:
    """Hybrid A*, timed as the planner times it, with the planner's slack; `max_seconds` limits the search [s]."""
    found = next(HybridAStar(n_knots).guesses(scenario, Budget.of(max_seconds)))
    if isinstance(found, NoGuess):
        return MadeGuess(None, found.reason, found.seconds)
    timed = with_minimum_effort(found.trajectory, PlanOptions().slack * found.trajectory.duration, scenario.vehicle)
    return MadeGuess(timed, "", found.seconds)


def network_guess(scenario: Scenario, knots: int, weights: Path | None) -> Trajectory:
    """The network's first-ranked hypothesis, as predicted, for a scenario near the origin."""
    found = next(Learned(knots, weights).guesses(scenario, Budget.unlimited()))
    assert not isinstance(found, NoGuess)
    return found.trajectory


def first_guess(
    scenario: Scenario, kind: str, knots: int, weights: Path | None, max_seconds: float
) -> Trajectory | None:
    """The first guess of the network ("gnn") or of Hybrid A*, near the origin; None where none is found in time [s]."""
    if kind == SEARCHED:
        return search_guess(scenario, knots, max_seconds).trajectory
    return network_guess(scenario, knots, weights)


def bad_guess(kind: str, scenario: Scenario, optimum: Trajectory) -> Trajectory:
    """One of `BAD_GUESSES`, the same whenever it is asked for."""
    if kind == OPTIMUM:
        return optimum
    if kind == STRAIGHT:
        return with_duration(straight_line(scenario, len(optimum)), optimum.duration)
    amplitude = AMPLITUDES[kind]
    rng = np.random.default_rng([zlib.crc32(scenario.name.encode()), round(100 * amplitude)])
    return with_noise(optimum, amplitude, rng)


def with_noise(trajectory: Trajectory, amplitude: float, rng: np.random.Generator) -> Trajectory:
    """The trajectory with x and y moved smoothly by `amplitude` [m] each (rms over the knots), the ends kept."""
    phase = math.pi * (trajectory.t - trajectory.t[0]) / trajectory.duration
    modes = np.sin(phase[:, None] * np.arange(1, MODES + 1))  # (N, MODES)
    move = modes @ rng.normal(size=(MODES, 2))
    states = trajectory.states.copy()
    states[:, :2] += amplitude * move / np.sqrt(np.mean(move**2, axis=0))
    states[[0, -1]] = trajectory.states[[0, -1]]  # sin(m pi) is not quite 0
    return Trajectory(trajectory.t, states, trajectory.inputs)


def save_guess(path: Path, guess: MadeGuess) -> None:
    """Write a guess (npz), whole or not at all."""
    t, states, inputs = np.zeros(0), np.zeros((0, 5)), np.zeros((0, 2))
    if guess.trajectory is not None:
        t, states, inputs = guess.trajectory.t, guess.trajectory.states, guess.trajectory.inputs
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{os.getpid()}.npz")
    np.savez(temporary, t=t, states=states, inputs=inputs, reason=guess.reason, seconds=guess.seconds)
    temporary.replace(path)


def load_guess(path: Path) -> MadeGuess:
    """Read what `save_guess` wrote."""
    with np.load(path, allow_pickle=False) as data:
        trajectory = Trajectory(data["t"], data["states"], data["inputs"]) if len(data["t"]) else None
        return MadeGuess(trajectory, str(data["reason"]), float(data["seconds"]))


def blocked_share(scenario: Scenario, guess: Trajectory | None) -> float:
    """Share of a guess's knots at which the car touches an obstacle; NaN without a guess."""
    if guess is None:
        return math.nan
    cars = shapely.polygons(scenario.vehicle.footprints(guess.poses))
    return float((scenario.shapes.distances(cars) == 0).mean())


def mean_defect(scenario: Scenario, guess: Trajectory | None) -> float:
    """Mean distance by which a guess misses the kinematic model from one knot to the next [m]; NaN without one."""
    if guess is None:
        return math.nan
    knots = np.hstack([guess.states, guess.inputs])
    missed, _ = defects(knots, guess.duration / (len(guess) - 1), scenario.vehicle)
    return float(np.hypot(missed[:, State.X], missed[:, State.Y]).mean())
