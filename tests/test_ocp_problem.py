"""The pieces of the optimal control problem: gradients, defects, rows."""

from collections.abc import Callable

import numpy as np
import pytest
from pydrake.autodiffutils import ExtractGradient, InitializeAutoDiff
from pydrake.planning import DirectCollocationConstraint
from pydrake.solvers import BoundingBoxConstraint, MathematicalProgram
from pydrake.symbolic import Variable, cos, sin, tan
from pydrake.systems.primitives import SymbolicVectorSystem

from drake_gnnocp import Scenario, Trajectory, Vehicle
from drake_gnnocp.ocp.cost import CostWeights, add_cost, evaluate_cost, proximity
from drake_gnnocp.ocp.dynamics import add_dynamics, defects
from drake_gnnocp.ocp.problem import ProblemOptions, build, unpack
from drake_gnnocp.ocp.rings import ConvexRings
from drake_gnnocp.ocp.separating_line import Separation, add_separating_line, best_normal
from drake_gnnocp.ocp.sparsity import jacobian_sparsity
from drake_gnnocp.ocp.triangle_area import excess_area, near_rows, row_values
from drake_gnnocp.ocp.variables import add_variables
from drake_gnnocp.ocp.workspace import add_workspace

# central differences with this step are good to its square times the third derivative, and to 1e-16 / step
DIFFERENCE_STEP = 1e-6
GRADIENT_TOLERANCE = 1e-7  # relative to the largest entry
EXACT = 1e-12  # two ways of computing the same number

SQUARE = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])
TRIANGLE = np.array([[4.0, -1.0], [6.0, 0.0], [4.5, 2.0]])


def central_differences(function: Callable[[np.ndarray], np.ndarray], x: np.ndarray) -> np.ndarray:
    columns = []
    for i in range(len(x)):
        step = np.zeros(len(x))
        step[i] = DIFFERENCE_STEP
        columns.append((function(x + step) - function(x - step)) / (2 * DIFFERENCE_STEP))
    return np.stack(columns, axis=-1)


def assert_gradients_match(program: MathematicalProgram, point: np.ndarray) -> None:
    """All constraints and costs: the Jacobian against differences, and no entry outside the declared pattern."""
    for binding in [*program.generic_constraints(), *program.generic_costs()]:
        evaluator = binding.evaluator()
        x = point[program.FindDecisionVariableIndices(binding.variables())]
        jacobian = ExtractGradient(evaluator.Eval(InitializeAutoDiff(x).ravel()))
        expected = central_differences(evaluator.Eval, x)
        scale = max(1.0, np.abs(expected).max())
        assert np.abs(jacobian - expected).max() <= GRADIENT_TOLERANCE * scale, evaluator.get_description()
        pattern = evaluator.gradient_sparsity_pattern()
        if pattern is not None:
            outside = np.ones_like(jacobian, dtype=bool)
            outside[tuple(np.array(pattern).T)] = False
            assert np.abs(jacobian[outside]).max(initial=0.0) == 0.0


def wavy_guess(n: int = 12, seed: int = 0) -> Trajectory:
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 6.0, n)
    states = np.column_stack([t * 1.2, 0.3 * t, 0.2 + 0.1 * t, 1 + 0.1 * t, 0.05 * t]) + rng.normal(0, 0.1, (n, 5))
    return Trajectory(t, states, rng.normal(0, 0.2, (n, 2)))


@pytest.mark.parametrize("free_horizon", [False, True])
def test_gradients_of_a_whole_program_match_central_differences(free_horizon: bool) -> None:
    guess = wavy_guess()
    scenario = Scenario(
        "gradients",
        start=guess.poses[0],
        goal=guess.poses[-1],
        obstacles=(SQUARE + [1.0, 3.5], TRIANGLE + [0.0, -3.5]),
        bounds=(-3.0, 13.0, -5.0, 8.0),
    )
    separations = [Separation(4, scenario.convex_obstacles[0], 0.02)]
    options = ProblemOptions(free_horizon=free_horizon, near=4.0)
    problem = build(scenario, guess, separations, options)
    descriptions = " ".join(b.evaluator().get_description() for b in problem.program.generic_constraints())
    for kind in ("dynamics", "triangle areas", "separating line", "bound"):
        assert kind in descriptions
    point = problem.guess + np.random.default_rng(1).normal(0, 1e-4, len(problem.guess))
    assert_gradients_match(problem.program, point)


