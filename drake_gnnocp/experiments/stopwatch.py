"""Time by stages: what named functions take without the named functions that they call."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import wraps
from typing import Any


@dataclass
class Stopwatch:
    """Seconds and calls by stage, since it was last set to zero."""

    seconds: dict[str, float] = field(default_factory=dict)
    calls: dict[str, int] = field(default_factory=dict)
    _within: list[float] = field(default_factory=list)  # s, of the calls that are going on: what stages in them took

    def reset(self) -> None:
        """Set it to zero."""
        self.seconds.clear()
        self.calls.clear()

    def timed(self, stage: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """The function, whose time counts as that of a stage."""

        @wraps(function)
        def measured(*given: Any, **options: Any) -> Any:
            begin = time.perf_counter()
            self._within.append(0.0)
            try:
                return function(*given, **options)
            finally:
                taken, in_others = time.perf_counter() - begin, self._within.pop()
                self.seconds[stage] = self.seconds.get(stage, 0.0) + taken - in_others
                self.calls[stage] = self.calls.get(stage, 0) + 1
                if self._within:
                    self._within[-1] += taken

        return measured

    @contextmanager
    def on(self, stages: Mapping[str, tuple[str, ...]], package: str) -> Iterator[None]:
        """Time the functions of stages meanwhile.

        Args:
            stages: by name; their functions as "module:function" or "module:class.method", generators not among them.
            package: whose modules use the functions.
        """
        modules = [module for name, module in list(sys.modules.items()) if name.split(".")[0] == package]
        uses = [(stage, use) for stage, places in stages.items() for place in places for use in _uses(place, modules)]
        try:
            for stage, (user, name, function) in uses:
                setattr(user, name, self.timed(stage, function))
            yield
        finally:
            for _, (user, name, function) in uses:
                setattr(user, name, function)


def _uses(place: str, modules: Sequence[Any]) -> list[tuple[Any, str, Callable[..., Any]]]:
    """Where the function of a place is used, by which name, and the function: a method in its class alone."""
    module, _, name = place.partition(":")
    holder, _, attribute = name.rpartition(".")
    owner = getattr(sys.modules[module], holder) if holder else sys.modules[module]
    function = getattr(owner, attribute)
    users = [owner] if holder else modules
    return [(user, known, function) for user in users for known, value in vars(user).items() if value is function]
