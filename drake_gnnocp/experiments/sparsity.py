"""Which variables every row of a program depends on: the pattern of its Jacobian."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydrake.solvers import Binding, BoundingBoxConstraint, MathematicalProgram


@dataclass(frozen=True)
class SparsityBlock:
    """The rows of one binding."""

    description: str  # of its constraint
    rows: np.ndarray  # (P,) row in the program's Jacobian of every entry that is not always zero
    columns: np.ndarray  # (P,) index of its decision variable


def jacobian_sparsity(program: MathematicalProgram) -> list[SparsityBlock]:
    """The pattern of a program's Jacobian, bounds on variables aside.

    Rows are counted in the order in which Drake hands the constraints to a solver.
    """
    blocks, first = [], 0
    for binding in program.GetAllConstraints():
        evaluator = binding.evaluator()
        if isinstance(evaluator, BoundingBoxConstraint):
            continue
        rows, within = _pattern(binding)
        columns = np.array(program.FindDecisionVariableIndices(binding.variables()))[within]
        blocks.append(SparsityBlock(evaluator.get_description(), first + rows, columns))
        first += evaluator.num_constraints()
    return blocks


def _pattern(binding: Binding) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the entries within a binding; all of them, where it does not say."""
    pattern = binding.evaluator().gradient_sparsity_pattern()
    if pattern is None:
        shape = (binding.evaluator().num_constraints(), len(binding.variables()))
        rows, columns = np.indices(shape).reshape(2, -1)
        return rows, columns
    return tuple(np.array(pattern, dtype=int).reshape(-1, 2).T)  # type: ignore[return-value]
