"""The program that Ipopt gets: it holds every family of rows and every cost once, in its own units."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.autodiffutils import ExtractGradient, InitializeAutoDiff
from pydrake.solvers import BoundingBoxConstraint, MathematicalProgram

from drake_gnnocp import Scenario, Trajectory
from drake_gnnocp.experiments.sparsity import jacobian_sparsity
from drake_gnnocp.ocp.boxes import ends, limits, trust_region
from drake_gnnocp.ocp.costs import CostWeights, evaluate_cost
from drake_gnnocp.ocp.dynamics import dynamics
from drake_gnnocp.ocp.formulation import Formulation, formulate
from drake_gnnocp.ocp.nlp import Nlp, build
from drake_gnnocp.ocp.rows import N_KNOT, N_STATES, RowBlock
from drake_gnnocp.ocp.separating_lines import separating_lines
from drake_gnnocp.ocp.triangle_areas import triangle_areas

EXACT = 1e-12  # two ways of computing the same number
SCALED = 1e-9  # the same in other units: constraints of size 10, scales of 100


@pytest.fixture(params=[False, True], ids=["given duration", "minimum time"])
def formulation(request: pytest.FixtureRequest, wavy: Formulation) -> Formulation:
    return replace(wavy, minimum_time=True, trust_region=None) if request.param else wavy


def sampled(nlp: Nlp) -> tuple[np.ndarray, Trajectory]:
    """Values of the variables a little off the first iterate, and the trajectory that they are."""
    values = nlp.first_iterate + np.random.default_rng(1).normal(0, 1e-3, nlp.program.num_vars())
    return values, nlp.trajectory(values)


def rows_of(program: MathematicalProgram, family: str, values: np.ndarray) -> np.ndarray:
    """Values and bounds of the constraints whose descriptions begin with the family: (M, 3)."""
    found = []
    for binding in program.GetAllConstraints():
        evaluator = binding.evaluator()
        if evaluator.get_description().startswith(family):
            value = evaluator.Eval(values[program.FindDecisionVariableIndices(binding.variables())])
            found.append(np.column_stack([value, evaluator.lower_bound(), evaluator.upper_bound()]))
    return np.concatenate(found)


def test_the_program_has_the_rows_of_every_family_once(formulation: Formulation) -> None:
    nlp = build(formulation)
    values, trajectory = sampled(nlp)
    knots, step = np.hstack([trajectory.states, trajectory.inputs]), trajectory.duration / (len(trajectory) - 1)
    own = nlp.program.FindDecisionVariableIndices(nlp.knots.ravel()) + nlp.program.FindDecisionVariableIndices(nlp.step)
    extra = 100.0 * np.delete(values, own)  # those of lines, in the scale of the states
    states = N_STATES if formulation.minimum_time else 3

    def expected(blocks: list[RowBlock]) -> np.ndarray:
        found, used = [], 0
        for block in blocks:
            x = block.numbers(knots, step)
            x[len(x) - len(block.extra) :] = extra[used : used + len(block.extra)]
            used += len(block.extra)
            found.append(np.column_stack([block.function(x)[0], block.lower, block.upper]))
        return np.concatenate(found)

    families = {
        "dynamics": dynamics(formulation, states),
        "triangle areas": triangle_areas(formulation),
        "separating line": separating_lines(formulation),
    }
    n_rows = 0
    for family, blocks in families.items():
        found = rows_of(nlp.program, family, values)
        np.testing.assert_allclose(found, expected(blocks), rtol=SCALED, atol=SCALED, err_msg=family)
        n_rows += len(found)
    if not formulation.minimum_time:  # v and phi are linear then
        found = rows_of(nlp.program, "trapezoid rule", values)
        defects = expected(dynamics(formulation, N_STATES))[:, 0].reshape(-1, N_STATES)[:, 3:]
        np.testing.assert_allclose(found[:, 0].reshape(2, -1).T * 100, defects, atol=SCALED)
        assert not found[:, 1:].any()
        n_rows += len(found) + len(rows_of(nlp.program, "limits between the knots", values))
    assert n_rows == nlp.n_rows


def test_the_points_of_control_of_v_and_phi_between_the_knots_have_rows_where_the_limits_are_near(
    wavy: Formulation,
) -> None:
    knots, half = wavy.knots, wavy.step / 2
    v, phi = (np.abs(knots[:-1, state]) + np.abs(half * knots[:-1, rate]) for state, rate in ((3, 5), (4, 6)))
    vehicle = replace(wavy.vehicle, v_max=float(np.median(v)) / 0.45, phi_max=3.0 * float(phi.max()))
    nlp = build(replace(wavy, vehicle=vehicle, limits_margin=0.1))
    values, trajectory = sampled(nlp)
    near = np.flatnonzero(v > 0.5 * 0.9 * vehicle.v_max)
    assert 0 < len(near) < len(v) - 1
    rows = rows_of(nlp.program, "limits between", values)
    np.testing.assert_allclose(rows[:, 0], (trajectory.states[:, 3] + half * trajectory.inputs[:, 0])[near])
    np.testing.assert_allclose(rows[:, 1:], np.tile(0.9 * vehicle.v_max * np.array([-1.0, 1.0]), (len(near), 1)))


def test_gradients_of_the_program_are_those_of_central_differences(formulation: Formulation) -> None:
    nlp, step = build(formulation), 1e-6
    values, _ = sampled(nlp)
    for binding in [*nlp.program.generic_constraints(), *nlp.program.generic_costs()]:
        evaluator = binding.evaluator()
        x = values[nlp.program.FindDecisionVariableIndices(binding.variables())]
        jacobian = ExtractGradient(evaluator.Eval(InitializeAutoDiff(x).ravel()))
        shifts = step * np.random.default_rng(2).normal(size=(3, len(x)))
        for shift in shifts:
            difference = evaluator.Eval(x + shift) - evaluator.Eval(x - shift)
            error = np.abs(2 * jacobian @ shift - difference).max()
            scale = (np.abs(jacobian) @ np.abs(shift)).max()  # terms may cancel in their sum
            assert error <= 1e-6 * scale, evaluator.get_description()


def test_the_boxes_bound_the_programs_variables(formulation: Formulation) -> None:
    moving = replace(formulation, start=np.array([0.1, 0.2, 0.3, 0.5, -0.1]), goal=np.array([7.0, 2.0, 0.8, -0.4, 0.2]))
    nlp = build(moving)
    lower, upper = np.full((2, len(moving.reference), N_KNOT), [[[-np.inf]], [[np.inf]]])
    region = trust_region(moving)
    assert (region is None) == moving.minimum_time
    for box in [limits(moving), *ends(moving), *([region] if region else [])]:
        where = np.ix_(box.knots, box.knot_columns)
        lower[where], upper[where] = box.lower, box.upper
    found = np.full((2, nlp.program.num_vars()), [[-np.inf], [np.inf]])
    for binding in nlp.program.bounding_box_constraints():
        index, evaluator = nlp.program.FindDecisionVariableIndices(binding.variables()), binding.evaluator()
        found[:, index] = evaluator.lower_bound(), evaluator.upper_bound()
    of_knots = nlp.program.FindDecisionVariableIndices(nlp.knots.ravel())
    for values, expected in zip(found, (lower, upper), strict=True):
        np.testing.assert_allclose(values[of_knots].reshape(lower.shape) * nlp.knot_scale, expected, rtol=EXACT)
    assert lower[0, 3] == upper[0, 3] == 0.5 and lower[-1, 4] == upper[-1, 4] == 0.2


def test_costs_are_the_papers_sums(wavy: Formulation) -> None:
    inputs, weights = wavy.reference.inputs.copy(), CostWeights(lambda1=0.7, lambda2=1.3, gamma=1.2, definition="paper")
    inputs[[0, -1]] = 0.0
    reference = replace(wavy.reference, inputs=inputs)
    rings = ([[1.0, 3.5], [3.0, 3.5], [3.0, 5.5], [1.0, 5.5]], [[4.0, -4.5], [6.0, -3.5], [4.5, -1.5]])  # of wavy
    scenario = Scenario("wavy", reference.poses[0], reference.poses[-1], tuple(map(np.array, rings)))
    wavy = replace(formulate(scenario, reference, weights, margin=0.1), trust_region=None)
    h, centroids = wavy.step, np.array([[2.0, 4.5], [14.5 / 3, -9.5 / 3]])
    distances = np.linalg.norm(reference.poses[:, None, :2] - centroids, axis=2)
    j1 = sum(h * (a * a + w * w) for a, w in inputs)
    j2 = sum(h * weights.gamma ** -(d**2) for d in distances.ravel())
    cost = evaluate_cost(reference, scenario, weights)
    assert (cost.J1, cost.J2) == (pytest.approx(j1), pytest.approx(j2))
    assert cost.J == pytest.approx(weights.lambda1 * j1 + weights.lambda2 * j2)
    at_the_ends = weights.lambda2 * h * (weights.gamma ** -(distances[[0, -1]] ** 2)).sum()  # fixed

    nlp = build(replace(wavy, reference=reference))
    assert total_cost_of(nlp) + at_the_ends == pytest.approx(cost.J)

    timed = replace(wavy, reference=reference, minimum_time=True, trust_region=None)
    nlp = build(timed)
    factor = nlp.hessian / (2 * weights.lambda1 * h)
    expected = factor * (cost.J - at_the_ends + weights.time * reference.duration)
    assert total_cost_of(nlp) == pytest.approx(expected)
    steepest = max(np.abs(b.evaluator().a()).max() for b in nlp.program.linear_costs())
    assert steepest <= 100.0  # of Ipopt's documentation: above its nlp_scaling_max_gradient it scales the cost itself


def total_cost_of(nlp: Nlp) -> float:
    """The program's cost at its first iterate."""
    return float(sum(nlp.program.EvalBinding(cost, nlp.first_iterate)[0] for cost in nlp.program.GetAllCosts()))


