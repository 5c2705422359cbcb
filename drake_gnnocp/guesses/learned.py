"""The network's hypotheses.

What they need is imported when a learned guess is first asked for: other plans need not wait for it.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from drake_gnnocp.budget import Budget
from drake_gnnocp.files import PACKAGE
from drake_gnnocp.guesses.base import Guess, GuessUnavailable, NoGuess
from drake_gnnocp.scenario import Scenario

if TYPE_CHECKING:
    from drake_gnnocp.learning.checkpoint import Trained


FARTHEST = 12.0  # lengths of the car; in the dataset it is 9.1 at most


@dataclass(frozen=True)
class Learned:
    """Trajectories that the network predicts, the most promising first.

    The first takes the network's time; so does the one with which it begins to look at other views of the scene.
    """

    knots: int
    weights: Path | None = None  # None: those that come with the package
    most: int | None = None  # hypotheses; None: all there are
    name: str = "gnn"
    proposes_many: bool = True

    def check_available(self) -> None:
        """Load the network; raise GuessUnavailable where there is none."""
        load_network(self.weights)

    @staticmethod
    def is_far(scenario: Scenario) -> bool:
        """Whether start and goal are much farther apart than in all tasks that the network has learned from."""
        return float(np.linalg.norm(scenario.goal[:2] - scenario.start[:2])) > FARTHEST * scenario.vehicle.length

    def guesses(self, scenario: Scenario, budget: Budget) -> Iterator[Guess | NoGuess]:
        """The hypotheses."""
        from drake_gnnocp.learning.predict import hypotheses, interpolated

        begin = time.monotonic()
        for rank, hypothesis in enumerate(hypotheses(load_network(self.weights), scenario), start=1):
            trajectory = interpolated(hypothesis.points, hypothesis.duration, scenario, self.knots)
            try:
                seconds, probability = time.monotonic() - begin, hypothesis.probability
                guess = Guess(self.name, trajectory, seconds, probability=probability, is_timed=True)
            except ValueError as error:  # finite weights may still predict numbers that are not
                yield NoGuess(self.name, str(error), time.monotonic() - begin)
                return
            yield guess
            if rank == self.most:
                return
            begin = time.monotonic()


def load_network(weights: Path | None = None) -> Trained:
    """The trained network in a file, or the one that comes with the package; read once, and again when it changes.

    Raises:
        GuessUnavailable: there is none.
    """
    path = weights or bundled_weights()
    return _load_network(path, path.stat().st_mtime_ns if path.exists() else 0)


@lru_cache(maxsize=8)
def _load_network(path: Path, _changed: int) -> Trained:
    """The network in a file."""
    from drake_gnnocp.learning.checkpoint import WeightsError, load_weights

    try:
        return load_weights(path)[0]
    except WeightsError as error:
        raise GuessUnavailable(f"guess: 'gnn' needs trained weights: {error}") from None


def bundled_weights(config: str = "default") -> Path:
    """The file of the weights that come with the package, of one of the networks' configurations."""
    return PACKAGE / "weights" / f"{config}.safetensors"
