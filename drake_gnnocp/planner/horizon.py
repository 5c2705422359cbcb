"""Horizons: how long a plan is to take."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Real

LONGEST = 1000.0  # s, longest duration that is planned: the verification integrates every 5 ms of it
MEANING = f"must be 'guess', 'free' or 0 to {LONGEST:g} seconds"


@dataclass(frozen=True)
class FromGuess:
    """As long as the guess takes, and a little longer where the guess drives near the limits."""


@dataclass(frozen=True)
class Fixed:
    """A constant duration, as in the paper.

    Raises:
        ValueError: it is not a number in (0, LONGEST] [s].
    """

    seconds: float

    def __post_init__(self) -> None:
        is_number = isinstance(self.seconds, Real) and not isinstance(self.seconds, bool)
        if not is_number or not 0 < self.seconds <= LONGEST:
            raise ValueError(f"horizon: {MEANING}, not {self.seconds!r}")


@dataclass(frozen=True)
class MinimumTime:
    """The duration is a decision variable with a weight on time, and several paths are optimised."""


Horizon = FromGuess | Fixed | MinimumTime


def horizon_of(value: Horizon | float | str) -> Horizon:
    """The horizon that a user means: one as it is, a duration [s], "guess" or "free".

    Raises:
        ValueError: it is none of these.
    """
    if isinstance(value, Horizon):
        return value
    if isinstance(value, str) and value in ("guess", "free"):
        return FromGuess() if value == "guess" else MinimumTime()
    return Fixed(value)  # type: ignore[arg-type]  # which raises where it is no number