def test_without_obstacles_or_weight_there_is_no_second_term(wavy: Formulation) -> None:
    for lonely in (
        replace(wavy.proximity, weight=0.0),
        replace(wavy.proximity, points=np.zeros((0, 2)), shares=np.zeros(0)),
    ):
        assert not build(replace(wavy, proximity=lonely)).program.generic_costs()


def test_the_first_iterate_is_the_reference(formulation: Formulation) -> None:
    nlp = build(formulation)
    trajectory = nlp.trajectory(nlp.first_iterate)
    np.testing.assert_allclose(trajectory.t, formulation.reference.t, atol=EXACT)
    np.testing.assert_allclose(trajectory.states, formulation.reference.states, atol=EXACT)
    np.testing.assert_allclose(trajectory.inputs, formulation.reference.inputs, atol=EXACT)
    assert not np.isnan(nlp.first_iterate).any()


def test_the_sparsity_of_the_jacobian_has_the_rows_and_columns_of_its_constraints(formulation: Formulation) -> None:
    nlp = build(formulation)
    program = nlp.program
    pattern = np.zeros((nlp.n_rows, program.num_vars()), dtype=bool)
    for block in jacobian_sparsity(program):
        pattern[block.rows, block.columns] = True
    x, first = sampled(nlp)[0], 0
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
    assert first == nlp.n_rows


def test_the_scale_of_the_states_changes_the_program_and_not_the_problem(formulation: Formulation) -> None:
    values = []
    for nlp in (build(formulation, state_scale=1.0), build(formulation)):
        evaluated = [*nlp.program.generic_constraints(), *nlp.program.GetAllCosts()]
        values.append([nlp.program.EvalBinding(binding, nlp.first_iterate) for binding in evaluated])
    for unscaled, scaled in zip(*values, strict=True):
        np.testing.assert_allclose(unscaled, scaled, rtol=SCALED, atol=SCALED)
