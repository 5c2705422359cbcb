"""Half planes, the obstacles of the quadratic programs, against shapely's distances."""

from dataclasses import dataclass

import numpy as np
import pytest
import shapely

from drake_gnnocp import Scenario, Trajectory, Vehicle
from drake_gnnocp.ocp.costs import CostWeights
from drake_gnnocp.ocp.formulation import Formulation, formulate
from drake_gnnocp.ocp.half_planes import half_planes

DIFFERENCE_STEP = 1e-6
GRADIENT_TOLERANCE = 1e-7  # central differences with this step are good to 1e-9 here
EXACT = 1e-12  # two ways of computing the same number
VEHICLE = Vehicle()
FRONT = VEHICLE.wheelbase + VEHICLE.front_hang
SQUARE = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]])
TRIANGLE = np.array([[7.0, -4.0], [9.0, -3.0], [7.5, -1.0]])


@dataclass(frozen=True)
class Planes:
    """The rows of a formulation at some poses: two of each of G planes."""

    knot: np.ndarray  # (G,)
    value: np.ndarray  # (G, 2) [m]
    gradient: np.ndarray  # (G, 2, 3)
    lower: np.ndarray  # (G, 2) [m]


def among(*rings: np.ndarray) -> Formulation:
    """A problem among obstacles that start and goal are far from."""
    scenario = Scenario("among", np.array([-90.0, 0.0, 0.0]), np.array([90.0, 0.0, 0.0]), rings)
    reference = Trajectory(np.arange(2.0), np.zeros((2, 5)), np.zeros((2, 2)))
    return formulate(scenario, reference, CostWeights(), margin=0.1)


