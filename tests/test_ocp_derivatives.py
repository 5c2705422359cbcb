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
CENTROIDS = np.array([[2.0, 1.0], [5.0, -1.0], [0.5, 0.0]])
TERMS: list[CostTerm] = [Smoothness(0.7), Proximity(1.3, 1.2, CENTROIDS), Proximity(1.0, 1.1, CENTROIDS[:1])]


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
    for values in np.random.default_rng(2).uniform(-4.0, 4.0, (20, 2)):
        expected = central_differences(lambda x: term.evaluate(x[None])[0][0], values)
        assert np.abs(term.evaluate(values[None])[1][0] - expected).max() <= TOLERANCE


@pytest.mark.parametrize("term", [TERMS[0], TERMS[2]], ids=["J1", "J2 of one obstacle"])
def test_the_convex_hessian_is_the_second_derivative_without_what_bends_down(term: CostTerm) -> None:
    found = []
    for values in np.random.default_rng(3).uniform(-4.0, 8.0, (40, 2)):
        hessian = central_differences(lambda x: term.evaluate(x[None])[1][0], values)
        bends, directions = np.linalg.eigh((hessian + hessian.T) / 2)
        expected = directions @ np.diag(np.maximum(bends, 0.0)) @ directions.T
        found.append(bends)
        assert np.abs(term.convex_hessian(values[None])[0] - expected).max() <= TOLERANCE
    assert np.max(found) > 0.05 and (term.is_quadratic or (np.max(found, axis=1) < 0).any())


def test_the_convex_hessian_for_several_obstacles_is_the_sum_of_theirs() -> None:
    values = np.random.default_rng(4).uniform(-4.0, 8.0, (40, 2))
    hessian = TERMS[1].convex_hessian(values)
    alone = [Proximity(1.3, 1.2, centroid[None]).convex_hessian(values) for centroid in CENTROIDS]
    np.testing.assert_allclose(hessian, np.sum(alone, axis=0), atol=1e-12)
    assert np.linalg.eigvalsh(hessian).min() >= -1e-12
