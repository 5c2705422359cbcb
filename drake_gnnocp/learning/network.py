r"""The network of the `default` configuration, top-down: from a scene to several trajectories with a score each.

Functions of weights, which are named as `modules` has them.

1. `obstacle_tokens`: the vectors of an obstacle, seen from start and from goal, become one token (subgraphs, as in the
   paper).
2. A transformer over the task's token and the obstacles' (the paper's global graph, with attention).
3. `proposed`: K hypotheses look at the tokens; each predicts T points, a duration and a score. Solutions are multimodal
   (left or right of an obstacle, forwards or backwards first), and one regression would average them.
4. `refined`, several times: what lies around every point (nearest points of all obstacles in the car's frame, the
   defects of the kinematic model to its neighbours) corrects the point; convolutions along the trajectory keep it
   together.

Limits hold by construction: |v| <= v_max and |phi| <= phi_max by tanh; both ends are exact.

Shapes: B scenes, J obstacles, E edges, K hypotheses, T points, D width. Lengths are in units of LENGTH.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from drake_gnnocp.learning.arrays import Array, array_namespace, bounded, constant, relu
from drake_gnnocp.learning.configs import NetworkConfig
from drake_gnnocp.learning.features import LENGTH, MOTION, POSE, point_features, task_features
from drake_gnnocp.learning.layers import (
    Weights,
    convolution,
    decoder,
    encoder,
    in_order,
    linear,
    log_softmax,
    masked_max,
    mlp,
    normalised,
)
from drake_gnnocp.learning.scene import PHI_MAX, V_MAX, Scene, evaluated_by_length, into_frame, with_obstacles
from drake_gnnocp.learning.surroundings import nearest_obstacles, surroundings
from drake_gnnocp.vehicle import State

DILATIONS = (1, 2, 4, 8, 1)  # of the convolutions along a trajectory
NEIGHBOURS = 10  # obstacles the refinements look at: those nearest to the proposed trajectory
LIMITS = [V_MAX, PHI_MAX]  # columns of vehicles
LONGEST_LOG = 3.0  # of a duration over that of a car at about 1 m/s, either way
EVERY_RANK = slice(None)


@dataclass(frozen=True)
class Prediction:
    """K trajectories of each of B scenes, in the frames of the starts."""

    states: Array  # (B, K, T, 5) x, y, theta, v, phi at equal steps [m, m, rad, m/s, rad]
    duration: Array  # (B, K) [s]
    score: Array  # (B, K) logits of which one to take, or their log_softmax over all hypotheses


def predicted(weights: Weights, config: NetworkConfig, scene: Scene, ranks: slice = EVERY_RANK) -> Prediction:
    """Refined trajectories of every scene, the likeliest first; of some ranks only, where that is enough."""
    xp = array_namespace(scene.goal)
    first, latent, tokens = proposed(weights, config, scene)
    score = log_softmax(first.score)
    which = xp.argsort(score, axis=1, descending=True, stable=True)[:, ranks]
    score = xp.take_along_axis(score, which, axis=1)
    b, k = score.shape
    rows = xp.repeat(xp.arange(b), k)
    chosen = rows, which.reshape((-1,))
    states, duration = first.states[chosen], first.duration[chosen]
    of_rows = scene.each(lambda x: x[rows])
    steps = list(refined(weights, states, duration, latent[chosen], tokens[rows], of_rows)) if k else []
    if steps:
        states, duration = steps[-1]
    return Prediction(states.reshape((b, k, *states.shape[1:])), duration.reshape((b, k)), score)


def proposed(weights: Weights, config: NetworkConfig, scene: Scene) -> tuple[Prediction, Array, Array]:
    """K unrefined trajectories, what the hypotheses know (B, K, D), and the obstacles' tokens (B, J, D)."""
    xp = array_namespace(scene.goal)
    obstacles = obstacle_tokens(weights["obstacles"], scene)  # (B, J, D)
    tokens = xp.concat([mlp(task_features(scene), weights["task"])[:, None], obstacles], axis=1)  # (B, 1 + J, D)
    here = xp.any(scene.mask, axis=-1)  # (B, J)
    mask = xp.concat([xp.ones_like(here[:, :1]), here], axis=1)
    tokens = encoder(tokens, weights["encoder"], config.heads, mask)
    proposer = weights["proposer"]
    queries = proposer["queries"] + tokens[:, :1]  # (B, K, D)
    latent = decoder(queries, tokens, proposer["layers"], config.heads, mask)
    out = mlp(latent, proposer["head"])  # (B, K, 5 T + 2)
    raw = out[..., :-2].reshape((*out.shape[:2], config.points, len(State)))
    at_about_1_m_per_s = 6.0 + xp.hypot(scene.goal[:, :1], scene.goal[:, 1:2])
    duration = xp.exp(bounded(out[..., -2], -LONGEST_LOG, LONGEST_LOG)) * at_about_1_m_per_s
    first = Prediction(composed(raw, straight_line(scene, config.points), scene), duration, out[..., -1])
    return first, latent, tokens[:, 1:]


