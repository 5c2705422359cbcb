r"""What lies around a pose: the nearest point of every obstacle to points along the car, in the car's frame.

The nearest point of an edge from a to b to a point p is a + t (b - a), t = (p - a).(b - a) / |b - a|^2 cut to [0, 1].
"""

from __future__ import annotations

import torch
from torch import Tensor

from drake_gnnocp.learning.scene import FRONT_HANG, REAR_HANG, WHEELBASE, WIDTH, Scene

STATIONS = (0.0, 0.5, 1.0)  # of the way from the rear bumper's side to the front's, see `stations`
SURROUNDINGS = 4 * len(STATIONS)  # nearest x, y, nearness and side, at each station
FAR = 1e3  # m, stands for no obstacle
TIE, ROUNDING = 1e-4, 1e-5  # m^2 and relative: squared distances nearer than this are the same, in single precision
TINY = 1e-12  # m^2, of an edge that is padding
MEAN_SHARE = 1e-3  # of the mean distance in the order of obstacles by their least one
NEAR = 2.0  # m, distances are seen as NEAR / (NEAR + distance)


def stations(poses: Tensor, vehicle: Tensor) -> Tensor:
    """Points (B, T, S, 2) on the axis of cars (B, 8) at poses (B, T, 3), half a width inside the bumpers [m]."""
    back = vehicle[:, WIDTH] / 2 - vehicle[:, REAR_HANG]
    front = vehicle[:, WHEELBASE] + vehicle[:, FRONT_HANG] - vehicle[:, WIDTH] / 2
    share = poses.new_tensor(STATIONS)
    offset = back[:, None] + share * (front - back)[:, None]  # (B, S)
    axis = torch.stack([torch.cos(poses[..., 2]), torch.sin(poses[..., 2])], dim=-1)  # (B, T, 2)
    return poses[..., None, :2] + offset[:, None, :, None] * axis[..., None, :]


def nearest(points: Tensor, edges: Tensor, mask: Tensor) -> tuple[Tensor, Tensor]:
    """Nearest points of every obstacle.

    Args:
        points: (B, P, 2) [m].
        edges: (B, J, E, 4) [m].
        mask: (B, J, E).

    Returns:
        (B, P, J, 2) nearest points relative to the points, FAR away where there is no obstacle [m]; and (B, P, J), +1
        where the point is right of the edge (outside a convex obstacle), -1 left of it.
    """
    with torch.no_grad():
        which, side = _nearest_edge(points, edges, mask)
    # once more for the edges found, with gradients
    index = which[..., None].expand(*which.shape, 4).transpose(1, 2)  # (B, J, P, 4)
    chosen = edges.gather(2, index).transpose(1, 2)  # (B, P, J, 4)
    along = chosen[..., 2:] - chosen[..., :2]
    offset = points[:, :, None] - chosen[..., :2]
    t = ((offset * along).sum(-1) / (along**2).sum(-1).clamp(min=TINY)).clamp(0.0, 1.0)
    found = t[..., None] * along - offset  # from the point to the edge
    here = mask.any(dim=-1)[:, None, :]
    return torch.where(here[..., None], found, FAR), torch.where(here, side, 1.0)


def _nearest_edge(points: Tensor, edges: Tensor, mask: Tensor) -> tuple[Tensor, Tensor]:
    """The nearest edge of every obstacle and the side on which points are of it: (B, P, J) both."""
    tail_x, tail_y, head_x, head_y = edges[:, None].unbind(dim=-1)  # (B, 1, J, E)
    along_x, along_y = head_x - tail_x, head_y - tail_y
    offset_x, offset_y = points[..., 0, None, None] - tail_x, points[..., 1, None, None] - tail_y  # (B, P, J, E)
    squared = (along_x**2 + along_y**2).clamp(min=TINY)
    t = (offset_x * (along_x / squared) + offset_y * (along_y / squared)).clamp_(0.0, 1.0)
    distance = (t * along_x - offset_x).square_() + (t * along_y - offset_y).square_()
    distance.masked_fill_(~mask[:, None], FAR**2)
    least, which = distance.min(dim=-1)
    # at a corner two edges are nearest: the point is outside if it is outside of either
    outside = offset_x * along_y > along_x * offset_y
    outside &= distance <= ((1 + ROUNDING) * least + TIE)[..., None]
    return which, outside.any(dim=-1) * 2.0 - 1.0


def nearest_obstacles(poses: Tensor, scene: Scene, most: int) -> Tensor:
    """Which obstacles (B, at most `most`) come nearest to some of the poses (B, T, 3), every other one.

    Of two that come as near, as walls do with their common corner, it is the one that is nearer in the mean.
    """
    n = scene.edges.shape[1]
    if n <= most:
        return torch.arange(n, device=poses.device).expand(len(scene), -1)
    towards, side = nearest(poses[:, ::2, :2], scene.edges, scene.mask)
    distance = side * torch.linalg.norm(towards, dim=-1)  # (B, T / 2, J)
    order = distance.amin(dim=1) + MEAN_SHARE * distance.mean(dim=1)
    return order.topk(most, dim=1, largest=False).indices


def surroundings(poses: Tensor, scene: Scene) -> Tensor:
    """Features (B, T, J, SURROUNDINGS) of what lies around poses (B, T, 3)."""
    b, t = poses.shape[:2]
    points = stations(poses, scene.vehicle)
    towards, side = nearest(points.flatten(1, 2), scene.edges, scene.mask)  # (B, T S, J, 2)
    towards = towards.unflatten(1, (t, len(STATIONS)))
    cos, sin = torch.cos(poses[..., 2])[..., None, None], torch.sin(poses[..., 2])[..., None, None]
    ahead, left = cos * towards[..., 0] + sin * towards[..., 1], cos * towards[..., 1] - sin * towards[..., 0]
    nearness = NEAR / (NEAR + torch.hypot(ahead, left))  # (B, T, S, J)
    # directions weighted by nearness: what is far away hardly matters
    features = torch.stack([ahead * nearness, left * nearness, nearness, side.unflatten(1, (t, -1)) * nearness], dim=-1)
    return features.transpose(2, 3).reshape(b, t, scene.edges.shape[1], SURROUNDINGS)