def planes_at(poses: np.ndarray, formulation: Formulation) -> Planes:
    """The rows at poses (N, 3), between two more that have none."""
    far = np.array([[-90.0, 0.0, 0.0]])
    (block,) = half_planes(formulation, np.concatenate([far, poses, -far]))
    value, entries = block.function(np.concatenate([far, poses, -far])[block.knots].ravel())
    knot = block.knots[block.columns.reshape(-1, 2, 3)[:, 0, 0] // 3] - 1
    return Planes(knot, value.reshape(-1, 2), entries.reshape(-1, 2, 3), block.lower.reshape(-1, 2))


def distances(poses: np.ndarray, ring: np.ndarray) -> np.ndarray:
    """Distances of the car from a polygon at poses (N, 3): (N,) [m]."""
    found: np.ndarray = shapely.distance(shapely.polygons(VEHICLE.footprints(poses)), shapely.Polygon(ring))
    return found


def test_gradients_are_those_of_the_distance_along_axes_that_are_chosen_anew() -> None:
    formulation = among(SQUARE, TRIANGLE)
    poses = np.random.default_rng(0).uniform([-6.0, -8.0, -3.0], [12.0, 8.0, 3.0], (300, 3))
    compared = 0
    for pose in poses:
        if not 0.05 < min(distances(pose, SQUARE)[0], distances(pose, TRIANGLE)[0]) < 0.5:  # an axis changes at 0
            continue
        found, compared = planes_at(pose[None], formulation), compared + 1
        for column, step in enumerate(DIFFERENCE_STEP * np.eye(3)):
            ahead, behind = planes_at(pose[None] + step, formulation), planes_at(pose[None] - step, formulation)
            difference = (ahead.value - behind.value) / (2 * DIFFERENCE_STEP)
            assert np.abs(difference - found.gradient[..., column]).max() <= GRADIENT_TOLERANCE
    assert compared > 20


def test_the_least_value_is_the_distance_where_a_side_faces_the_obstacle() -> None:
    formulation, faced = among(SQUARE), 0
    for pose in np.random.default_rng(1).uniform([-6.0, -4.0, -3.0], [8.0, 8.0, 3.0], (200, 3)):
        distance = distances(pose, SQUARE)[0]
        if not 0 < distance < 0.6:
            continue
        least = planes_at(pose[None], formulation).value.min()
        assert least <= distance + EXACT
        assert least >= distance / np.sqrt(2) - EXACT  # two vertices face: an axis is at most 45 degrees off
        faced += least >= distance - EXACT
    assert faced > 10


def test_an_overlap_is_negative_by_the_least_way_out() -> None:
    pose = np.array([[4.0 + VEHICLE.rear_hang - 0.3, 2.0, 0.0]])  # 0.3 m into the right edge
    found = planes_at(pose, among(SQUARE))
    assert found.value.min() == pytest.approx(-0.3, abs=EXACT)
    np.testing.assert_allclose(found.gradient[..., :2], np.broadcast_to([1.0, 0.0], (1, 2, 2)), atol=EXACT)


def test_knots_of_one_visit_are_sent_to_the_same_side() -> None:
    x = np.linspace(-12.0, 12.0, 60)
    poses = np.column_stack([x, np.full(60, 3.5), np.zeros(60)])  # over the square, nearer to its upper edge
    found = planes_at(poses, among(SQUARE))
    inside = found.value.min(axis=1) < 0
    assert set(found.knot[inside]) == set(np.flatnonzero(distances(poses, SQUARE) == 0))
    expected = np.broadcast_to([0.0, 1.0], (inside.sum(), 2, 2))
    np.testing.assert_allclose(found.gradient[inside][..., :2], expected, atol=EXACT)


def test_an_obstacle_between_two_clear_knots_gets_rows_that_send_both_to_one_side() -> None:
    post = np.array([[0.0, 0.0], [0.1, 0.0], [0.1, 0.1], [0.0, 0.1]])
    poses = np.array([[-FRONT - 0.05, 0.6, 0.0], [VEHICLE.rear_hang + 0.15, 0.6, 0.0]])
    assert distances(poses, post).min() == pytest.approx(0.05)
    found = planes_at(poses, among(post))
    swept = found.value.min(axis=1) < 0
    assert found.knot[swept].tolist() == [0, 1]
    np.testing.assert_allclose(found.gradient[swept][..., :2], np.broadcast_to([0.0, 1.0], (2, 2, 2)), atol=EXACT)
    assert 0 < found.lower[swept].max() < found.lower[~swept].min()


def test_a_post_beside_the_way_of_a_corner_is_seen_at_its_distance_from_the_swept_hull() -> None:
    poses = np.array([[0.0, 0.0, 0.0], [0.3, 0.3, 0.0]])  # the front right corner moves up at 45 degrees
    middle = VEHICLE.corners[1] + 0.15 + 0.05 * np.array([1.0, -1.0]) / np.sqrt(2)
    post = middle + np.array([[0.0, -0.02], [0.02, -0.02], [0.02, 0.0], [0.0, 0.0]])
    hull = shapely.convex_hull(shapely.multipoints(VEHICLE.footprints(poses).reshape(-1, 2)))
    assert hull.distance(shapely.Polygon(post)) == pytest.approx(0.05) and distances(poses, post).min() > 0.1
    assert planes_at(poses, among(post)).value.min() == pytest.approx(0.05, abs=EXACT)


def test_no_more_is_asked_than_an_obstacle_leaves_at_start_and_goal() -> None:
    poses = np.column_stack([np.linspace(0.0, 10.0, 5), np.zeros(5), np.zeros(5)])
    side = np.array([[-3.0, 1.0], [20.0, 1.0], [20.0, 2.0], [-3.0, 2.0]])  # 5 cm beside the car
    scenario = Scenario("beside a wall", poses[0], poses[-1], (side,))
    reference = Trajectory(np.arange(5.0), np.hstack([poses, np.zeros((5, 2))]), np.zeros((5, 2)))
    (block,) = half_planes(formulate(scenario, reference, CostWeights(), margin=0.1), poses)
    assert set(block.knots) == {1, 2, 3}
    assert block.lower.max() <= 0.05