def obstacle_tokens(weights: Weights, scene: Scene) -> Array:
    """The vectors of every obstacle as one token: (B, J, D)."""

    def tokens(goal: Array, edges: Array, mask: Array) -> tuple[Array]:
        xp = array_namespace(edges)
        seen = xp.concat([edges, into_frame(edges, goal)], axis=-1) / LENGTH  # (B, J, E, 8)
        hidden = mlp(seen, weights["first"])
        pooled = xp.broadcast_to(masked_max(hidden, mask)[:, :, None], hidden.shape)
        return (masked_max(mlp(xp.concat([hidden, pooled], axis=-1), weights["second"]), mask),)

    return evaluated_by_length(tokens, scene.goal, scene.edges, scene.mask)[0]


def straight_line(scene: Scene, points: int) -> Array:
    """What trajectories are counted from: the straight line to the goal, (B, 1, T, 5) without speed and steering."""
    xp = array_namespace(scene.goal)
    u = xp.linspace(0.0, 1.0, points, dtype=scene.goal.dtype)
    line = u[:, None] * scene.goal[:, None]
    return xp.concat([line, xp.zeros_like(line[..., :2])], axis=-1)[:, None]


def composed(raw: Array, base: Array, scene: Scene) -> Array:
    """States (B, K, T, 5): base states and raw corrections (B, K, T, 5), within the limits and with exact ends.

    Positions are corrected in units of LENGTH, headings in rad, v and phi on a tanh scale of their limits.
    """
    xp = array_namespace(raw)
    limits = scene.vehicle[:, None, None, LIMITS]
    pose = base[..., POSE] + raw[..., POSE] * xp.asarray([LENGTH, LENGTH, 1.0], dtype=raw.dtype)
    before = xp.atanh(bounded(base[..., MOTION] / limits, -0.999, 0.999))
    motion = limits * xp.tanh(before + raw[..., MOTION])
    states = xp.concat([pose, motion], axis=-1)
    goal = scene.goal[:, None]
    # the goal's heading in the turn that the trajectory arrives in
    turns = constant(xp.round((pose[..., -1, 2] - goal[..., 2]) / (2 * math.pi)))
    position = xp.broadcast_to(goal[..., :2], (*turns.shape, 2))
    heading = goal[..., 2] + 2 * math.pi * turns
    at_rest = xp.zeros_like(position)
    end = xp.concat([position, heading[..., None], at_rest], axis=-1)[..., None, :]
    return xp.concat([xp.zeros_like(end), states[..., 1:-1, :], end], axis=-2)


def refined(
    weights: Weights, states: Array, duration: Array, latent: Array, tokens: Array, scene: Scene
) -> Iterator[tuple[Array, Array]]:
    """States (B, T, 5) and durations (B,) after each refinement of one trajectory a scene."""
    which = nearest_obstacles(states[..., POSE], scene, NEIGHBOURS)
    rows = array_namespace(which).arange(len(scene))[:, None]
    scene, tokens = with_obstacles(scene, which), tokens[rows, which]
    for refiner in in_order(weights.get("refiners", {})):
        # gradients end here: every refinement learns to correct what it is given
        states, duration = corrected(refiner, constant(states), constant(duration), latent, tokens, scene)
        yield states, duration


def corrected(
    weights: Weights, states: Array, duration: Array, latent: Array, tokens: Array, scene: Scene
) -> tuple[Array, Array]:
    """Better states (B, T, 5) and durations (B,) by what lies around; with latents (B, D), tokens (B, J, D)."""
    xp = array_namespace(states)
    around = surroundings(states[..., POSE], scene)  # (B, T, J, SURROUNDINGS)
    token = linear(tokens, weights["token"])[:, None]
    token = xp.broadcast_to(token, (*around.shape[:3], token.shape[-1]))
    here = xp.any(scene.mask, axis=-1)[:, None]
    pooled = masked_max(mlp(xp.concat([around, token], axis=-1), weights["around"]), here)
    features = point_features(states, duration, scene)
    x = linear(xp.concat([features, pooled], axis=-1), weights["enter"])
    x = x + linear(latent, weights["latent"])[:, None]  # (B, T, C)
    for dilation, block, norm in zip(DILATIONS, in_order(weights["blocks"]), in_order(weights["norms"]), strict=True):
        x = x + relu(convolution(normalised(x, norm), block, dilation))
    raw = linear(x, weights["leave"])[:, None]  # (B, 1, T, 5)
    longer = linear(xp.mean(x, axis=1), weights["last"])[:, 0]
    return composed(raw, states[:, None], scene)[:, 0], duration * xp.exp(bounded(longer, -1.0, 1.0))
