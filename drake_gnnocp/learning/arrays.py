"""Arrays of numpy, where a plan is made, or of torch, where a network learns: what is computed of them is written once.

`xp` is the namespace of an array, after the array API standard: the same names for both.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from array_api_compat import array_namespace

Array = Any  # of numpy or torch; shapes are told in comments

__all__ = ["Array", "array_namespace", "bounded", "constant", "put", "relu"]


def constant(x: Array) -> Array:
    """The same numbers, through which no gradients go."""
    return x.detach() if hasattr(x, "detach") else x


def relu(x: Array) -> Array:
    """What is positive, else 0."""
    return bounded(x, 0.0)


def bounded(x: Array, low: float, high: float | None = None) -> Array:
    """The numbers within limits; what the standard calls clip takes numpy ten times as long."""
    if hasattr(x, "clamp"):
        return x.clamp(low, high)
    at_least = np.maximum(x, low)
    return at_least if high is None else np.minimum(at_least, high)


def put(x: Array, is_put: Array, values: Array) -> Array:
    """An array x (B, J, ...) with values (N, ...) at the N places where is_put (B, J) is True, in their order."""
    xp = array_namespace(x)
    filled = xp.zeros_like(x)
    filled[is_put] = values
    return xp.where(is_put[(..., *[None] * (x.ndim - 2))], filled, x)