@pytest.fixture(scope="module")
def drake_constraint() -> DirectCollocationConstraint:
    x, u = [Variable(f"x{i}") for i in range(5)], [Variable(f"u{i}") for i in range(2)]
    rates = [x[3] * cos(x[2]), x[3] * sin(x[2]), x[3] * tan(x[4]) / Vehicle().wheelbase, u[0], u[1]]
    system = SymbolicVectorSystem(state=x, input=u, dynamics=rates, output=x)
    return DirectCollocationConstraint(system, system.CreateDefaultContext())


def test_defects_are_those_of_drakes_direct_collocation(drake_constraint: DirectCollocationConstraint) -> None:
    rng = np.random.default_rng(2)
    for _ in range(20):
        h, knots = rng.uniform(0.1, 0.5), rng.normal(0, 0.5, (2, 7))
        theirs = drake_constraint.Eval(np.concatenate([[h], knots[0, :5], knots[1, :5], knots[0, 5:], knots[1, 5:]]))
        ours = defects(knots, h, Vehicle().wheelbase)[0][0]
        np.testing.assert_allclose(ours, 2 * h / 3 * theirs, atol=EXACT)


def test_trapezoid_rows_of_a_fixed_horizon_are_the_defects_of_v_and_phi() -> None:
    guess = wavy_guess(5)
    program = MathematicalProgram()
    h = guess.duration / 4
    variables = add_variables(program, 5, h, free_horizon=False)
    add_dynamics(program, variables, Vehicle())
    knots = np.hstack([guess.states, guess.inputs])
    program.SetInitialGuess(variables.knots, knots / [100, 100, 100, 100, 100, 1, 1])
    rows = [
        binding.evaluator().Eval(program.GetInitialGuess(binding.variables()))[0]
        for binding in program.linear_equality_constraints()
    ]
    expected = defects(knots, h, Vehicle().wheelbase)[0][:, 3:]
    np.testing.assert_allclose(np.reshape(rows, (2, 4)).T * 100, expected, atol=EXACT)


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


def test_pairs_within_are_those_whose_boxes_are_near() -> None:
    rng = np.random.default_rng(5)
    obstacles = [SQUARE + rng.uniform(-20, 20, 2) for _ in range(10)] + [TRIANGLE + rng.uniform(-20, 20, 2)]
    footprints = Vehicle().footprints(rng.uniform([-20, -20, -3], [20, 20, 3], (30, 3)))
    found = set(zip(*ConvexRings.of(obstacles).pairs_within(footprints, near=2.0), strict=True))
    expected = set()
    for k, car in enumerate(footprints):
        for j, ring in enumerate(obstacles):
            gaps = [ring.min(axis=0) - car.max(axis=0), car.min(axis=0) - ring.max(axis=0)]
            if np.max(gaps) < 2.0 and 0 < k < len(footprints) - 1:
                expected.add((k, j))
    assert found == expected and len(found) > 5


def test_obstacles_of_unlike_numbers_of_vertices_have_the_rows_that_each_has_alone() -> None:
    poses = np.column_stack([np.linspace(-4, 4, 9), np.full(9, -2.0), np.linspace(0, 2, 9)])
    hexagon = 1.5 * np.array([[np.cos(a), np.sin(a)] for a in np.pi / 3 * np.arange(6)]) + [-1.0, -6.0]
    obstacles = (SQUARE, TRIANGLE + [4.0, -4.0], hexagon)
    alone = [near_rows(poses, ConvexRings.of((ring,)), Vehicle(), near=3.0) for ring in obstacles]
    together = near_rows(poses, ConvexRings.of(obstacles), Vehicle(), near=3.0)
    keys = [sorted(zip(r.knot, *r.point.T, r.is_car, r.distance, r.length, strict=True)) for r in (*alone, together)]
    assert len(together) > 20
    assert np.allclose(sorted(sum(keys[:-1], [])), keys[-1], rtol=0, atol=EXACT)


