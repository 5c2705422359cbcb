r"""What lies around a pose: the nearest point of every obstacle to points along the car, in the car's frame.

The nearest point of an edge from a to b to a point p is a + t (b - a), t = (p - a).(b - a) / |b - a|^2 cut to [0, 1].
"""

from __future__ import annotations

import torch
from torch import Tensor

from drake_gnnocp.learning.scene import FRONT_HANG, REAR_HANG, WHEELBASE, WIDTH, Scene, evaluated_by_length

STATIONS = (0.0, 0.5, 1.0)  # of the way from the rear bumper's side to the front's, see `stations`
SURROUNDINGS = 4 * len(STATIONS)  # nearest x, y, nearness and side, at each station
FAR = 1e3  # m, stands for no obstacle
TIE, RELATIVE_TIE = 1e-4, 1e-5  # m^2 and a share: squared distances closer than this count as the same (float32)
TINY = 1e-12  # m^2, of an edge that is padding
MEAN_SHARE = 1e-3  # of the mean distance in the order of obstacles by their least one
HALF_NEARNESS = 2.0  # m, the distance at which the nearness HALF_NEARNESS / (HALF_NEARNESS + distance) is 1/2


def stations(poses: Tensor, vehicle: Tensor) -> Tensor:
    """Points (B, T, S, 2) on the axis of cars (B, 8) at poses (B, T, 3), half a width inside the bumpers [m]."""
    back = vehicle[:, WIDTH] / 2 - vehicle[:, REAR_HANG]
    front = vehicle[:, WHEELBASE] + vehicle[:, FRONT_HANG] - vehicle[:, WIDTH] / 2
    share = poses.new_tensor(STATIONS)
    offset = back[:, None] + share * (front - back)[:, None]  # (B, S)
    axis = torch.stack([torch.cos(poses[..., 2]), torch.sin(poses[..., 2])], dim=-1)  # (B, T, 2)
    return poses[..., None, :2] + offset[:, None, :, None] * axis[..., None, :]


def nearest(points: Tensor, edges: Tensor, mask: Tensor) -> tuple[Tensor, Tensor, Tensor]:
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
    x, y = points[:, None].unbind(dim=-1)  # (B, 1, P)
    with torch.no_grad():
        nearest_x, nearest_y, side = evaluated_by_length(_nearest, points, edges, mask)
    return nearest_x - x, nearest_y - y, side


def _nearest(points: Tensor, edges: Tensor, mask: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    x, y = points[:, None].unbind(dim=-1)  # (B, 1, P)
    to_x, to_y, squared, cross = _towards_edges(points, edges, mask)
    least, which = squared.min(dim=0, keepdim=True)
    return to_x.gather(0, which)[0] + x, to_y.gather(0, which)[0] + y, _side(squared, cross, least[0])


@torch.no_grad()
def signed_distance(points: Tensor, edges: Tensor, mask: Tensor) -> Tensor:
    """Distance (B, J, P) of points (B, P, 2) to every obstacle, negative left of its nearest edge [m]; no gradients."""
    return evaluated_by_length(_signed_distance, points, edges, mask)[0]


def _signed_distance(points: Tensor, edges: Tensor, mask: Tensor) -> tuple[Tensor]:
    _, _, squared, cross = _towards_edges(points, edges, mask)
    least = squared.amin(dim=0)
    return (torch.sqrt(least) * _side(squared, cross, least),)


def _towards_edges(points: Tensor, edges: Tensor, mask: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """From points to the nearest points of every edge: x, y, squared length, and how far right of the edge [m, m^2].

    All (E, B, J, P): with the long axis last, a CPU takes half the time it does with the edges last.
    """
    edges = edges.masked_fill(~mask[..., None], FAR)  # one point far away
    tail_x, tail_y, head_x, head_y = edges.permute(3, 2, 0, 1).contiguous()[..., None].unbind(dim=0)  # (E, B, J, 1)
    x, y = points.permute(2, 0, 1).contiguous()[:, :, None].unbind(dim=0)  # (B, 1, P)
    along_x, along_y = head_x - tail_x, head_y - tail_y
    per_square = 1 / (along_x**2 + along_y**2).clamp(min=TINY)
    offset_x, offset_y = x - tail_x, y - tail_y
    t = (offset_x * (along_x * per_square) + offset_y * (along_y * per_square)).clamp_(0.0, 1.0)
    to_x, to_y = t * along_x - offset_x, t * along_y - offset_y
    return to_x, to_y, to_x**2 + to_y**2, offset_x * along_y - offset_y * along_x


def _side(squared: Tensor, cross: Tensor, least: Tensor) -> Tensor:
    """+1 where a point is right of a nearest edge, else -1: (B, J, P).

    At a corner two edges are nearest, and the point is outside the obstacle if it is right of either. So the least
    distance is looked for once more among the edges that the point is right of; the others get a large distance.
    """
    of_right_edges = (squared + torch.relu(-cross) * (FAR**2 / TINY)).amin(dim=0)
    return (of_right_edges <= (1 + RELATIVE_TIE) * least + TIE) * 2.0 - 1.0


def nearest_obstacles(poses: Tensor, scene: Scene, most: int) -> Tensor:
    """Which obstacles (B, at most `most`) come nearest to some of the poses (B, T, 3), every other one.

    Of two that come as near, as walls do with their common corner, it is the one that is nearer in the mean.
    """
    n = scene.edges.shape[1]
    if n <= most:
        return torch.arange(n, device=poses.device).expand(len(scene), -1)
    distance = signed_distance(poses[:, ::2, :2], scene.edges, scene.mask)  # (B, J, T / 2)
    order = distance.amin(dim=2) + MEAN_SHARE * distance.mean(dim=2)
    return order.topk(most, dim=1, largest=False).indices


def surroundings(poses: Tensor, scene: Scene) -> Tensor:
    """Features (B, T, J, SURROUNDINGS) of what lies around poses (B, T, 3)."""
    b, t = poses.shape[:2]
    points = stations(poses, scene.vehicle).flatten(1, 2)
    x, y, side = (column.unflatten(2, (t, -1)) for column in nearest(points, scene.edges, scene.mask))
    theta = poses[:, None, :, 2, None]
    cos, sin = torch.cos(theta), torch.sin(theta)
    ahead, left = cos * x + sin * y, cos * y - sin * x  # (B, J, T, S)
    nearness = HALF_NEARNESS / (HALF_NEARNESS + torch.hypot(ahead, left))
    # directions weighted by nearness: what is far away hardly matters
    features = torch.stack([ahead * nearness, left * nearness, nearness, side * nearness], dim=-1)
    return features.transpose(1, 2).reshape(b, t, scene.edges.shape[1], SURROUNDINGS)
