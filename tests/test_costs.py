"""The cost of nearness depends on the free space, not on how obstacles are cut; the paper's counts obstacles."""

import math

import numpy as np
import pytest
import shapely

from drake_gnnocp import CostWeights, PlanOptions, Scenario, Trajectory, plan
from drake_gnnocp.ocp.costs import evaluate_cost, proximity

EXACT = 1e-3  # relative: of a sum over points against the integral, and of a wall of finite length
WALL = shapely.box(6.0, -4.0, 8.0, 0.5)


def scenario_with(*polygons: shapely.Polygon) -> Scenario:
    rings = tuple(np.array(polygon.exterior.coords[:-1]) for polygon in polygons)
    return Scenario("wall", np.zeros(3), np.array([16.0, 0.0, 0.0]), rings)


def cells(columns: int, rows: int, gap: float = 0.0) -> list[shapely.Polygon]:
    """The wall as a grid of boxes."""
    xs, ys = np.linspace(6.0, 8.0, columns + 1), np.linspace(-4.0, 0.5, rows + 1)
    return [
        shapely.box(x, y, next_x - gap * (i < columns - 1), next_y - gap * (j < rows - 1))
        for i, (x, next_x) in enumerate(zip(xs[:-1], xs[1:], strict=True))
        for j, (y, next_y) in enumerate(zip(ys[:-1], ys[1:], strict=True))
    ]


def passing() -> Trajectory:
    """Past the wall in a bow."""
    t = np.linspace(0.0, 10.0, 60)
    states = np.zeros((60, 5))
    states[:, 0], states[:, 1] = 1.6 * t, 2.5 * np.sin(np.pi * t / 10)
    return Trajectory(t, states, np.zeros((60, 2)))


@pytest.mark.parametrize("distance", [0.95, 1.5, 3.0])
def test_a_long_straight_wall_counts_by_its_distance_from_both_axles(distance: float) -> None:
    wall = shapely.box(-40.0, -distance - 1.0, 40.0, -distance)
    term = proximity(scenario_with(wall.buffer(-1e-3)), np.zeros((2, 3)), CostWeights(lambda2=1.0))
    sigma = 0.95
    far_side = math.exp(-((distance + 1.0) ** 2) / (2 * sigma**2))
    value = term.evaluate(np.zeros((1, 3)))[0][0]
    assert value == pytest.approx(2 * (math.exp(-(distance**2) / (2 * sigma**2)) + far_side), rel=5 * EXACT)


@pytest.mark.parametrize("pieces", [cells(1, 4), cells(5, 9), cells(4, 5, gap=0.02)], ids=["rows", "cells", "gaps"])
def test_how_a_wall_is_cut_makes_no_difference(pieces: list[shapely.Polygon]) -> None:
    whole, cut, weights = scenario_with(WALL), scenario_with(*pieces), CostWeights()
    assert evaluate_cost(passing(), cut, weights).J2 == pytest.approx(
        evaluate_cost(passing(), whole, weights).J2, rel=EXACT
    )
    paper = CostWeights.paper()
    assert evaluate_cost(passing(), cut, paper).J2 > 2 * evaluate_cost(passing(), whole, paper).J2


def test_a_wall_in_pieces_is_passed_as_the_whole_one() -> None:
    whole, cut = (plan(scenario_with(*pieces)) for pieces in ([WALL], cells(5, 9)))
    assert whole.verified and cut.verified and whole.cost is not None and cut.cost is not None
    assert cut.cost.J == pytest.approx(whole.cost.J, rel=EXACT)


def test_the_papers_cost_can_be_asked_for_by_its_name() -> None:
    options = PlanOptions(cost="paper")  # type: ignore[arg-type]
    assert options.cost == CostWeights.paper()
    with pytest.raises(ValueError, match="cost.definition: must be 'free space' or 'paper', not 'centroids'"):
        CostWeights(definition="centroids")
