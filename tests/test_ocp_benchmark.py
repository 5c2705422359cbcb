"""The benchmark's tasks are reproducible, and its peers solve our problem."""

import math

import casadi as ca
import numpy as np
import pytest
import shapely

from drake_gnnocp import Scenario, Trajectory
from drake_gnnocp.experiments.benchmark.methods import CASADI, our_numbers, solver_named
from drake_gnnocp.experiments.benchmark.peers.casadi_peer import formulate
from drake_gnnocp.experiments.benchmark.peers.problem import PairRows, PeerProblem, peer_problem
from drake_gnnocp.experiments.benchmark.peers.tutorial import build_tutorial
from drake_gnnocp.experiments.tasks.open_maps import MapOptions, TaskOptions, random_obstacles, random_task
from drake_gnnocp.ocp.costs import CostWeights, evaluate_cost
from drake_gnnocp.ocp.dynamics import defects
from drake_gnnocp.verification import verify

EXACT = 1e-11  # two ways of computing the same number; areas cancel a few digits
N_TASKS = 12


# ---------------------------------------------------------------------------------------------------------------- maps


def test_a_task_is_the_same_whatever_is_drawn_besides() -> None:
    alone = random_task(3, 5).to_dict()
    assert [random_task(3, i).to_dict() for i in range(7)][5] == alone
    names = ("start", "obstacles")
    for other in (random_task(4, 5).to_dict(), random_task(3, 6).to_dict()):
        assert all(other[name] != alone[name] for name in names)


def test_tasks_keep_to_their_options() -> None:
    options = TaskOptions()
    for i in range(N_TASKS):
        scenario = random_task(0, i)  # a Scenario checks that polygons are simple and both ends are free
        assert len(scenario.obstacles) == MapOptions().n_obstacles
        assert options.distance[0] <= math.dist(scenario.start[:2], scenario.goal[:2]) <= options.distance[1]
        cars = shapely.polygons(scenario.vehicle.footprints(np.stack([scenario.start, scenario.goal])))
        assert shapely.distance(shapely.union_all(scenario.polygons), cars).min() >= options.clearance
        assert shapely.box(0, 0, 40, 40).contains([*cars, *scenario.polygons]).all()


def test_obstacles_are_in_the_way_unless_a_share_of_free_lines_is_asked_for() -> None:
    def blocked(options: TaskOptions) -> int:
        tasks = [random_task(1, i, task=options) for i in range(N_TASKS)]
        lines = [shapely.LineString([task.start[:2], task.goal[:2]]) for task in tasks]
        return sum(
            shapely.union_all(task.polygons).distance(line) <= task.vehicle.width / 2
            for task, line in zip(tasks, lines, strict=True)
        )

    assert blocked(TaskOptions(unobstructed=0.0)) == N_TASKS
    assert blocked(TaskOptions(unobstructed=1.0)) < N_TASKS


def test_maps_have_rectangles_convex_and_concave_polygons() -> None:
    polygons = [
        shapely.Polygon(ring) for i in range(6) for ring in random_obstacles(np.random.default_rng(i), MapOptions())
    ]
    concave = [p for p in polygons if p.area < p.convex_hull.area * (1 - 1e-9)]
    rectangles = [p for p in polygons if p.area > p.minimum_rotated_rectangle.area * (1 - 1e-9)]
    assert 0.05 < len(concave) / len(polygons) < 0.3
    assert 0.3 < len(rectangles) / len(polygons) < 0.7
    assert all(p.is_valid for p in polygons)


# ------------------------------------------------------------------------------------------------------------- the peer


@pytest.fixture(scope="module")
def problem() -> PeerProblem:
    """A small program with rows of every kind, around a guess that turns once more than the goal."""
    rng = np.random.default_rng(0)
    t = np.linspace(0.0, 6.0, 9)
    states = np.column_stack([1.2 * t, 0.3 * t, 0.2 + 0.1 * t, 1 + 0.1 * t, 0.05 * t])
    states += rng.normal(0, 0.02, (9, 5))
    guess = Trajectory(t, states, rng.normal(0, 0.2, (9, 2)))
    obstacles = (
        np.array([[3.0, 3.5], [5.0, 3.5], [5.0, 5.5], [3.0, 5.5]]),
        np.array([[4.0, -4.0], [6.0, -3.0], [4.5, -2.0]]),
    )
    goal = guess.poses[-1] - [0, 0, 2 * math.pi]
    scenario = Scenario("small", guess.poses[0], goal, obstacles, bounds=(-3.0, 13.0, -5.0, 6.0))
    return peer_problem(scenario, guess, our_numbers())


def random_point(problem: PeerProblem) -> np.ndarray:
    rng = np.random.default_rng(1)
    return np.hstack([problem.guess.states, problem.guess.inputs]) + rng.normal(0, 0.2, (len(problem.guess), 7))


def distances_of_rows(rows: PairRows, knots: np.ndarray, vehicle_scenario: Scenario) -> np.ndarray:
    """(sum of the triangles - area) / length by shapely, one triangle after the other."""
    values = []
    for k, point, length in zip(rows.knot, rows.point, rows.length, strict=True):
        x, y, theta = knots[k, :3]
        turn = np.array([[math.cos(theta), -math.sin(theta)], [math.sin(theta), math.cos(theta)]])
        seen = turn @ point + [x, y] if rows.of_car else turn.T @ (point - [x, y])
        corners = zip(rows.ring, np.roll(rows.ring, -1, axis=0), strict=True)
        total = sum(shapely.Polygon([seen, a, b]).area for a, b in corners)
        values.append((total - shapely.Polygon(rows.ring).area) / length)
    return np.array(values)


