"""Scenarios that several test files plan."""

import numpy as np
import pytest

from drake_gnnocp import Scenario


@pytest.fixture(scope="session")
def gate() -> Scenario:
    """A gate of 3 m between two blocks, off the straight line from start to goal."""
    blocks = ([[6, -8], [8, -8], [8, 0], [6, 0]], [[6, 3], [8, 3], [8, 10], [6, 10]])
    return Scenario(
        "gate",
        np.array([0.0, 0.0, 0.0]),
        np.array([14.0, 0.0, 0.0]),
        tuple(np.array(block, dtype=float) for block in blocks),
        bounds=(-3.0, 20.0, -8.0, 8.0),
    )
