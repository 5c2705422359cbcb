"""Free data: labels stay what they are when obstacles or walls are added where they are in nobody's way."""

from __future__ import annotations

import torch
from torch import Tensor

from drake_gnnocp.experiments.training.samples import Batch
from drake_gnnocp.learning.scene import FRONT_HANG, REAR_HANG, WHEELBASE, WIDTH, Scene, into_frame
from drake_gnnocp.learning.surroundings import signed_distance, stations

STRANGERS = 4  # obstacles of another scene offered to each
SHARE = 0.5  # of the scenes get some
ROOM = 1.5  # m, least distance of a stranger to the car along the label
WALLED = 0.25  # of the batches get walls
LEAST_GAP, MOST_GAP = 0.2, 8.0  # m, between a wall and the car where the label comes nearest to it


def with_strangers(batch: Batch, generator: torch.Generator) -> Batch:
    """A batch in which some scenes have obstacles of another one as well, away from the label's path.

    What is added can only take other ways from the solver: the label is a local optimum as before (but for the pull of
    the cost's proximity term, which fades within ROOM).
    """
    scene, device = batch.scene, batch.duration.device
    n, j = scene.mask.shape[:2]
    other = torch.randperm(n, generator=generator, device=device)
    picks = torch.randint(j, (n, STRANGERS), generator=generator, device=device)
    rows = other[:, None]
    edges, mask = scene.edges[rows, picks], scene.mask[rows, picks]
    offered = Scene(edges, mask, scene.goal, scene.vehicle)
    keep = _out_of_the_way(batch.states, offered)
    keep &= torch.rand(n, 1, generator=generator, device=device) < SHARE
    joined = Scene(
        torch.cat([scene.edges, edges], dim=1),
        torch.cat([scene.mask, mask & keep[..., None]], dim=1),
        scene.goal,
        scene.vehicle,
    )
    return Batch(joined, batch.states, batch.duration)


def _out_of_the_way(states: Tensor, offered: Scene) -> Tensor:
    """Which obstacles (B, J) are far enough from the car at all states (B, T, 5)."""
    points = stations(states[..., :3], offered.vehicle).flatten(1, 2)
    least = signed_distance(points, offered.edges, offered.mask).amin(dim=2)
    return least > offered.vehicle[:, [WIDTH]] / 2 + ROOM


def with_walls(batch: Batch, generator: torch.Generator) -> Batch:
    """A batch whose scenes have bounds, as scenarios may: a box of any direction around the label.

    Most batches are left as they are: maps of the dataset have no bounds, and most scenarios neither.
    """
    scene, device = batch.scene, batch.duration.device
    n = len(scene)
    share, angle, gap = (
        torch.rand(1, generator=generator, device=device),
        torch.rand(n, generator=generator, device=device) * torch.pi / 2,
        torch.rand(n, 4, generator=generator, device=device),
    )
    if share > WALLED:
        return batch
    gap = LEAST_GAP + (MOST_GAP - LEAST_GAP) * gap**2
    frame = torch.cat([torch.zeros(n, 2, device=device), angle[:, None]], dim=1)
    swept = into_frame(_corners(batch.states, scene.vehicle).flatten(1, 2), frame)  # (B, 4 T, 2) seen from the box
    low, high = swept.amin(dim=1) - gap[:, :2], swept.amax(dim=1) + gap[:, 2:]
    (x0, y0), (x1, y1) = low.unbind(dim=1), high.unbind(dim=1)
    # clockwise, as in `vectors_of`: the free side is on the right
    ring = torch.stack([torch.stack([x0, x0, x1, x1], dim=1), torch.stack([y0, y1, y1, y0], dim=1)], dim=-1)
    ring = into_frame(ring, -frame)
    edges = scene.edges.new_zeros(n, 4, scene.edges.shape[2], 4)
    edges[:, :, 0] = torch.cat([ring, ring.roll(-1, dims=1)], dim=-1)
    mask = torch.zeros(edges.shape[:3], dtype=torch.bool, device=device)
    mask[:, :, 0] = True
    joined = Scene(
        torch.cat([scene.edges, edges], dim=1), torch.cat([scene.mask, mask], dim=1), scene.goal, scene.vehicle
    )
    return Batch(joined, batch.states, batch.duration)


def _corners(states: Tensor, vehicle: Tensor) -> Tensor:
    """Corners (B, T, 4, 2) of cars (B, 8) at states (B, T, 5) [m]."""
    back, front, half = -vehicle[:, REAR_HANG], vehicle[:, WHEELBASE] + vehicle[:, FRONT_HANG], vehicle[:, WIDTH] / 2
    along = torch.stack([back, front, front, back], dim=1)[:, None]  # (B, 1, 4)
    across = torch.stack([-half, -half, half, half], dim=1)[:, None]
    x, y, theta = states[..., :3, None].unbind(dim=2)
    cos, sin = torch.cos(theta), torch.sin(theta)
    return torch.stack([x + cos * along - sin * across, y + sin * along + cos * across], dim=-1)
