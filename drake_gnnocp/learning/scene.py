r"""Scenes and trajectories as arrays, seen from the start.

The start pose is the origin of the frame, so a prediction moves with the scene. Obstacles are vectors (edges), as in
the paper: a vector has a tail and a head, and the vectors of a ring form one subgraph. Bounds are four more subgraphs
of one vector each. Everything is padded to a batch; masks are True where there is something.

`vectors_of` and `scene_of` are what training and planning share.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields

import numpy as np
import shapely
from shapely.geometry.polygon import orient

from drake_gnnocp.learning.arrays import Array, array_namespace, put
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.vehicle import State, Vehicle

WHEELBASE, FRONT_HANG, REAR_HANG, WIDTH, V_MAX, A_MAX, PHI_MAX, W_MAX = range(8)  # columns of `Scene.vehicle`

# of what the network looks at: more takes memory without end, and it was trained on less
MOST_OBSTACLES, MOST_VERTICES = 100, 200
SEVERAL_VERTICES = 60  # of a polygon: one with more is made simpler, within STEP at first, and COARSER times twice that
STEP, COARSER = 0.15, 5  # m, -
FEW_EDGES = 8  # of an obstacle: those with more are looked at apart, see `evaluated_by_length`
WALLS_WITHIN = 100.0  # m, of the box around start and goal: bounds farther away are no matter


@dataclass(frozen=True)
class Scene:
    """B scenes in the frames of their starts. J obstacles, E edges each."""

    edges: Array  # (B, J, E, 4) tail x, y, head x, y [m], counter-clockwise
    mask: Array  # (B, J, E) bool, True where there is an edge
    goal: Array  # (B, 3) x, y, theta [m, m, rad]
    vehicle: Array  # (B, 8) the vehicle's parameters in the order of `Vehicle`

    def __len__(self) -> int:
        return len(self.goal)

    def each(self, change: Callable[[Array], Array]) -> Scene:
        """The scenes with a function applied to each of the arrays."""
        return Scene(*(change(getattr(self, field.name)) for field in fields(Scene)))


def with_obstacles(scene: Scene, which: Array) -> Scene:
    """The scenes with some of their obstacles (B, J')."""
    rows = array_namespace(which).arange(len(scene))[:, None]
    return Scene(scene.edges[rows, which], scene.mask[rows, which], scene.goal, scene.vehicle)


def evaluated_by_length(
    evaluate: Callable[[Array, Array, Array], tuple[Array, ...]], of_scenes: Array, edges: Array, mask: Array
) -> tuple[Array, ...]:
    """What a function finds of obstacles, at a cost that is linear in the number of their edges.

    Most obstacles have few edges, and some outlines hundreds: padded to these, all would cost as much.

    Args:
        evaluate: of something about every scene (B, ...), edges (B, J, E, 4) and mask (B, J, E): arrays (B, J, ...).
        of_scenes: (B, ...).
        edges: (B, J, E, 4) [m].
        mask: (B, J, E).
    """
    found = evaluate(of_scenes, edges[:, :, :FEW_EDGES], mask[:, :, :FEW_EDGES])
    xp = array_namespace(edges)
    has_more = xp.any(mask[:, :, FEW_EDGES:], axis=2)
    if not has_more.any():
        return found
    apart = evaluate(of_scenes[xp.nonzero(has_more)[0]], edges[has_more][:, None], mask[has_more][:, None])
    return tuple(put(of_all, has_more, some[:, 0]) for of_all, some in zip(found, apart, strict=True))


def vectors_of(scenario: Scenario) -> tuple[np.ndarray, np.ndarray]:
    """The obstacles and bounds of a scenario as vectors in its own frame.

    Returns:
        (J, E, 4) tail x, y, head x, y [m] and (J, E) bool. Rings go counter-clockwise, those of
        holes clockwise; repeated vertices are left out.
    """
    groups = []
    for polygon in map(orient, _simpler(_nearest(scenario))):
        # what encloses a hole is one obstacle: the nearest of all its edges says on which side of it a point is
        outlines = [_few_vertices(np.array(outline.coords)) for outline in (polygon.exterior, *polygon.interiors)]
        groups.append(np.vstack([np.hstack([corners[:-1], corners[1:]]) for corners in outlines]))
    if isinstance(scenario.bounds, tuple):
        groups.extend(np.array([wall]) for wall in _walls(scenario, scenario.bounds))
    if not groups:  # one obstacle that is only padding
        return np.zeros((1, 1, 4)), np.zeros((1, 1), dtype=bool)
    return padded(groups), padded([np.ones(len(group), dtype=bool) for group in groups])


def _nearest(scenario: Scenario) -> np.ndarray:
    """The obstacles, or those that are nearest to the line from start to goal where there are very many."""
    if len(scenario.blocked) <= MOST_OBSTACLES:
        return scenario.blocked
    line = shapely.LineString([scenario.start[:2], scenario.goal[:2]])
    nearest = np.argsort(shapely.distance(line, scenario.blocked), kind="stable")[:MOST_OBSTACLES]
    return scenario.blocked[np.sort(nearest)]


def _simpler(polygons: np.ndarray) -> np.ndarray:
    """Polygons with fewer vertices where they have many: the steps of a wall on a grid are no matter to the network."""
    simpler, step = polygons.copy(), STEP
    for _ in range(COARSER):
        has_many = shapely.get_num_coordinates(simpler) > SEVERAL_VERTICES
        simpler[has_many] = shapely.simplify(polygons[has_many], step)
        step *= 2.0
    return simpler


def _few_vertices(outline: np.ndarray) -> np.ndarray:
    """A closed outline (N, 2), or some of its vertices where there are very many."""
    if len(outline) <= MOST_VERTICES:
        return outline
    return outline[np.linspace(0, len(outline) - 1, MOST_VERTICES).astype(int)]


def _walls(scenario: Scenario, bounds: tuple[float, ...]) -> list[tuple[float, ...]]:
    """Vectors along the bounds, the free side on their right as it is for rings; none for sides that are far away."""
    ends = np.stack([scenario.start[:2], scenario.goal[:2]])
    seen_low, seen_high = ends.min(axis=0) - WALLS_WITHIN, ends.max(axis=0) + WALLS_WITHIN
    low, high = np.array(bounds[0::2]), np.array(bounds[1::2])
    (xmin, ymin), (xmax, ymax) = np.maximum(low, seen_low).tolist(), np.minimum(high, seen_high).tolist()
    walls = [(xmin, ymin, xmin, ymax), (xmin, ymax, xmax, ymax), (xmax, ymax, xmax, ymin), (xmax, ymin, xmin, ymin)]
    is_near = (low[0] > seen_low[0], high[1] < seen_high[1], high[0] < seen_high[0], low[1] > seen_low[1])
    return [wall for wall, near in zip(walls, is_near, strict=True) if near]


def padded(arrays: Sequence[np.ndarray]) -> np.ndarray:
    """Arrays with the same number of axes as one (N, ...): zeros (or False) at the ends of axes make them alike."""
    shape = np.max([array.shape for array in arrays], axis=0)
    return np.stack([np.pad(array, [(0, n) for n in shape - array.shape]) for array in arrays])


def vehicle_row(vehicle: Vehicle) -> list[float]:
    """The parameters of a vehicle in their order."""
    return list(vehicle.to_dict().values())


def scene_of(scenario: Scenario) -> Scene:
    """One scenario as a batch of one scene, in the frame of its start, in numpy's single precision."""
    edges, mask = vectors_of(scenario)
    local = into_frame(edges[None], scenario.start[None])
    vehicle = np.array([vehicle_row(scenario.vehicle)], np.float32)
    return Scene(local.astype(np.float32), mask[None], goal_of(scenario), vehicle)


def goal_of(scenario: Scenario) -> np.ndarray:
    """The goal of a scenario in the frame of its start: (1, 3) [m, m, rad]."""
    x, y, theta = scenario.start
    dx, dy = scenario.goal[:2] - (x, y)
    cos, sin = math.cos(theta), math.sin(theta)
    turn = math.remainder(scenario.goal[2] - theta, 2 * math.pi)
    return np.array([[cos * dx + sin * dy, cos * dy - sin * dx, turn]], np.float32)


def into_frame(points: Array, frames: Array) -> Array:
    """Points (B, ..., 2n), pairs of x and y [m], seen from frames (B, 3) x, y, theta [m, m, rad]."""
    xp, shape = array_namespace(points), points.shape
    pairs = points.reshape((shape[0], -1, 2)) - frames[:, None, :2]
    cos, sin = xp.cos(frames[:, None, 2]), xp.sin(frames[:, None, 2])
    x = cos * pairs[..., 0] + sin * pairs[..., 1]
    y = cos * pairs[..., 1] - sin * pairs[..., 0]
    return xp.stack([x, y], axis=-1).reshape(shape)


def states_into_frame(states: Array, frames: Array) -> Array:
    """States (B, T, 5) seen from frames (B, 3): positions turned and moved, headings counted from the frame's."""
    positions, turn = into_frame(states[..., : State.THETA], frames), states[..., [State.THETA]] - frames[:, None, 2:]
    return array_namespace(states).concat([positions, turn, states[..., State.V :]], axis=-1)


def out_of_frame(states: Array, frames: Array) -> Array:
    """States (B, ..., T, 5) seen from frames (B, 3) as they are where the frames are given."""
    xp = array_namespace(states)
    x0, y0, theta = (frames[:, i].reshape((-1, *[1] * (states.ndim - 2))) for i in range(3))
    cos, sin = xp.cos(theta), xp.sin(theta)
    x = x0 + cos * states[..., State.X] - sin * states[..., State.Y]
    y = y0 + sin * states[..., State.X] + cos * states[..., State.Y]
    pose = xp.stack([x, y, states[..., State.THETA] + theta], axis=-1)
    return xp.concat([pose, states[..., State.V :]], axis=-1)


def turned_around(scene: Scene) -> Scene:
    """The tasks the other way, from the goal to the start, seen from the goal."""
    xp = array_namespace(scene.goal)
    start = into_frame(xp.zeros_like(scene.goal[:, :2]), scene.goal)
    goal = xp.concat([start, -scene.goal[:, 2:]], axis=1)
    return Scene(into_frame(scene.edges, scene.goal), scene.mask, goal, scene.vehicle)


def mirrored(scene: Scene, states: Array) -> tuple[Scene, Array]:
    """Scene and states (B, ..., T, 5) seen in a mirror along the start's heading: left is right."""
    xp = array_namespace(states)
    # tail and head change places, so that rings go counter-clockwise again
    edges = (scene.edges * xp.asarray([1.0, -1.0, 1.0, -1.0], dtype=scene.edges.dtype))[..., [2, 3, 0, 1]]
    goal = scene.goal * xp.asarray([1.0, -1.0, -1.0], dtype=scene.goal.dtype)
    signs = [-1.0 if column in (State.Y, State.THETA, State.PHI) else 1.0 for column in State]
    return Scene(edges, scene.mask, goal, scene.vehicle), states * xp.asarray(signs, dtype=states.dtype)


def reversed_in_time(states: Array) -> Array:
    """States (..., T, 5) driven backwards in time: from the goal to the start, with the opposite speed."""
    xp = array_namespace(states)
    signs = [-1.0 if column == State.V else 1.0 for column in State]
    return xp.flip(states, axis=-2) * xp.asarray(signs, dtype=states.dtype)
