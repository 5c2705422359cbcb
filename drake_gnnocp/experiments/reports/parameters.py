"""The parameters that are varied, one at a time, and the method that plans with each of their values.

What belongs to the solver is varied with the guess of the network and with that of Hybrid A*. Networks that differ in
their number of points or in what they were trained on are trained equally long each, so they are compared with one of
the default size and on all data that was trained as long (`BASE`), and not with the one that comes with the package.
They plan as usual, and directly: the first hypothesis goes to Ipopt without SQP steps before it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from drake_gnnocp.experiments.benchmark.methods import (
    GNN,
    GNN_DIRECT,
    HYBRID_ASTAR,
    Method,
    default_of,
    method_named,
    network_method,
    varied,
)

BASE = "ablation_base"  # 30 points, all training maps
POINTS = {30.0: BASE, 60.0: "points_60", 120.0: "points_120"}  # folders of trainings
SHARES = {10.0: "share_10", 30.0: "share_30", 100.0: BASE}


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
    both = [replace(method_named(kind, weights=weights), name=f"{kind} default") for kind in (GNN, HYBRID_ASTAR)]
    found = [
        Parameter("points", "predicted points", 30.0, _networks(POINTS, training)),
        _varied("hypotheses", "hypotheses looked at", (1, 2, 4, 8, 12), both[:1]),
        Parameter("share", "share of the training maps [%]", 100.0, _networks(SHARES, training)),
        _varied("knots", "knots of the optimal control problem", (40, 60, 90, 120, 180, 240), both),
        _varied("lambda2", "λ2", (0.0, 0.3, 1.0, 3.0, 10.0), both, changes_cost=True),
        _varied("gamma", "γ", (1.02, 1.05, 1.1, 1.2, 1.5), both, changes_cost=True),
    ]
    return {parameter.name: parameter for parameter in found}


def _networks(folders: dict[float, str], training: Path) -> tuple[Point, ...]:
    """Networks as they were trained, by the value in which they differ."""
    points = []
    for value, folder in folders.items():
        file = training / folder / "best.safetensors"
        points.append(Point(value, GNN, network_method(folder, file, False)))
        points.append(Point(value, GNN_DIRECT, network_method(f"{folder} direct", file, True)))
    return tuple(points)


def _varied(
    name: str, label: str, values: Sequence[float], usual: Sequence[Method], changes_cost: bool = False
) -> Parameter:
    """A parameter of the planner's own options; at the default value all of these share one method."""
    default = default_of(name)
    points = []
    for method in usual:
        for value in values:
            other = replace(varied(method, name, value), name=f"{method.kind} {name} {value:g}")
            points.append(Point(value, method.kind, method if value == default else other))
    return Parameter(name, label, default, tuple(points), changes_cost)
