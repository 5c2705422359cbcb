"""Separating lines, and which pairs get them."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from drake_gnnocp import Scenario, Trajectory, Vehicle
from drake_gnnocp.ocp.close_pairs import close_pairs, overlapping_pairs
from drake_gnnocp.ocp.costs import CostWeights
from drake_gnnocp.ocp.formulation import Formulation, Line, formulate
from drake_gnnocp.ocp.separating_lines import best_normal, separating_lines
from drake_gnnocp.simulation import drive

EXACT = 1e-12  # two ways of computing the same number
VEHICLE = Vehicle()
SQUARE = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])
FRONT = VEHICLE.wheelbase + VEHICLE.front_hang


def ahead(*rings: np.ndarray, y: float = 0.0) -> Formulation:
    """Straight ahead by 8 m in 8 intervals of 1 s, first ever faster, then ever slower."""
    a = np.array([0.0, *np.full(3, 2 / 3), 0.0, *np.full(3, -2 / 3), 0.0])
    v = np.append(0.0, np.cumsum((a[1:] + a[:-1]) / 2))
    x = np.append(0.0, np.cumsum(v[:-1] + a[:-1] / 3 + a[1:] / 6))
    states, inputs = np.zeros((9, 5)), np.zeros((9, 2))
    states[:, 0], states[:, 1], states[:, 3], inputs[:, 0] = x, y, v, a
    scenario = Scenario("ahead", np.array([-90.0, y, 0.0]), np.array([90.0, y, 0.0]), rings)
    formulation = formulate(scenario, Trajectory(np.arange(9.0), states, inputs), CostWeights(), margin=0.1)
    return replace(formulation, start=states[0], goal=states[-1])


@pytest.mark.parametrize(
    ("offset", "distance"), [((5.0, 0.0), 3.0), ((0.0, -2.5), 0.5), ((0.5, 0.2), -1.5), ((3.0, 4.0), np.sqrt(5.0))]
)
def test_best_normal_is_the_distance_of_two_squares(offset: tuple[float, float], distance: float) -> None:
    alpha, beta, found = best_normal(SQUARE + offset, SQUARE)
    assert found == pytest.approx(distance, abs=EXACT)
    n = np.array([np.cos(alpha), np.sin(alpha)])
    assert ((SQUARE + offset) @ n).min() - beta == pytest.approx(distance / 2, abs=EXACT)
    assert beta - (SQUARE @ n).max() == pytest.approx(distance / 2, abs=EXACT)


def test_best_normal_is_the_distance_of_the_hulls_wherever_they_are_clear() -> None:
    rng, clear = np.random.default_rng(0), 0
    for _ in range(100):
        points = VEHICLE.footprints(
            rng.uniform([-3.0, -3.0, -3.0], [6.0, 6.0, 3.0], (1, 3)) + rng.normal(0, 0.2, (2, 3))
        )
        hull = shapely.convex_hull(shapely.multipoints(points.reshape(-1, 2)))
        distance = hull.distance(shapely.Polygon(SQUARE))
        found = best_normal(points.reshape(-1, 2), SQUARE)[2]
        clear += distance > 0
        assert found == pytest.approx(distance, abs=EXACT) if distance > 0 else found <= EXACT
    assert 20 < clear < 80


def test_a_line_keeps_the_corners_of_both_knots_and_the_obstacle_on_their_sides() -> None:
    ring = SQUARE + [5.0, 1.5]
    formulation = replace(ahead(ring), lines=(Line(2, 0, 0.1),))
    (block,) = separating_lines(formulation)
    assert block.knots.tolist() == [2, 3]
    values, _ = block.function(block.numbers(formulation.knots, formulation.step))
    (alpha, beta), corners = block.extra, VEHICLE.footprints(formulation.reference.poses[2:4]).reshape(-1, 2)
    n = np.array([np.cos(alpha), np.sin(alpha)])
    np.testing.assert_allclose(values[:8], corners @ n - beta, atol=EXACT)
    np.testing.assert_allclose(np.sort(values[8:]), np.sort(beta - ring @ n), atol=EXACT)  # in whatever order
    np.testing.assert_array_equal(block.lower, [0.1] * 8 + [0.0] * 4)
    assert (values >= block.lower).all()  # the pair is clear, and the line in the middle


def test_pairs_that_the_reference_overlaps_between_its_knots_are_found() -> None:
    formulation = ahead(SQUARE * 0.01 + [FRONT + 2.5, 0.0], SQUARE + [0.0, 5.0])
    x = formulation.reference.poses[:, 0]
    reached = (x[1:] + FRONT >= FRONT + 2.5) & (x[:-1] - VEHICLE.rear_hang <= FRONT + 2.52)
    assert overlapping_pairs(formulation) == [(k, 0) for k in np.flatnonzero(reached)]


def test_close_pairs_have_the_least_distance_of_each_interval() -> None:
    beside = SQUARE + [FRONT + 3.0, VEHICLE.width / 2 + 0.2]  # on the left, 0.2 m from the lane
    formulation = ahead(SQUARE + [0.0, 5.0], beside)
    motion = drive(np.zeros(3), formulation.reference, VEHICLE)
    found = close_pairs(replace(formulation, line_clearances=np.full(2, 0.4)), motion)
    x = formulation.reference.poses[:, 0]
    short = np.maximum(3.0 - x[1:], 0.0)  # of the obstacle's side, at the end of every interval
    expected = {(k, 1): np.hypot(short[k], 0.2) for k in range(8) if np.hypot(short[k], 0.2) <= 0.4}
    assert found == pytest.approx(expected, abs=1e-3)  # samples are up to 0.02 m apart along the way
    one_far = close_pairs(replace(formulation, line_clearances=np.array([9.0, 0.1])), motion)
    assert len(one_far) == 8 and {pair[1] for pair in one_far} == {0}  # every obstacle has its own distance


def test_the_distance_of_an_overlap_is_negative_by_the_penetration() -> None:
    side = SQUARE * [20.0, 1.0] + [-15.0, VEHICLE.width / 2 - 0.3]  # the car's left side is 0.3 m within it
    formulation = ahead(side)
    motion = drive(np.zeros(3), formulation.reference, VEHICLE)
    expected = {(k, 0): -0.3 for k in range(8)}
    assert close_pairs(replace(formulation, line_clearances=np.zeros(1)), motion) == pytest.approx(expected, abs=EXACT)
