"""Every row family and every cost term: derivatives against central differences of its own values."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from drake_gnnocp.ocp.costs import CostTerm, Proximity, Smoothness
from drake_gnnocp.ocp.dynamics import POSE_ROWS, dynamics
from drake_gnnocp.ocp.formulation import Formulation
from drake_gnnocp.ocp.half_planes import half_planes
from drake_gnnocp.ocp.rows import N_STATES, RowBlock
from drake_gnnocp.ocp.separating_lines import separating_lines
from drake_gnnocp.ocp.triangle_areas import triangle_areas

# central differences with this step are good to its square times the third derivative, and to 1e-16 / step
DIFFERENCE_STEP = 1e-6
TOLERANCE = 1e-7  # relative to the largest entry

Family = Callable[[Formulation], list[RowBlock]]
FAMILIES: dict[str, Family] = {
    "dynamics of the pose": lambda wavy: dynamics(wavy, POSE_ROWS),
    "dynamics": lambda wavy: dynamics(wavy, N_STATES),
    "dynamics in minimum time": lambda wavy: dynamics(replace(wavy, minimum_time=True), N_STATES),
    "triangle areas": triangle_areas,
    "half planes": lambda wavy: half_planes(wavy, wavy.reference.poses),
    "separating lines": separating_lines,
}
POINTS, SHARES = np.array([[2.0, 1.0], [5.0, -1.0], [0.5, 0.0]]), np.array([1.0, 0.4, 0.2])
TERMS: list[CostTerm] = [
    Smoothness(0.7),
    Proximity(1.0, 0.1, POINTS[:1], SHARES[:1], np.zeros(1)),
    Proximity(1.3, 0.2, POINTS, SHARES, np.array([0.0, 2.8])),
]


def central_differences(function: Callable[[np.ndarray], np.ndarray], x: np.ndarray) -> np.ndarray:
    """Derivatives of a function's values, of any shape, with respect to x (V,): the last axis."""
    steps = DIFFERENCE_STEP * np.eye(len(x))
    return np.stack([(function(x + step) - function(x - step)) / (2 * DIFFERENCE_STEP) for step in steps], axis=-1)


@pytest.mark.parametrize("family", FAMILIES)
def test_the_entries_of_rows_are_their_derivatives_and_there_are_no_others(family: str, wavy: Formulation) -> None:
    blocks, rng = FAMILIES[family](wavy), np.random.default_rng(1)
    assert blocks
    for block in blocks:
        x = block.numbers(wavy.knots, wavy.step)
        x += rng.normal(0, 1e-4, len(x))
        values, entries = block.function(x)
        jacobian = np.zeros((len(values), len(x)))
        jacobian[block.rows, block.columns] = entries
        expected = central_differences(lambda x, block=block: block.function(x)[0], x)  # type: ignore[misc]
        assert len(values) == len(block.lower) == len(block.upper)
        assert len(set(zip(block.rows, block.columns, strict=True))) == len(entries)
        assert np.abs(jacobian - expected).max() <= TOLERANCE * max(1.0, np.abs(expected).max()), block.description


@pytest.mark.parametrize("term", TERMS, ids=lambda term: f"{term.description} {term.weight}")
def test_the_gradient_of_a_cost_is_its_derivative(term: CostTerm) -> None:
    for values in np.random.default_rng(2).uniform(-4.0, 4.0, (20, len(term.columns))):
        expected = central_differences(lambda x: term.evaluate(x[None])[0][0], values)
        assert np.abs(term.evaluate(values[None])[1][0] - expected).max() <= TOLERANCE


@pytest.mark.parametrize("term", TERMS[:2], ids=["J1", "J2 at the rear axle"])
def test_the_convex_hessian_is_the_second_derivative_without_what_bends_down(term: CostTerm) -> None:
    found = []
    for values in np.random.default_rng(3).uniform(-4.0, 8.0, (40, len(term.columns))):
        hessian = central_differences(lambda x: term.evaluate(x[None])[1][0], values)
        bends, directions = np.linalg.eigh((hessian + hessian.T) / 2)
        expected = directions @ np.diag(np.maximum(bends, 0.0)) @ directions.T
        found.append(bends)
        assert np.abs(term.convex_hessian(values[None])[0] - expected).max() <= TOLERANCE
    assert np.max(found) > 0.05 and (term.is_quadratic or (np.min(found, axis=1) < -0.01).any())


def test_the_convex_hessian_at_several_points_of_the_car_is_the_sum_of_theirs_carried_to_the_pose() -> None:
    wheelbase = 2.8
    values = np.random.default_rng(4).uniform(-4.0, 8.0, (40, 3))
    both = Proximity(1.3, 0.2, POINTS, SHARES, np.array([0.0, wheelbase])).convex_hessian(values)
    at_rear = Proximity(1.3, 0.2, POINTS, SHARES, np.zeros(1))
    for pose, found in zip(values, both, strict=True):
        cos, sin = np.cos(pose[2]), np.sin(pose[2])
        front = pose + wheelbase * np.array([cos, sin, 0.0])
        carried = np.array([[1.0, 0.0, -wheelbase * sin], [0.0, 1.0, wheelbase * cos]])
        of_rear, of_front = at_rear.convex_hessian(pose[None])[0], at_rear.convex_hessian(front[None])[0, :2, :2]
        np.testing.assert_allclose(found, of_rear + carried.T @ of_front @ carried, atol=1e-12)
    assert np.linalg.eigvalsh(both).min() >= -1e-12
