"""The rows of dynamics, triangle areas and boxes against independent computations."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from pydrake.planning import DirectCollocationConstraint
from pydrake.symbolic import Variable, cos, sin, tan
from pydrake.systems.primitives import SymbolicVectorSystem

from drake_gnnocp import Scenario, Trajectory, Vehicle
from drake_gnnocp.ocp.boxes import ends, limits, trust_region
from drake_gnnocp.ocp.costs import CostWeights
from drake_gnnocp.ocp.dynamics import POSE_ROWS, defects, dynamics
from drake_gnnocp.ocp.formulation import Formulation, formulate
from drake_gnnocp.ocp.obstacles import Obstacles
from drake_gnnocp.ocp.rows import N_STATES, RowBlock
from drake_gnnocp.ocp.triangle_areas import excess_area, row_values, rows_near, triangle_areas

EXACT = 1e-12  # two ways of computing the same number
VEHICLE = Vehicle()
SQUARE = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])
TRIANGLE = np.array([[4.0, -1.0], [6.0, 0.0], [4.5, 2.0]])


def among(poses: np.ndarray, *rings: np.ndarray, rows_within: float = 2.5, margin: float = 0.1) -> Formulation:
    """A problem with the reference at poses (N, 3), among obstacles that start and goal are far from."""
    n = len(poses)
    reference = Trajectory(np.arange(float(n)), np.hstack([poses, np.zeros((n, 2))]), np.zeros((n, 2)))
    scenario = Scenario("among", np.array([-90.0, 0.0, 0.0]), np.array([90.0, 0.0, 0.0]), rings)
    return replace(formulate(scenario, reference, CostWeights(), margin), rows_within=rows_within)


def values_of(blocks: list[RowBlock], formulation: Formulation) -> np.ndarray:
    """The values of all blocks at the reference."""
    knots, step = formulation.knots, formulation.step
    return np.concatenate([block.function(block.numbers(knots, step))[0] for block in blocks])


# --- dynamics ---


@pytest.fixture(scope="module")
def drake_constraint() -> DirectCollocationConstraint:
    x, u = [Variable(f"x{i}") for i in range(5)], [Variable(f"u{i}") for i in range(2)]
    rates = [x[3] * cos(x[2]), x[3] * sin(x[2]), x[3] * tan(x[4]) / VEHICLE.wheelbase, u[0], u[1]]
    system = SymbolicVectorSystem(state=x, input=u, dynamics=rates, output=x)
    return DirectCollocationConstraint(system, system.CreateDefaultContext())


def drakes_defects(constraint: DirectCollocationConstraint, knots: np.ndarray, h: float) -> np.ndarray:
    """Drake's defect of two knots (2, 7), times what makes it the one of Simpson's rule: (5,)."""
    first, second = knots
    return 2 * h / 3 * constraint.Eval(np.concatenate([[h], first[:5], second[:5], first[5:], second[5:]]))


def test_defects_are_those_of_drakes_direct_collocation(drake_constraint: DirectCollocationConstraint) -> None:
    rng = np.random.default_rng(2)
    for _ in range(20):
        h, knots = rng.uniform(0.1, 0.5), rng.normal(0, 0.5, (2, 7))
        theirs = drakes_defects(drake_constraint, knots, h)
        np.testing.assert_allclose(defects(knots, h, VEHICLE)[0][0], theirs, atol=EXACT)


@pytest.mark.parametrize(("states", "minimum_time"), [(POSE_ROWS, False), (N_STATES, False), (N_STATES, True)])
def test_rows_of_the_dynamics_are_the_defects_of_every_interval(
    states: int, minimum_time: bool, wavy: Formulation, drake_constraint: DirectCollocationConstraint
) -> None:
    blocks = dynamics(replace(wavy, minimum_time=minimum_time), states)
    pairs = zip(wavy.knots, wavy.knots[1:], strict=False)
    expected = [drakes_defects(drake_constraint, np.stack(pair), wavy.step)[:states] for pair in pairs]
    np.testing.assert_allclose(values_of(blocks, wavy), np.concatenate(expected), atol=EXACT)
    for block in blocks:
        assert not block.lower.any() and not block.upper.any()
        assert block.with_step == minimum_time


# --- triangle areas ---


def test_excess_area_is_edge_length_times_distance_and_zero_inside() -> None:
    points = np.array([[1.0, 1.0], [3.0, 1.0], [1.0, -0.5], [3.0, 3.0]])
    excess, _ = excess_area(points, np.broadcast_to(SQUARE, (4, 4, 2)))
    np.testing.assert_allclose(excess, [0.0, 2 * 1.0, 2 * 0.5, 2 * (1.0 + 1.0)], atol=EXACT)


def test_excess_area_equals_the_papers_sum_of_triangles_minus_the_polygon() -> None:
    rng = np.random.default_rng(3)
    points = rng.uniform(-1, 7, (50, 2))
    excess, _ = excess_area(points, np.broadcast_to(TRIANGLE, (50, 3, 2)))
    for point, value in zip(points, excess, strict=True):
        triangles = 0.0
        for a, b in zip(TRIANGLE, np.roll(TRIANGLE, -1, axis=0), strict=True):
            (ax, ay), (bx, by) = a - point, b - point
            triangles += 0.5 * abs(ax * by - ay * bx)
        (ax, ay), (bx, by) = TRIANGLE[1] - TRIANGLE[0], TRIANGLE[2] - TRIANGLE[0]
        assert value == pytest.approx(triangles - 0.5 * abs(ax * by - ay * bx), abs=EXACT)


@pytest.mark.parametrize("half", [1e-4, 0.01, 0.1])
@pytest.mark.parametrize("at", [(4.0, 0.3), (4.4, 1.5), (1.5, 1.35), (1.5, -1.35)])
def test_what_rows_ask_of_the_reference_is_its_distance_however_small_the_obstacle_is(
    half: float, at: tuple[float, float]
) -> None:
    near = np.array([0.0, 0.0, 0.0])
    ring = np.array(at) + half * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    distance = shapely.distance(shapely.Polygon(VEHICLE.footprints(near)[0]), shapely.Polygon(ring))
    for share, holds in ((0.99, True), (1.01, False)):
        margin = share * distance
        formulation = among(np.stack([near - [9, 0, 0], near, near + [9, 0, 0]]), ring, margin=margin)
        formulation = replace(formulation, reference_share=2.0)
        blocks = triangle_areas(formulation)
        lower = np.concatenate([block.lower for block in blocks])
        assert bool(np.all(values_of(blocks, formulation) >= lower)) == holds


def test_pairs_within_a_distance_are_those_whose_boxes_are() -> None:
    rng = np.random.default_rng(5)
    rings = [SQUARE + rng.uniform(-20, 20, 2) for _ in range(10)] + [TRIANGLE + rng.uniform(-20, 20, 2)]
    footprints = VEHICLE.footprints(rng.uniform([-20, -20, -3], [20, 20, 3], (30, 3)))
    pairs = Obstacles.of(rings).pairs_within(footprints, np.arange(30.0), distance=2.0)
    expected = set()
    for k, car in enumerate(footprints):
        for j, ring in enumerate(rings):
            apart = [ring.min(axis=0) - car.max(axis=0), car.min(axis=0) - ring.max(axis=0)]
            if np.max(apart) < 2.0 and 0 < k < len(footprints) - 1:
                expected.add((k, j))
    assert set(zip(pairs.knot, pairs.obstacle, strict=True)) == expected and len(expected) > 5


def test_obstacles_of_unlike_numbers_of_vertices_have_the_rows_that_each_has_alone() -> None:
    poses = np.column_stack([np.linspace(-4, 4, 9), np.full(9, -2.0), np.linspace(0, 2, 9)])
    hexagon = 1.5 * np.array([[np.cos(a), np.sin(a)] for a in np.pi / 3 * np.arange(6)]) + [-1.0, -6.0]
    rings = (SQUARE, TRIANGLE + [4.0, -4.0], hexagon)
    found = [rows_near(among(poses, *some, rows_within=3.0)) for some in (*((ring,) for ring in rings), rings)]
    keys = [sorted(zip(r.knot, *r.point.T, r.is_car, r.distance, r.length, strict=True)) for r in found]
    assert len(found[-1]) > 20
    assert np.allclose(sorted(sum(keys[:-1], [])), keys[-1], rtol=0, atol=EXACT)


def test_rows_leave_out_what_is_far_and_the_fixed_ends() -> None:
    poses = np.column_stack([np.linspace(0, 30, 31), np.zeros(31), np.zeros(31)])
    ring = SQUARE + [14.0, 2.0]
    rows = rows_near(among(poses, ring, rows_within=2.0))
    assert len(rows) > 0
    footprints = VEHICLE.footprints(poses[rows.knot])
    along = np.maximum(ring[:, 0].min() - footprints[..., 0].max(1), footprints[..., 0].min(1) - ring[:, 0].max())
    assert along.max() < 2.0
    everywhere = rows_near(among(poses, ring, rows_within=100.0))
    assert set(everywhere.knot) == set(range(1, 30))
    assert np.bincount(everywhere.knot).max() <= 4


def test_rows_see_the_nearest_corner_at_its_distance_and_ask_for_what_the_reference_has() -> None:
    poses = np.zeros((3, 3))
    ring = SQUARE + [VEHICLE.corners[1, 0] + 0.5, -1.0]  # half a metre ahead of the front bumper
    formulation = among(poses, ring)
    rows = rows_near(formulation)
    excess, _ = row_values(rows, poses[rows.knot])
    assert np.min(excess / rows.length) == pytest.approx(0.5, abs=EXACT)
    for margin, share, asked in ((0.1, 0.9, 0.1), (2.0, 0.9, 0.45), (2.0, 1.0, 0.5)):
        blocks = triangle_areas(replace(among(poses, ring, margin=margin), reference_share=share))
        values = values_of(blocks, formulation)
        lower = np.concatenate([block.lower for block in blocks])
        assert lower[np.argmin(values)] == pytest.approx(asked, abs=EXACT)


def test_bounds_have_rows_that_are_distances_of_the_corners_to_the_sides() -> None:
    poses = np.array([[0.0, 0.0, 0.0], [1.0, 0.5, 0.3], [2.0, 1.0, 0.0]])
    reference = Trajectory(np.arange(3.0), np.hstack([poses, np.zeros((3, 2))]), np.zeros((3, 2)))
    bounds = (-1.5, 6.2, -1.5, 3.0)
    scenario = Scenario("yard", poses[0], poses[-1], bounds=bounds)
    formulation = formulate(scenario, reference, CostWeights(), margin=0.1)
    rows = rows_near(formulation)
    found = row_values(rows, poses[rows.knot])[0] / rows.length
    corners, frame = VEHICLE.footprints(poses[1:2])[0], shapely.box(bounds[0], bounds[2], bounds[1], bounds[3])
    distances = [frame.exterior.distance(shapely.Point(corner)) for corner in corners]
    assert found[rows.is_car].min() == pytest.approx(min(distances), abs=EXACT)
    least = {
        tuple(key): found[(rows.obstacle == key[0]) & rows.is_car].min() for key in np.unique(rows.obstacle)[:, None]
    }
    x, y = corners.T
    expected = {(0,): x.min() + 1.5, (1,): 6.2 - x.max(), (2,): y.min() + 1.5, (3,): 3.0 - y.max()}
    assert least == pytest.approx(expected, abs=EXACT)


# --- boxes and margins ---


def test_limits_are_the_vehicles_less_the_margin_and_leave_the_ends_out(wavy: Formulation) -> None:
    vehicle = Vehicle(v_max=2.0, phi_max=0.6, a_max=1.5, w_max=0.4)
    box = limits(replace(wavy, vehicle=vehicle, limits_margin=0.1))
    assert box.knots.tolist() == list(range(1, 29)) and box.knot_columns.tolist() == [3, 4, 5, 6]
    np.testing.assert_allclose(box.upper, np.tile([1.8, 0.54, 1.35, 0.36], (28, 1)))
    np.testing.assert_array_equal(box.lower, -box.upper)


def test_the_trust_region_is_around_the_reference(wavy: Formulation) -> None:
    box = trust_region(replace(wavy, trust_region=(1.0, 2.0, 0.5)))
    assert box is not None and box.knots.tolist() == list(range(1, 29)) and box.knot_columns.tolist() == [0, 1, 2]
    poses = wavy.reference.poses[1:-1]
    np.testing.assert_allclose(box.upper - poses, np.tile([1.0, 2.0, 0.5], (28, 1)))
    np.testing.assert_allclose(poses - box.lower, np.tile([1.0, 2.0, 0.5], (28, 1)))
    assert trust_region(replace(wavy, trust_region=None)) is None


def test_the_ends_are_the_states_asked_for_without_inputs(wavy: Formulation) -> None:
    moving = replace(wavy, start=np.array([1.0, 2.0, 0.3, 0.5, -0.1]), goal=np.array([5.0, 4.0, 1.0, -0.4, 0.2]))
    for box, knot, state in zip(ends(moving), (0, -1), (moving.start, moving.goal), strict=True):
        assert box.knots.tolist() == [knot]
        np.testing.assert_array_equal(box.lower, [[*state, 0.0, 0.0]])
        np.testing.assert_array_equal(box.upper, box.lower)


def test_the_goals_heading_is_in_the_turn_in_which_the_reference_arrives() -> None:
    poses = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 3.0], [2.0, 0.0, 6.5]])
    assert among(poses).goal == pytest.approx([90.0, 0.0, 2 * np.pi, 0.0, 0.0])


def test_margins_yield_to_the_clearance_of_start_and_goal() -> None:
    poses, apart = np.column_stack([np.linspace(0, 10, 5), np.zeros(5), np.zeros(5)]), 0.02
    reference = Trajectory(np.arange(5.0), np.hstack([poses, np.zeros((5, 2))]), np.zeros((5, 2)))
    side = np.array([[-3.0, 0.0], [20.0, 0.0], [20.0, 1.0], [-3.0, 1.0]]) + [0.0, VEHICLE.width / 2 + apart]
    bounds = (-9.0, 30.0, -VEHICLE.width / 2 - apart, 9.0)
    scenario = Scenario("lane", poses[0], poses[-1], (side,), bounds)
    formulation = formulate(scenario, reference, CostWeights(), margin=0.1)
    np.testing.assert_allclose(formulation.end_clearances, apart, atol=EXACT)
    for asked in (formulation.least_margins, formulation.line_clearances):
        assert (0 < asked).all() and (asked < apart / 2).all()
    assert formulation.margins[0] == 0.1 and (formulation.margins[1:] < apart / 2).all()
