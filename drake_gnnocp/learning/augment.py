"""Free data: labels stay what they are when obstacles of other scenes are added where they are in nobody's way."""

from __future__ import annotations

import torch
from torch import Tensor

from drake_gnnocp.learning.samples import Batch
from drake_gnnocp.learning.scene import Scene
from drake_gnnocp.learning.surroundings import WIDTH, nearest, stations

STRANGERS = 4  # obstacles of another scene offered to each
SHARE = 0.5  # of the scenes get some
ROOM = 1.5  # m, least distance of a stranger to the car along the label


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
    towards, side = nearest(points, offered.edges, offered.mask)  # (B, P, J, 2), (B, P, J)
    least = (side * torch.linalg.norm(towards, dim=-1)).amin(dim=1)
    return least > offered.vehicle[:, [WIDTH]] / 2 + ROOM
