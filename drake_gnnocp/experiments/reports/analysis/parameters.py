"""The parameters that are varied, one at a time, and the method that plans with each of their values.

What belongs to the solver is varied with the guess of the network and with that of Hybrid A*. Networks that differ in
their number of points or in what they were trained on are trained equally long each, so they are compared with one of
the default size and on all data that was trained as long (`BASE`), and not with the one that comes with the package.
They plan as usual, and directly: the first hypothesis goes to Ipopt without convex steps before it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from drake_gnnocp.experiments.benchmark.methods import GNN, GNN_DIRECT, HYBRID_ASTAR, Method, direct
from drake_gnnocp.guesses.sources import GuessOptions
from drake_gnnocp.planner.planner import PlanOptions

BASE = "ablation_base"  # 30 points, all training maps
POINTS = {30.0: BASE, 60.0: "points_60", 120.0: "points_120"}  # folders of trainings
SHARES = {10.0: "share_10", 30.0: "share_30", 100.0: BASE}
HYPOTHESES = (1, 2, 4, 8, 12)
KNOTS = (40, 60, 90, 120, 180, 240)
LAMBDA2 = (0.0, 0.3, 1.0, 3.0, 10.0)
GAMMA = (1.02, 1.05, 1.1, 1.2, 1.5)
DEFAULTS = PlanOptions()

Change = Callable[[PlanOptions, float], PlanOptions]


@dataclass(frozen=True)
class Point:
    """One value of a parameter, with one source of guesses."""

    value: float
    series: str  # which of the parameter's curves it is on: the source of guesses, or GNN_DIRECT
    method: Method


@dataclass(frozen=True)
class Parameter:
    """A parameter with all points of its curves."""

    name: str
    label: str  # in print
    default: float
    points: tuple[Point, ...]
    changes_cost: bool = False  # whether J means something else at every value


def parameters(training: Path, weights: Path | None = None) -> dict[str, Parameter]:
    """All parameters by name.

    Args:
        training: folder that holds those of the trained networks.
        weights: of the network where it is not what is varied; None: those that come with the package.
    """
    default_weights = DEFAULTS.refine.problem.weights
    usual = replace(DEFAULTS, guess=GuessOptions(weights=weights))
    both = (GNN, HYBRID_ASTAR)
    found = [
        Parameter("points", "predicted points", 30.0, _networks(POINTS, training)),
        Parameter(
            "hypotheses",
            "hypotheses looked at",
            DEFAULTS.hypotheses,
            _points("hypotheses", HYPOTHESES, DEFAULTS.hypotheses, _hypotheses, usual, (GNN,)),
        ),
        Parameter("share", "share of the training maps [%]", 100.0, _networks(SHARES, training)),
        Parameter(
            "knots",
            "knots of the optimal control problem",
            DEFAULTS.guess.n_knots,
            _points("knots", KNOTS, DEFAULTS.guess.n_knots, _knots, usual, both),
        ),
        Parameter(
            "lambda2",
            "λ2",
            default_weights.lambda2,
            _points("lambda2", LAMBDA2, default_weights.lambda2, _lambda2, usual, both),
            changes_cost=True,
        ),
        Parameter(
            "gamma",
            "γ",
            default_weights.gamma,
            _points("gamma", GAMMA, default_weights.gamma, _gamma, usual, both),
            changes_cost=True,
        ),
    ]
    return {each.name: each for each in found}


def _networks(folders: dict[float, str], training: Path) -> tuple[Point, ...]:
    """Networks as they were trained, by the value in which they differ."""
    points = []
    for value, folder in folders.items():
        options = replace(DEFAULTS, guess=GuessOptions(weights=training / folder / "best.pt"))
        points.append(Point(value, GNN, Method(folder, GNN, options)))
        points.append(Point(value, GNN_DIRECT, Method(f"{folder} direct", GNN, direct(options))))
    return tuple(points)


def _points(
    name: str, values: tuple[float, ...], default: float, change: Change, usual: PlanOptions, kinds: tuple[str, ...]
) -> tuple[Point, ...]:
    """Points of the planner's own options; at the default value all parameters share one method."""
    return tuple(
        Point(value, kind, Method(f"{kind} default" if value == default else f"{kind} {name} {value:g}", kind, options))
        for kind in kinds
        for value in values
        for options in [change(usual, value)]
    )


def _hypotheses(options: PlanOptions, value: float) -> PlanOptions:
    return replace(options, hypotheses=int(value))


def _knots(options: PlanOptions, value: float) -> PlanOptions:
    return replace(options, guess=replace(options.guess, n_knots=int(value)))


def _lambda2(options: PlanOptions, value: float) -> PlanOptions:
    return _with_weight(options, lambda2=value)


def _gamma(options: PlanOptions, value: float) -> PlanOptions:
    return _with_weight(options, gamma=value)


def _with_weight(options: PlanOptions, **change: float) -> PlanOptions:
    problem = options.refine.problem
    problem = replace(problem, weights=replace(problem.weights, **change))
    return replace(options, refine=replace(options.refine, problem=problem))