def expected_rows(problem: PeerProblem, knots: np.ndarray) -> list[np.ndarray]:
    """All rows, less their lower bounds, by our own functions: defects, areas, bounds."""
    scenario = problem.scenario
    rows = [defects(knots, problem.step, scenario.vehicle)[0].ravel()]
    rows += [distances_of_rows(pair, knots, scenario) - problem.margin for pair in problem.pairs]
    footprints = scenario.vehicle.footprints(knots[:, :3])
    for side in problem.sides:
        distance = side.sign * (footprints[side.knots][..., side.axis] - side.bound)
        rows.append(distance.ravel() - problem.bounds_margin)
    return rows


def test_the_peers_rows_and_cost_are_ours_at_a_random_point(problem: PeerProblem) -> None:
    assert len(problem.pairs) == 3 and any(len(side.knots) for side in problem.sides)
    knots = random_point(problem)
    nlp = formulate(problem)
    g, f = ca.Function("evaluate", [nlp.x], [nlp.g, nlp.f])(knots.ravel())
    expected = np.concatenate(expected_rows(problem, knots))
    assert problem.n_rows == len(expected) == nlp.g.numel()
    np.testing.assert_allclose(np.array(g).ravel() - nlp.g_low, expected, atol=EXACT)
    equality = nlp.g_low == nlp.g_high
    assert equality.sum() == 5 * (len(problem.guess) - 1) and np.isinf(nlp.g_high[~equality]).all()
    trajectory = Trajectory(problem.guess.t, knots[:, :5], knots[:, 5:])
    assert float(f) == pytest.approx(evaluate_cost(trajectory, problem.centroids, CostWeights()).J, rel=EXACT)


def test_the_tutorials_rows_and_cost_are_ours_at_a_random_point(problem: PeerProblem) -> None:
    knots = random_point(problem)
    program, variables = build_tutorial(problem)
    program.SetInitialGuess(variables, knots)
    point = program.initial_guess()
    rows, costs = [], 0.0
    for binding in program.generic_constraints():
        evaluator = binding.evaluator()
        value = evaluator.Eval(point[program.FindDecisionVariableIndices(binding.variables())])
        rows.append(value - evaluator.lower_bound())
    for binding in program.GetAllCosts():
        costs += binding.evaluator().Eval(point[program.FindDecisionVariableIndices(binding.variables())])[0]
    # sorted: the tutorial takes the rows of a polygon knot by knot
    np.testing.assert_allclose(
        np.sort(np.concatenate(rows)), np.sort(np.concatenate(expected_rows(problem, knots))), atol=EXACT
    )
    trajectory = Trajectory(problem.guess.t, knots[:, :5], knots[:, 5:])
    assert costs == pytest.approx(evaluate_cost(trajectory, problem.centroids, CostWeights()).J, rel=EXACT)


def test_pair_rows_are_distances_at_the_guess(problem: PeerProblem) -> None:
    guess, scenario = problem.guess, problem.scenario
    cars = shapely.polygons(scenario.vehicle.footprints(guess.poses))
    knots = np.hstack([guess.states, guess.inputs])
    least = np.full(len(guess), math.inf)
    for pair in problem.pairs:
        np.minimum.at(least, pair.knot, distances_of_rows(pair, knots, scenario))
    for k in np.flatnonzero(np.isfinite(least)):
        # the nearest of all rows is the distance: no two edges are nearest to each other here
        assert least[k] == pytest.approx(shapely.distance(cars[k], shapely.union_all(scenario.polygons)), abs=1e-9)


def test_the_peer_keeps_the_turns_of_the_guess_and_fixes_both_ends(problem: PeerProblem) -> None:
    assert problem.goal[2] == pytest.approx(problem.guess.poses[-1, 2])
    nlp = formulate(problem)
    low, high = nlp.x_low.reshape(-1, 7), nlp.x_high.reshape(-1, 7)
    for k, pose in ((0, problem.scenario.start), (-1, problem.goal)):
        np.testing.assert_array_equal(low[k], [*pose, 0, 0, 0, 0])
        np.testing.assert_array_equal(high[k], low[k])
    assert np.isinf(high[1:-1, :3]).all()
    np.testing.assert_array_equal(high[1:-1, 3:], np.tile(problem.limits, (len(low) - 2, 1)))


@pytest.mark.parametrize("method", CASADI)
def test_the_peer_solves_a_task_to_a_verified_plan(method: str) -> None:
    scenario = Scenario("lane", np.zeros(3), np.array([12.0, 1.0, 0.0]), (np.array([[4.0, -5], [8, -5], [6, -1.2]]),))
    t = np.linspace(0.0, 12.0, 25)
    states = np.zeros((25, 5))
    states[:, 0] = t
    problem = peer_problem(scenario, Trajectory(t, states, np.zeros((25, 2))), our_numbers())
    solution = solver_named(method)(problem, 20.0)
    assert solution.success and solution.iterations > 0
    assert verify(scenario, solution.trajectory).verified
