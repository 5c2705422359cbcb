"""Transformer layers, normalised first, with the parameters of `torch.nn`'s, which check for longer than they compute.

Shapes: B scenes, N tokens, D width. Masks are True where there is a token.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn.functional import linear, relu, scaled_dot_product_attention


class Attention(nn.Module):
    """Attention of several heads, from queries to tokens."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        if width % heads:
            raise ValueError(f"width: must be a multiple of heads, {heads}, not {width}")
        self.heads = heads
        self.in_proj_weight = nn.Parameter(torch.empty(3 * width, width))
        self.in_proj_bias = nn.Parameter(torch.zeros(3 * width))
        self.out_proj = nn.Linear(width, width)
        nn.init.xavier_uniform_(self.in_proj_weight)
        nn.init.zeros_(self.out_proj.bias)

    def forward(self, queries: Tensor, tokens: Tensor, mask: Tensor | None = None) -> Tensor:
        """What queries (B, M, D) find in tokens (B, N, D), of which those in a mask (B, N) count: (B, M, D)."""
        width = queries.shape[-1]
        weights, biases = self.in_proj_weight.split(width), self.in_proj_bias.split(width)
        query, key, value = (
            linear(x, weight, bias).unflatten(-1, (self.heads, -1)).transpose(1, 2)
            for x, weight, bias in zip((queries, tokens, tokens), weights, biases, strict=True)
        )
        counts = None if mask is None else mask[:, None, None]
        found = scaled_dot_product_attention(query, key, value, attn_mask=counts)
        return self.out_proj(found.transpose(1, 2).flatten(2))


class EncoderLayer(nn.Module):
    """Attention among tokens, then two linear layers for each."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.self_attn = Attention(width, heads)
        self.linear1, self.linear2 = nn.Linear(width, 2 * width), nn.Linear(2 * width, width)
        self.norm1, self.norm2 = nn.LayerNorm(width), nn.LayerNorm(width)

    def forward(self, tokens: Tensor, mask: Tensor) -> Tensor:
        """Tokens (B, N, D) that know of each other, with a mask (B, N)."""
        seen = self.norm1(tokens)
        tokens = tokens + self.self_attn(seen, seen, mask)
        return tokens + self.linear2(relu(self.linear1(self.norm2(tokens))))


class DecoderLayer(nn.Module):
    """Attention among queries, from them to tokens, then two linear layers for each query."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.self_attn, self.multihead_attn = Attention(width, heads), Attention(width, heads)
        self.linear1, self.linear2 = nn.Linear(width, 2 * width), nn.Linear(2 * width, width)
        self.norm1, self.norm2, self.norm3 = (nn.LayerNorm(width) for _ in range(3))

    def forward(self, queries: Tensor, tokens: Tensor, mask: Tensor) -> Tensor:
        """Queries (B, M, D) that know of each other and of tokens (B, N, D), with a mask (B, N)."""
        seen = self.norm1(queries)
        queries = queries + self.self_attn(seen, seen)
        queries = queries + self.multihead_attn(self.norm2(queries), tokens, mask)
        return queries + self.linear2(relu(self.linear1(self.norm3(queries))))


class Encoder(nn.Module):
    """Some layers over tokens."""

    def __init__(self, width: int, heads: int, layers: int) -> None:
        super().__init__()
        self.layers = nn.ModuleList(EncoderLayer(width, heads) for _ in range(layers))

    def forward(self, tokens: Tensor, mask: Tensor) -> Tensor:
        """Tokens (B, N, D) that know of each other, with a mask (B, N)."""
        for layer in self.layers:
            tokens = layer(tokens, mask)
        return tokens


class Decoder(nn.Module):
    """Some layers from queries to tokens."""

    def __init__(self, width: int, heads: int, layers: int) -> None:
        super().__init__()
        self.layers = nn.ModuleList(DecoderLayer(width, heads) for _ in range(layers))

    def forward(self, queries: Tensor, tokens: Tensor, mask: Tensor) -> Tensor:
        """Queries (B, M, D) that know of tokens (B, N, D), with a mask (B, N)."""
        for layer in self.layers:
            queries = layer(queries, tokens, mask)
        return queries
