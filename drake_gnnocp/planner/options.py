"""What a user may set of a plan, and the sources of guesses by their names."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import nullcontext, suppress
from dataclasses import dataclass, field
from pathlib import Path

from drake_gnnocp.guesses import GuessSource, GuessUnavailable, HybridAStar, Learned, RrtStar, Straight
from drake_gnnocp.ocp.costs import CostWeights
from drake_gnnocp.search.hybrid_astar import HybridAStarOptions

FEWEST_KNOTS = 4  # of a plan: rest, drive, rest


@dataclass(frozen=True)
class PlanOptions:
    """How to plan.

    Raises:
        ValueError: a number is not one that can be planned with; the message names it.
    """

    knots: int = 120  # of a plan; more where a path has so many gear changes that they would be too far apart in time
    margin: float = 0.1  # m, clearance asked of obstacles at the knots, where the guess has it
    cost: CostWeights = field(default_factory=CostWeights)
    slack: float = 1.1  # duration given to the optimiser over that of a searched path
    weights: Path | None = None  # file of the network's weights; None: those that come with the package
    hypotheses: int = 12  # of the network, the most promising: those that SQP steps converge from are solved
    search: HybridAStarOptions = field(default_factory=HybridAStarOptions)
    seed: int = 0  # of RRT*
    sqp: bool = True  # whether SQP steps are taken before Ipopt
    most_attempts: int | None = None  # None: all there are

    def __post_init__(self) -> None:
        for name, least in (("knots", FEWEST_KNOTS), ("hypotheses", 1), ("most_attempts", 1)):
            value = getattr(self, name)
            if name == "most_attempts" and value is None:
                continue
            if isinstance(value, bool) or not isinstance(value, int) or value < least:
                raise ValueError(f"options.{name}: must be a whole number of {least} or more, not {value!r}")
        for name, lowest in (("margin", 0.0), ("slack", 1.0)):
            value = getattr(self, name)
            if not isinstance(value, int | float) or not lowest <= value < math.inf:
                raise ValueError(f"options.{name}: must be a number of {lowest:g} or more, not {value!r}")


AUTO = "auto"
SOURCES: dict[str, Callable[[PlanOptions], GuessSource]] = {
    "gnn": lambda options: Learned(options.knots, options.weights, options.hypotheses),
    "hybrid_astar": lambda options: HybridAStar(options.knots, options.search),
    "rrt_star": lambda options: RrtStar(options.knots, options.seed),
    "straight": lambda options: Straight(options.knots),
}
GUESSES = (AUTO, *SOURCES)


def source_named(name: str, options: PlanOptions) -> GuessSource | None:
    """The source of guesses with a name, ready for use; None for "auto".

    Raises:
        GuessUnavailable: an unknown name, or a source that needs what is not there ("auto" needs no weights but those
            named).
    """
    if name not in GUESSES:
        raise GuessUnavailable(f"guess: must be one of {', '.join(GUESSES)}, not {name!r}")
    if name == AUTO:
        with suppress(GuessUnavailable) if options.weights is None else nullcontext():
            SOURCES["gnn"](options).check_available()
        return None
    source = SOURCES[name](options)
    source.check_available()
    return source