def test_near_rows_leave_out_what_is_far_and_the_fixed_ends() -> None:
    poses = np.column_stack([np.linspace(0, 30, 31), np.zeros(31), np.zeros(31)])
    ring = SQUARE + [14.0, 2.0]
    rows = near_rows(poses, ConvexRings.of((ring,)), Vehicle(), near=2.0)
    assert len(rows) > 0
    footprints = Vehicle().footprints(poses[rows.knot])
    along = np.maximum(ring[:, 0].min() - footprints[..., 0].max(1), footprints[..., 0].min(1) - ring[:, 0].max())
    assert along.max() < 2.0
    everywhere = near_rows(poses, ConvexRings.of((ring,)), Vehicle(), near=100.0)
    assert set(everywhere.knot) == set(range(1, 30))
    assert np.bincount(everywhere.knot).max() <= 4


def test_rows_see_the_nearest_corner_at_its_distance() -> None:
    vehicle, pose = Vehicle(), np.array([[0.0, 0.0, 0.0]] * 3)
    ring = SQUARE + [vehicle.corners[1, 0] + 0.5, -1.0]  # half a metre ahead of the front bumper
    rows = near_rows(pose, ConvexRings.of((ring,)), vehicle, near=2.0)
    excess, _ = row_values(rows, pose[rows.knot])
    assert np.min(excess / rows.length) == pytest.approx(0.5, abs=EXACT)


@pytest.mark.parametrize(
    ("offset", "distance"), [((5.0, 0.0), 3.0), ((0.0, -2.5), 0.5), ((0.5, 0.2), -1.5), ((3.0, 4.0), np.sqrt(5.0))]
)
def test_best_normal_is_the_distance_of_two_squares(offset: tuple[float, float], distance: float) -> None:
    alpha, beta, found = best_normal(SQUARE + offset, SQUARE)
    assert found == pytest.approx(distance, abs=EXACT)
    n = np.array([np.cos(alpha), np.sin(alpha)])
    assert ((SQUARE + offset) @ n).min() - beta == pytest.approx(distance / 2, abs=EXACT)
    assert beta - (SQUARE @ n).max() == pytest.approx(distance / 2, abs=EXACT)


def test_a_separating_line_of_a_clear_pair_holds_at_its_guess() -> None:
    program = MathematicalProgram()
    variables = add_variables(program, 2, 0.1, free_horizon=False)
    poses = np.array([[0.0, 0.0, 0.0], [0.2, 0.0, 0.1]])
    ring = SQUARE + [0.0, 1.5]
    line = add_separating_line(program, variables, Vehicle(), Separation(0, ring, 0.1), poses)
    binding = program.generic_constraints()[0]
    program.SetInitialGuess(variables.knots[:, :3], poses / 100)
    assert not np.isnan(program.GetInitialGuess(line)).any()
    assert binding.evaluator().CheckSatisfied(program.GetInitialGuess(binding.variables()), 1e-9)


def test_workspace_rows_are_distances_of_the_corners_to_the_sides() -> None:
    program = MathematicalProgram()
    vehicle, bounds = Vehicle(), (-3.0, 8.0, -4.0, 5.0)
    variables = add_variables(program, 3, 0.1, free_horizon=False)
    poses = np.array([[0.0, 0.0, 0.0], [1.0, 0.5, 0.3], [2.0, 1.0, 0.0]])
    add_workspace(program, variables, vehicle, bounds, poses, near=100.0, margin=0.02)
    program.SetInitialGuess(variables.knots[:, :3], poses / 100)
    corners = vehicle.footprints(poses[1:2])[0]
    expected = {
        "bound xmin": corners[:, 0] + 3.0,
        "bound xmax": 8.0 - corners[:, 0],
        "bound ymin": corners[:, 1] + 4.0,
        "bound ymax": 5.0 - corners[:, 1],
    }
    for binding in program.generic_constraints():
        values = binding.evaluator().Eval(program.GetInitialGuess(binding.variables()))
        np.testing.assert_allclose(values, expected.pop(binding.evaluator().get_description()), atol=EXACT)
        np.testing.assert_array_equal(binding.evaluator().lower_bound(), 0.02)
    assert not expected


