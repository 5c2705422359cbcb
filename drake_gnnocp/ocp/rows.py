r"""Rows: constraints on the knots of a trajectory, each defined once for all solvers.

A row family turns a formulation into blocks of rows

    lower <= g(x) <= upper,        x: some columns of some knots, in SI units,

with the values g and the entries of their sparse Jacobian. Ipopt evaluates the blocks at every iterate, the quadratic
programs linearise them at the knots at hand. A `Box` is the simplest constraint: bounds on the numbers themselves.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import Self

import numpy as np

from drake_gnnocp.vehicle import Input, State

N_STATES = len(State)  # x, y, theta, v, phi
N_KNOT = N_STATES + len(Input)  # ... and a, w
X, Y, THETA, V, PHI = State
A, W = (N_STATES + column for column in Input)
POSE = np.array([X, Y, THETA])

# The numbers x (V,) to the values (M,) and the entries (P,) of their Jacobian, in the order of `rows` and `columns`.
RowFunction = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True, eq=False)
class RowBlock:
    """M rows over the same V numbers: columns of knots, then the time step if it counts, then extra variables."""

    description: str  # what the rows are; infeasible ones are reported by it
    function: RowFunction
    lower: np.ndarray  # (M,)
    upper: np.ndarray  # (M,)
    rows: np.ndarray  # (P,) row of every entry of the Jacobian
    columns: np.ndarray  # (P,) its place in x
    knots: np.ndarray  # (K,)
    knot_columns: np.ndarray  # (C,) x begins with the K C numbers of these columns, knot by knot
    with_step: bool = False  # whether the time step h [s] is the next number of x
    extra: np.ndarray = field(default_factory=lambda: np.zeros(0))  # values at the guess of variables of its own
    group: int = 1  # consecutive rows of one obstacle: where rows are soft, they give way together

    def numbers(self, knots: np.ndarray, step: float) -> np.ndarray:
        """The numbers x at knots (N, 7) and a time step [s], extra variables at their guess."""
        of_knots = knots[np.ix_(self.knots, self.knot_columns)].ravel()
        return np.concatenate([of_knots, [step] if self.with_step else [], self.extra])


@dataclass(frozen=True, eq=False)
class Box:
    """Bounds lower <= x <= upper on some columns of some knots."""

    description: str
    knots: np.ndarray  # (K,)
    knot_columns: np.ndarray  # (C,)
    lower: np.ndarray  # (K, C)
    upper: np.ndarray  # (K, C)


@dataclass(frozen=True, eq=False)
class Table:
    """Base of records whose fields are arrays of the same length."""

    def subset(self, which: np.ndarray) -> Self:
        """The entries with these indices."""
        return type(self)(*(getattr(self, field.name)[which] for field in fields(self)))

    def joined(self, other: Self) -> Self:
        """These entries and then the other's."""
        return type(self)(*(np.concatenate([getattr(t, field.name) for t in (self, other)]) for field in fields(self)))


def pose_pattern(knot: np.ndarray, group: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The Jacobian's pattern of rows that depend on the pose of one knot each.

    Args:
        knot: (G,) knot of every group of rows.
        group: rows of a group.

    Returns:
        The different knots (K,) in their order, which of them each group has (G,), and rows and columns (3 G group,) of
        the entries of x, y and theta.
    """
    knots, position = np.unique(knot, return_inverse=True)
    columns = 3 * np.repeat(position, group)[:, None] + np.arange(3)
    return knots, position, np.repeat(np.arange(group * len(knot)), 3), columns.ravel()
