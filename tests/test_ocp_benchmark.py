"""The benchmark's tasks are reproducible, and its peers solve our problem."""

import math
from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
import shapely

from drake_gnnocp import Scenario, Trajectory
from drake_gnnocp.experiments.benchmark.casadi_peer import (
    PairRows,
    PeerSolution,
    nonlinear_program,
    pair_rows,
    solve_with_casadi,
)
from drake_gnnocp.experiments.benchmark.casadi_stages import next_knot, solve_with_fatrop
from drake_gnnocp.experiments.tasks.open_maps import MapOptions, TaskOptions, random_obstacles, random_task
from drake_gnnocp.ocp.costs import CostWeights, cost_terms, total_cost
from drake_gnnocp.ocp.dynamics import defects
from drake_gnnocp.ocp.formulation import Formulation, formulate
from drake_gnnocp.ocp.triangle_areas import rows_near
from drake_gnnocp.verification import verify

EXACT = 1e-11  # two ways of computing the same number; areas cancel a few digits
N_TASKS = 12
MARGIN = 0.1  # m


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
def problem() -> Formulation:
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
    return formulate(scenario, guess, CostWeights(), MARGIN)


def random_point(problem: Formulation) -> np.ndarray:
    rng = np.random.default_rng(1)
    return problem.knots + rng.normal(0, 0.2, problem.knots.shape)


def distances_of_rows(rows: PairRows, knots: np.ndarray) -> np.ndarray:
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


def test_the_peers_rows_and_cost_are_ours_at_a_random_point(problem: Formulation) -> None:
    pairs, knots = pair_rows(problem), random_point(problem)
    assert [rows.of_car for rows in pairs].count(False) == 1 and len(pairs) > 3  # two obstacles, and walls
    nlp = nonlinear_program(problem)
    g, f = ca.Function("evaluate", [nlp.x], [nlp.g, nlp.f])(knots.ravel())
    areas = [distances_of_rows(rows, knots) - rows.margin for rows in pairs]
    expected = np.concatenate([defects(knots, problem.step, problem.vehicle)[0].ravel(), *areas])
    np.testing.assert_allclose(np.array(g).ravel() - nlp.g_low, expected, atol=EXACT)
    equality = nlp.g_low == nlp.g_high
    assert equality.sum() == 5 * (len(knots) - 1) and np.isinf(nlp.g_high[~equality]).all()
    cost = total_cost(cost_terms(problem.weights, problem.proximity), knots, problem.step)
    assert float(f) == pytest.approx(cost, rel=EXACT)


def test_the_peer_asks_for_the_rows_and_margins_that_we_ask_for(problem: Formulation) -> None:
    def sorted_rows(knot: np.ndarray, point: np.ndarray, length: np.ndarray, margin: np.ndarray) -> np.ndarray:
        rows = np.column_stack([knot, point, length, margin])
        return rows[np.lexsort(rows.round(6).T)]

    ours = rows_near(problem)
    peers = [
        np.concatenate(part)
        for part in zip(
            *((rows.knot, rows.point, rows.length, rows.margin) for rows in pair_rows(problem)), strict=True
        )
    ]
    expected = sorted_rows(ours.knot, ours.point, ours.length, problem.margins[ours.obstacle])
    np.testing.assert_allclose(sorted_rows(*peers), expected, atol=EXACT)


def test_pair_rows_are_distances_at_the_guess(problem: Formulation) -> None:
    guess = problem.reference
    cars = shapely.polygons(problem.vehicle.footprints(guess.poses))
    least = np.full(len(guess), math.inf)
    for rows in pair_rows(problem):
        np.minimum.at(least, rows.knot, distances_of_rows(rows, problem.knots))
    for k in np.flatnonzero(np.isfinite(least)):
        # the nearest of all rows is the distance: no two edges are nearest to each other here
        assert least[k] == pytest.approx(shapely.distance(cars[k], problem.obstacles.polygons).min(), abs=1e-9)


def test_the_peer_keeps_the_turns_of_the_guess_and_fixes_both_ends(problem: Formulation) -> None:
    nlp = nonlinear_program(problem)
    low, high = nlp.x_low.reshape(-1, 7), nlp.x_high.reshape(-1, 7)
    for k in (0, -1):
        np.testing.assert_allclose(low[k], [*problem.reference.poses[k], 0, 0, 0, 0], atol=EXACT)
        np.testing.assert_array_equal(high[k], low[k])
    vehicle = problem.vehicle
    limits = [vehicle.v_max, vehicle.phi_max, vehicle.a_max, vehicle.w_max]
    assert np.isinf(high[1:-1, :3]).all() and (high[1:-1, 3:] == limits).all() and (low[1:-1] == -high[1:-1]).all()


def with_ipopt(problem: Formulation) -> PeerSolution:
    return solve_with_casadi(problem, False, 20.0)


def expanded(problem: Formulation) -> PeerSolution:
    return solve_with_casadi(problem, True, 20.0)


@pytest.mark.parametrize("solve", [with_ipopt, expanded, solve_with_fatrop])
def test_the_peer_solves_a_task_to_a_verified_plan(solve: Callable[[Formulation], PeerSolution]) -> None:
    scenario = Scenario("lane", np.zeros(3), np.array([12.0, 1.0, 0.0]), (np.array([[4.0, -5], [8, -5], [6, -1.2]]),))
    t = np.linspace(0.0, 12.0, 25)
    states = np.zeros((25, 5))
    states[:, 0] = t
    problem = formulate(scenario, Trajectory(t, states, np.zeros((25, 2))), CostWeights(), MARGIN)
    solution = solve(problem)
    assert solution.success and solution.iterations > 0
    assert verify(scenario, solution.trajectory).verified


def test_the_next_knot_of_a_stage_has_no_defects() -> None:
    rng = np.random.default_rng(0)
    knots, vehicle = rng.uniform(-0.5, 0.5, (6, 7)), Scenario("field", np.zeros(3), np.array([9.0, 0.0, 0.0])).vehicle
    step = next_knot(vehicle.wheelbase, 0.3)
    for k in range(5):
        knots[k + 1] = np.array(step(knots[k], knots[k + 1, 5:])).ravel()
    np.testing.assert_allclose(defects(knots, 0.3, vehicle)[0], 0.0, atol=EXACT)
