r"""Layers: what torch's layers of the same names compute, of weights that are arrays of numpy or torch.

Transformer layers are normalised first. Shapes: B scenes, N tokens, M queries, D width. Masks are True where there is a
token.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from drake_gnnocp.learning.arrays import Array, array_namespace, relu

EPSILON = 1e-5  # of variances, in the normalisation


Weights = dict[str, Any]  # of a network or a part of it: an array, or the weights of a part, by its name


def nested(arrays: Mapping[str, Array]) -> Weights:
    """Weights whose names tell where they belong, as `encoder.layers.0.norm1.bias`, by the parts of their network."""
    tree: Weights = {}
    for name, array in arrays.items():
        *parts, last = name.split(".")
        branch = tree
        for part in parts:
            branch = branch.setdefault(part, {})
        branch[last] = array
    return tree


def in_order(weights: Weights) -> list[Weights]:
    """Those of the parts 0, 1, ..."""
    return [weights[name] for name in sorted(weights, key=int)]


def linear(x: Array, weights: Weights) -> Array:
    """(..., outputs) of x (..., inputs)."""
    return affine(x, weights["weight"], weights["bias"])


def affine(x: Array, weight: Array, bias: Array) -> Array:
    """(..., outputs) of x (..., inputs), weight (outputs, inputs) and bias (outputs,)."""
    # one product of two matrices: numpy takes those of more axes one by one
    return (x.reshape((-1, x.shape[-1])) @ weight.T + bias).reshape((*x.shape[:-1], len(bias)))


def mlp(x: Array, weights: Weights) -> Array:
    """Linear layers, the parts 0, 2, 4, ..., with ReLU in between."""
    first, *others = in_order(weights)
    x = linear(x, first)
    for layer in others:
        x = linear(relu(x), layer)
    return x


def normalised(x: Array, weights: Weights) -> Array:
    """Each of x (..., D) with mean 0 and variance 1, then scaled and shifted."""
    xp = array_namespace(x)
    centred = x - xp.mean(x, axis=-1, keepdims=True)
    variance = xp.mean(centred * centred, axis=-1, keepdims=True)
    return centred / xp.sqrt(variance + EPSILON) * weights["weight"] + weights["bias"]


def softmax(x: Array) -> Array:
    """Shares (..., N) of x (..., N), which may be -inf in places."""
    xp = array_namespace(x)
    shares = xp.exp(x - xp.max(x, axis=-1, keepdims=True))
    return shares / xp.sum(shares, axis=-1, keepdims=True)


def log_softmax(x: Array) -> Array:
    """Logarithms of the shares (..., N) of x (..., N)."""
    xp = array_namespace(x)
    lower = x - xp.max(x, axis=-1, keepdims=True)
    return lower - xp.log(xp.sum(xp.exp(lower), axis=-1, keepdims=True))


def masked_max(values: Array, mask: Array) -> Array:
    """Largest of values (..., E, D) where mask (..., E) is True; 0 where none is."""
    xp = array_namespace(values)
    largest = xp.max(xp.where(mask[..., None], values, -xp.inf), axis=-2)
    return xp.where(xp.any(mask, axis=-1)[..., None], largest, 0.0)


def attention(queries: Array, tokens: Array, weights: Weights, heads: int, mask: Array | None = None) -> Array:
    """What queries (B, M, D) find in tokens (B, N, D), of which those in a mask (B, N) count: (B, M, D)."""
    xp, width = array_namespace(queries), queries.shape[-1]

    def projected(x: Array, part: int) -> Array:  # (B, heads, N, D / heads)
        rows = slice(part * width, (part + 1) * width)
        x = affine(x, weights["in_proj_weight"][rows], weights["in_proj_bias"][rows])
        return xp.permute_dims(x.reshape((*x.shape[:2], heads, width // heads)), (0, 2, 1, 3))

    query, key, value = projected(queries, 0), projected(tokens, 1), projected(tokens, 2)
    scores = query @ xp.permute_dims(key, (0, 1, 3, 2)) / math.sqrt(width // heads)
    if mask is not None:
        scores = xp.where(mask[:, None, None], scores, -xp.inf)
    found = xp.permute_dims(softmax(scores) @ value, (0, 2, 1, 3))
    return linear(found.reshape(queries.shape), weights["out_proj"])


def encoder(tokens: Array, weights: Weights, heads: int, mask: Array) -> Array:
    """Tokens (B, N, D) that know of each other, with a mask (B, N)."""
    for layer in in_order(weights["layers"]):
        seen = normalised(tokens, layer["norm1"])
        tokens = tokens + attention(seen, seen, layer["self_attn"], heads, mask)
        tokens = tokens + _feed_forward(normalised(tokens, layer["norm2"]), layer)
    return tokens


def decoder(queries: Array, tokens: Array, weights: Weights, heads: int, mask: Array) -> Array:
    """Queries (B, M, D) that know of each other and of tokens (B, N, D), with a mask (B, N)."""
    for layer in in_order(weights["layers"]):
        seen = normalised(queries, layer["norm1"])
        queries = queries + attention(seen, seen, layer["self_attn"], heads)
        seen = normalised(queries, layer["norm2"])
        queries = queries + attention(seen, tokens, layer["multihead_attn"], heads, mask)
        queries = queries + _feed_forward(normalised(queries, layer["norm3"]), layer)
    return queries


def _feed_forward(x: Array, layer: Weights) -> Array:
    return linear(relu(linear(x, layer["linear1"])), layer["linear2"])


def convolution(x: Array, weights: Weights, dilation: int) -> Array:
    """Three taps along the points of trajectories x (B, T, C), `dilation` apart: (B, T, C)."""
    xp, (b, t, c) = array_namespace(x), x.shape
    beside = xp.zeros((b, dilation, c), dtype=x.dtype)
    padded = xp.concat([beside, x, beside], axis=1)
    return linear(xp.concat([padded[:, i * dilation : i * dilation + t] for i in range(3)], axis=-1), weights)
