r"""Where the solvers start: the guess of Hybrid A*, kept on disk for all methods, and guesses made bad on purpose.

Bad guesses come from our own verified plan of the task, so what they are away from it is known:

    optimum     the plan itself
    noise A m   x and y moved by  sum_m c_m sin(m pi t / T),  m = 1..4, c_m normal, scaled to the rms A over the knots;
                theta, v, phi, a and w are left as they are, so the guess does not drive
    straight    the straight line from start to goal in the plan's duration, through whatever is there
"""

from __future__ import annotations

import math
import os
import time
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drake_gnnocp.guesses.sources import GuessOptions, hybrid_astar_guess, straight_guess
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.timing.minimum_effort import gently_timed, with_duration
from drake_gnnocp.trajectory import Trajectory

SLACK = 1.1  # the planner's: duration given to the optimiser over the guess's
MODES = 4  # of the noise
HYBRID_ASTAR, OPTIMUM, STRAIGHT = "hybrid_astar", "optimum", "straight"
AMPLITUDES = {"noise 0.3 m": 0.3, "noise 0.6 m": 0.6, "noise 1.0 m": 1.0}  # m, rms of x and of y
BAD_GUESSES = (OPTIMUM, *AMPLITUDES, STRAIGHT)


@dataclass(frozen=True)
class MadeGuess:
    """A guess, or why there is none."""

    trajectory: Trajectory | None
    reason: str  # empty where there is one
    seconds: float  # s it took when it was made


def search_guess(scenario: Scenario, n_knots: int, max_seconds: float) -> MadeGuess:
    """Hybrid A*, timed as the planner times it, with `SLACK` more time; `max_seconds` limits the search [s]."""
    begin = time.monotonic()
    found = hybrid_astar_guess(scenario, GuessOptions(n_knots=n_knots), begin + max_seconds)
    seconds = time.monotonic() - begin
    if found.trajectory is None:
        return MadeGuess(None, found.reason, seconds)
    timed = gently_timed(found.trajectory, SLACK * found.trajectory.duration, scenario.vehicle)
    return MadeGuess(timed, "", seconds)


def bad_guess(kind: str, scenario: Scenario, optimum: Trajectory) -> Trajectory:
    """One of `BAD_GUESSES`, the same whenever it is asked for."""
    if kind == OPTIMUM:
        return optimum
    if kind == STRAIGHT:
        straight = straight_guess(scenario, GuessOptions(n_knots=len(optimum))).trajectory
        assert straight is not None
        return with_duration(straight, optimum.duration)
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
