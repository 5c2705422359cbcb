"""Wall-clock time that may be spent: what is left of it, and shares of that."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

Clock = Callable[[], float]  # an instant in seconds that only rises


@dataclass(frozen=True)
class Budget:
    """Time until an instant of a clock.

    A budget runs down by itself: it is not told what is spent. Parts of it are budgets of their own, which begin now
    and end no later.
    """

    end: float  # s, instant of the clock
    clock: Clock = time.monotonic

    @classmethod
    def of(cls, seconds: float, clock: Clock = time.monotonic) -> Budget:
        """The next `seconds` [s], which may be infinite."""
        return cls(clock() + seconds, clock)

    @classmethod
    def unlimited(cls) -> Budget:
        """A budget that never ends."""
        return cls(math.inf)

    @property
    def left(self) -> float:
        """Time that is left, 0 where it is over [s]."""
        return max(0.0, self.end - self.clock())

    @property
    def is_over(self) -> bool:
        """Whether nothing is left."""
        return self.clock() >= self.end

    def at_most(self, seconds: float) -> Budget:
        """The next `seconds` [s], or what is left where that is less."""
        return replace(self, end=min(self.end, self.clock() + seconds))

    def share(self, fraction: float, at_least: float = 0.0) -> Budget:
        """A fraction of what is left, or `at_least` [s] where that is more and there is as much."""
        return self.at_most(max(fraction * self.left, at_least))

    def without(self, seconds: float) -> Budget:
        """The same but for its last `seconds` [s], which are kept for what comes after."""
        return replace(self, end=self.end - seconds)
