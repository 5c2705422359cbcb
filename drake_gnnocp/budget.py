"""Wall-clock time that may be spent. It only ever ends work: what is tried does not depend on it."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

Clock = Callable[[], float]  # an instant in seconds that only rises
RESERVE, RESERVE_SHARE = 0.2, 0.1  # s, and of all: the smaller is kept for checking what the last solve led to


@dataclass
class Budget:
    """Time that begins now, the same for all that is done for one plan.

    It runs down by itself: it is not told what is spent. Whoever has more to do asks `is_over`, and leaves the rest
    undone where it is; `ended` says so from then on. Unless `ended`, a result is the same whatever the clock says.
    """

    seconds: float  # s, which may be infinite
    clock: Clock = time.monotonic
    reserve: float = 0.0  # s, last part in which no work begins
    ended: bool = False  # whether work was left undone
    begin: float = field(init=False)  # s, instant of the clock

    def __post_init__(self) -> None:
        self.begin = self.clock()

    @classmethod
    def of(cls, seconds: float, clock: Clock = time.monotonic) -> Budget:
        """The next `seconds` [s], with a reserve."""
        return cls(seconds, clock, min(RESERVE, RESERVE_SHARE * seconds))

    @classmethod
    def unlimited(cls) -> Budget:
        """A budget that never ends."""
        return cls(math.inf)

    @property
    def spent(self) -> float:
        """Time since it began [s]."""
        return self.clock() - self.begin

    @property
    def left(self) -> float:
        """Time in which work may be done, 0 where it is over [s]."""
        return max(0.0, self.seconds - self.reserve - self.spent)

    @property
    def is_over(self) -> bool:
        """Whether nothing is left; to be asked only where there is more to do, which is then left undone."""
        self.ended = self.ended or self.left == 0.0
        return self.ended

    def lasts(self, seconds: float) -> bool:
        """Whether there is time for what takes so long [s]; to be asked as `is_over` is."""
        self.ended = self.ended or self.left < seconds
        return not self.ended

    def ended_before(self, what: str) -> str:
        """The reason why something was not done, in words."""
        return f"the budget of {self.seconds:g} s ended before {what}"

    @contextmanager
    def standing_still(self) -> Iterator[None]:
        """What is done meanwhile does not count."""
        begin = self.clock()
        yield
        self.begin += self.clock() - begin