def test_costs_of_the_program_are_the_papers_sums() -> None:
    guess, weights = wavy_guess(), CostWeights(lambda1=0.7, lambda2=1.3, gamma=1.2)
    centroids = np.array([[2.0, 1.0], [5.0, -1.0]])
    inputs = guess.inputs.copy()
    inputs[[0, -1]] = 0.0
    guess = Trajectory(guess.t, guess.states, inputs)
    h = guess.t[1] - guess.t[0]
    j1 = sum(h * (a * a + w * w) for a, w in inputs)
    j2 = sum(h * 1.2 ** -((x - cx) ** 2 + (y - cy) ** 2) for x, y in guess.poses[:, :2] for cx, cy in centroids)
    cost = evaluate_cost(guess, centroids, weights)
    assert (cost.J1, cost.J2) == (pytest.approx(j1), pytest.approx(j2))
    assert cost.J == pytest.approx(0.7 * j1 + 1.3 * j2)

    program = MathematicalProgram()
    variables = add_variables(program, len(guess), h, free_horizon=False)
    add_cost(program, variables, centroids, weights)
    program.SetInitialGuess(variables.knots, np.hstack([guess.states, guess.inputs]) / [100, 100, 100, 100, 100, 1, 1])
    total = sum(b.evaluator().Eval(program.GetInitialGuess(b.variables()))[0] for b in program.GetAllCosts())
    fixed_ends = 1.3 * h * proximity(guess.poses[[0, -1], :2], centroids, 1.2)[0].sum()
    assert total + fixed_ends == pytest.approx(cost.J)


def test_unpack_gives_the_guess_back() -> None:
    guess = wavy_guess()
    scenario = Scenario("round trip", guess.poses[0], guess.poses[-1])
    for free_horizon in (False, True):
        problem = build(scenario, guess, [], ProblemOptions(free_horizon=free_horizon))
        trajectory = unpack(problem, problem.guess)
        np.testing.assert_allclose(trajectory.t, guess.t, atol=EXACT)
        np.testing.assert_allclose(trajectory.states, guess.states, atol=EXACT)
        np.testing.assert_allclose(trajectory.inputs, guess.inputs, atol=EXACT)


# --- the program as a whole ---


def test_the_sparsity_of_the_jacobian_has_the_rows_and_columns_of_its_constraints() -> None:
    scenario = Scenario("one block", np.zeros(3), np.array([8.0, 2.0, 0.8]), (SQUARE + [3.0, 3.0],))
    problem = build(scenario, wavy_guess(), [Separation(4, SQUARE + [3.0, 3.0], 0.02)], ProblemOptions())
    program = problem.program
    pattern = np.zeros((problem.n_rows, program.num_vars()), dtype=bool)
    for block in jacobian_sparsity(program):
        pattern[block.rows, block.columns] = True
    x = problem.guess + np.random.default_rng(0).normal(0, 1e-3, program.num_vars())
    first = 0
    for binding in program.GetAllConstraints():
        if isinstance(binding.evaluator(), BoundingBoxConstraint):
            continue
        index = program.FindDecisionVariableIndices(binding.variables())
        values = ExtractGradient(binding.evaluator().Eval(InitializeAutoDiff(x[index]).ravel()))
        used = np.zeros((len(values), program.num_vars()), dtype=bool)
        used[:, index] = values != 0
        rows = pattern[first : first + len(values)]
        assert not used[~rows].any() and rows.any(axis=1).all()
        first += len(values)
    assert first == problem.n_rows


def test_the_scale_of_the_states_changes_the_program_and_not_the_problem() -> None:
    scenario = Scenario("one block", np.zeros(3), np.array([8.0, 2.0, 0.8]), (SQUARE + [3.0, 3.0],), (-3, 12, -4, 9))
    lines = [Separation(4, SQUARE + [3.0, 3.0], 0.02)]
    programs = [build(scenario, wavy_guess(), lines, ProblemOptions(state_scale=scale)) for scale in (1.0, 100.0)]
    values = []
    for problem in programs:
        guess = problem.guess
        np.testing.assert_allclose(unpack(problem, guess).states, wavy_guess().states, rtol=EXACT, atol=EXACT)
        generic = problem.program.generic_constraints()
        values.append([problem.program.EvalBinding(each, guess) for each in generic])
        values[-1] += [problem.program.EvalBinding(each, guess) for each in problem.program.GetAllCosts()]
    for unscaled, scaled in zip(*values, strict=True):
        np.testing.assert_allclose(unscaled, scaled, rtol=1e-9, atol=1e-9)
