r"""What lies around a pose: the nearest point of every obstacle to points along the car, in the car's frame.

The nearest point of an edge from a to b to a point p is a + t (b - a), t = (p - a).(b - a) / |b - a|^2 cut to [0, 1].
"""

from __future__ import annotations

from drake_gnnocp.learning.arrays import Array, array_namespace, bounded, constant, relu
from drake_gnnocp.learning.scene import FRONT_HANG, REAR_HANG, WHEELBASE, WIDTH, Scene, evaluated_by_length

STATIONS = (0.0, 0.5, 1.0)  # of the way from the rear bumper's side to the front's, see `stations`
SURROUNDINGS = 4 * len(STATIONS)  # nearest x, y, nearness and side, at each station
FAR = 1e3  # m, stands for no obstacle
TIE, RELATIVE_TIE = 1e-4, 1e-5  # m^2 and a share: squared distances closer than this count as the same (float32)
TINY = 1e-12  # m^2, of an edge that is padding
MEAN_SHARE = 1e-3  # of the mean distance in the order of obstacles by their least one
HALF_NEARNESS = 2.0  # m, the distance at which the nearness HALF_NEARNESS / (HALF_NEARNESS + distance) is 1/2


def stations(poses: Array, vehicle: Array) -> Array:
    """Points (B, T, S, 2) on the axis of cars (B, 8) at poses (B, T, 3), half a width inside the bumpers [m]."""
    xp = array_namespace(poses)
    back = vehicle[:, WIDTH] / 2 - vehicle[:, REAR_HANG]
    front = vehicle[:, WHEELBASE] + vehicle[:, FRONT_HANG] - vehicle[:, WIDTH] / 2
    share = xp.asarray(STATIONS, dtype=poses.dtype)
    offset = back[:, None] + share * (front - back)[:, None]  # (B, S)
    axis = xp.stack([xp.cos(poses[..., 2]), xp.sin(poses[..., 2])], axis=-1)  # (B, T, 2)
    return poses[..., None, :2] + offset[:, None, :, None] * axis[..., None, :]


def nearest(points: Array, edges: Array, mask: Array) -> tuple[Array, Array, Array]:
    """Nearest points of every obstacle.

    Args:
        points: (B, P, 2) [m].
        edges: (B, J, E, 4) [m].
        mask: (B, J, E).

    Returns:
        x and y (B, J, P) of the nearest points relative to the points, FAR away where there is no obstacle [m]; and
        (B, J, P), +1 where the point is right of the edge (outside a convex obstacle), -1 left of it. Gradients take
        the nearest points for fixed: to the first order, moving along an edge does not change the distance.
    """
    nearest_x, nearest_y, side = evaluated_by_length(_nearest, constant(points), edges, mask)
    return nearest_x - points[:, None, :, 0], nearest_y - points[:, None, :, 1], side


def _nearest(points: Array, edges: Array, mask: Array) -> tuple[Array, Array, Array]:
    xp = array_namespace(points)
    to_x, to_y, squared, cross = _towards_edges(points, edges, mask)
    which = xp.argmin(squared, axis=0, keepdims=True)
    to_x, to_y, least = (xp.take_along_axis(column, which, axis=0)[0] for column in (to_x, to_y, squared))
    return to_x + points[:, None, :, 0], to_y + points[:, None, :, 1], _side(squared, cross, least)


def signed_distance(points: Array, edges: Array, mask: Array) -> Array:
    """Distance (B, J, P) of points (B, P, 2) to every obstacle, negative left of its nearest edge [m]; no gradients."""
    return evaluated_by_length(_signed_distance, constant(points), edges, mask)[0]


def _signed_distance(points: Array, edges: Array, mask: Array) -> tuple[Array]:
    xp = array_namespace(points)
    _, _, squared, cross = _towards_edges(points, edges, mask)
    least = xp.min(squared, axis=0)
    return (xp.sqrt(least) * _side(squared, cross, least),)


def _towards_edges(points: Array, edges: Array, mask: Array) -> tuple[Array, Array, Array, Array]:
    """From points to the nearest points of every edge: x, y, squared length, and how far right of the edge [m, m^2].

    All (E, B, J, P): with the long axis last, a CPU takes half the time it does with the edges last.
    """
    xp = array_namespace(points)
    edges = xp.permute_dims(xp.where(mask[..., None], edges, FAR), (3, 2, 0, 1))  # FAR: one point far away
    tail_x, tail_y, head_x, head_y = (edges[i, ..., None] for i in range(4))  # (E, B, J, 1)
    x, y = points[:, None, :, 0], points[:, None, :, 1]  # (B, 1, P)
    along_x, along_y = head_x - tail_x, head_y - tail_y
    per_square = 1 / bounded(along_x**2 + along_y**2, TINY)
    offset_x, offset_y = x - tail_x, y - tail_y
    t = bounded(offset_x * (along_x * per_square) + offset_y * (along_y * per_square), 0.0, 1.0)
    to_x, to_y = t * along_x - offset_x, t * along_y - offset_y
    return to_x, to_y, to_x**2 + to_y**2, offset_x * along_y - offset_y * along_x


def _side(squared: Array, cross: Array, least: Array) -> Array:
    """+1 where a point is right of a nearest edge, else -1: (B, J, P).

    At a corner two edges are nearest, and the point is outside the obstacle if it is right of either. So the least
    distance is looked for once more among the edges that the point is right of; the others get a large distance.
    """
    xp = array_namespace(squared)
    of_right_edges = xp.min(squared + relu(-cross) * (FAR**2 / TINY), axis=0)
    return xp.where(of_right_edges <= (1 + RELATIVE_TIE) * least + TIE, xp.ones_like(least), -xp.ones_like(least))


def nearest_obstacles(poses: Array, scene: Scene, most: int) -> Array:
    """Which obstacles (B, at most `most`) come nearest to some of the poses (B, T, 3), every other one.

    Of two that come as near, as walls do with their common corner, it is the one that is nearer in the mean.
    """
    xp, n = array_namespace(poses), scene.edges.shape[1]
    if n <= most:
        return xp.broadcast_to(xp.arange(n), (len(scene), n))
    distance = signed_distance(poses[:, ::2, :2], scene.edges, scene.mask)  # (B, J, T / 2)
    order = xp.min(distance, axis=2) + MEAN_SHARE * xp.mean(distance, axis=2)
    return xp.argsort(order, axis=1)[:, :most]


def surroundings(poses: Array, scene: Scene) -> Array:
    """Features (B, T, J, SURROUNDINGS) of what lies around poses (B, T, 3)."""
    xp, (b, t) = array_namespace(poses), poses.shape[:2]
    points = stations(poses, scene.vehicle).reshape((b, -1, 2))
    x, y, side = (column.reshape((*column.shape[:2], t, -1)) for column in nearest(points, scene.edges, scene.mask))
    theta = poses[:, None, :, 2, None]
    cos, sin = xp.cos(theta), xp.sin(theta)
    ahead, left = cos * x + sin * y, cos * y - sin * x  # (B, J, T, S)
    nearness = HALF_NEARNESS / (HALF_NEARNESS + xp.hypot(ahead, left))
    # directions weighted by nearness: what is far away hardly matters
    features = xp.stack([ahead * nearness, left * nearness, nearness, side * nearness], axis=-1)
    return xp.permute_dims(features, (0, 2, 1, 3, 4)).reshape((b, t, scene.edges.shape[1], SURROUNDINGS))
