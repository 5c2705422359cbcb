"""What a user may set of a plan, and the sources of guesses by their names."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext, suppress
from dataclasses import dataclass, field
from numbers import Integral, Real
from pathlib import Path

from drake_gnnocp.guesses import GuessSource, GuessUnavailable, HybridAStar, Learned, RrtStar, Straight
from drake_gnnocp.ocp.costs import PAPER, CostWeights
from drake_gnnocp.ocp.formulation import COMFORT
from drake_gnnocp.search.stages import HybridAStarOptions


@dataclass(frozen=True)
class PlanOptions:
    """How to plan.

    Raises:
        ValueError: a value is not a number of its range; the message names it.
    """

    knots: int = 120  # of a plan, at least 4; more where a path changes gear so often that they would be too far apart
    margin: float = 0.12  # m, clearance asked of obstacles at the knots, where the guess has it
    comfort: float = COMFORT  # m, clearance that a verified plan gets, by another solve, where it costs little; 0: none
    cost: CostWeights = field(default_factory=CostWeights)  # or "paper"
    slack: float = 1.1  # at least 1: duration given to the optimiser over that of a searched path
    weights: Path | None = None  # file of the network's weights; None: those that come with the package
    hypotheses: int = 12  # of the network, the most promising: those that SQP steps converge from are solved
    search: HybridAStarOptions = field(default_factory=HybridAStarOptions)
    seed: int = 0  # of RRT*
    sqp: bool = True  # whether SQP steps are taken before Ipopt
    most_attempts: int | None = None  # None: all there are

    def __post_init__(self) -> None:
        if self.cost == PAPER:
            object.__setattr__(self, "cost", CostWeights.paper())
        if self.weights is not None:
            object.__setattr__(self, "weights", Path(self.weights))  # which may be given as a text
        for name, least in LEAST_COUNTS.items():
            value = getattr(self, name)
            if name == "most_attempts" and value is None:
                continue
            if not isinstance(value, Integral) or isinstance(value, bool) or value < least:
                raise ValueError(f"options.{name}: must be a whole number of at least {least}, not {value!r}")
        for name, (low, high) in RANGES.items():
            value = getattr(self, name)
            if not isinstance(value, Real) or isinstance(value, bool) or not low <= float(value) <= high:
                raise ValueError(f"options.{name}: must be a number from {low:g} to {high:g}, not {value!r}")


LEAST_COUNTS = {"knots": 4, "hypotheses": 1, "seed": 0, "most_attempts": 1}
RANGES = {"margin": (0.0, 100.0), "comfort": (0.0, 100.0), "slack": (1.0, 100.0)}
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
