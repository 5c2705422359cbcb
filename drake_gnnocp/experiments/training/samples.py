"""The dataset as tensors, in lengths of the car as it is planned in, and batches, mirrored and reversed at random."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from drake_gnnocp.experiments.dataset.records import MapRecord
from drake_gnnocp.experiments.tasks.place import TIGHT
from drake_gnnocp.learning.scene import (
    Scene,
    into_frame,
    mirrored,
    padded,
    reversed_in_time,
    states_into_frame,
    vectors_of,
    vehicle_row,
)
from drake_gnnocp.vehicle import State

BATCHES_SORTED = 16  # batches among which samples are sorted by their number of obstacles


@dataclass(frozen=True)
class Batch:
    """Scenes with their labels, in the frames of the starts."""

    scene: Scene
    states: Tensor  # (B, T, 5) [m, m, rad, m/s, rad]
    duration: Tensor  # (B,) [s]


@dataclass(frozen=True)
class Samples:
    """Verified trajectories on M maps, in the frames of the maps."""

    edges: Tensor  # (M, J, E, 4) [m]
    mask: Tensor  # (M, J, E)
    vehicle: Tensor  # (M, 8)
    is_tight: Tensor  # (M,) bool
    map: Tensor  # (S,) row of the map
    states: Tensor  # (S, T, 5) at equal steps [m, m, rad, m/s, rad]
    duration: Tensor  # (S,) [s]

    def __len__(self) -> int:
        return len(self.duration)

    @classmethod
    def of(cls, records: Iterable[MapRecord], points: int) -> Samples:
        """The kept trajectories of maps, at `points` points each."""
        solved = [record for record in records if record.trajectories]
        scenes = [record.tasks[0].in_car_lengths for record in solved]
        kept = [
            (row, trajectory.scaled(1 / scene.unit))
            for row, (record, scene) in enumerate(zip(solved, scenes, strict=True))
            for trajectory in record.trajectories
        ]
        vectors = [vectors_of(scene) for scene in scenes]
        return cls(
            torch.tensor(padded([edges for edges, _ in vectors])).float(),
            torch.tensor(padded([mask for _, mask in vectors])),
            torch.tensor([vehicle_row(scene.vehicle) for scene in scenes]),
            torch.tensor([record.place.kind == TIGHT for record in solved]),
            torch.tensor([row for row, _ in kept]),
            torch.tensor(np.array([trajectory.resampled(points).states for _, trajectory in kept])).float(),
            torch.tensor([trajectory.duration for _, trajectory in kept]).float(),
        )

    def with_more_tight(self, times: int) -> Samples:
        """With those in tight places so many times: there are few of them."""
        rows = torch.arange(len(self))
        rows = torch.cat([rows, rows[self.is_tight[self.map]].repeat(times - 1)])
        return replace(self, map=self.map[rows], states=self.states[rows], duration=self.duration[rows])

    def random_batches(self, size: int, generator: torch.Generator) -> list[Tensor]:
        """All samples in random batches of rows, each of samples with about as many obstacles: less is padding."""
        order = torch.randperm(len(self), generator=generator, device=self.duration.device)
        obstacles = self.mask.any(dim=2).sum(dim=1)[self.map]
        batches: list[Tensor] = []
        for some in order.split(size * BATCHES_SORTED):
            batches += some[torch.argsort(obstacles[some], stable=True)].split(size)
        shuffled = torch.randperm(len(batches), generator=generator, device=order.device)
        return [batches[i] for i in shuffled.tolist()]

    def batch(self, rows: Tensor, mirror: Tensor, reverse: Tensor) -> Batch:
        """Samples `rows` (B,), some of them mirrored or reversed in time: (B,) bool each."""
        of_map = self.map[rows]
        mask = self.mask[of_map]
        n_obstacles, n_edges = _used(mask.any(dim=2)), _used(mask.any(dim=1))
        edges, mask = self.edges[of_map, :n_obstacles, :n_edges], mask[:, :n_obstacles, :n_edges]
        states = self.states[rows]
        states = torch.where(reverse[:, None, None], reversed_in_time(states), states)
        frames = states[:, 0, : State.V]
        local = states_into_frame(states, frames)
        goal = local[:, -1, : State.V].clone()
        turns = torch.round(goal[:, State.THETA] / (2 * torch.pi))
        goal[:, State.THETA] -= 2 * torch.pi * turns
        scene = Scene(into_frame(edges, frames), mask, goal, self.vehicle[of_map])
        seen, seen_states = mirrored(scene, local)
        scene = Scene(
            torch.where(mirror[:, None, None, None], seen.edges, scene.edges),
            mask,
            torch.where(mirror[:, None], seen.goal, scene.goal),
            scene.vehicle,
        )
        return Batch(scene, torch.where(mirror[:, None, None], seen_states, local), self.duration[rows])

    def plain_batch(self, rows: Tensor) -> Batch:
        """Samples as they are."""
        never = torch.zeros(len(rows), dtype=torch.bool)
        return self.batch(rows, never, never)

    def random_batch(self, rows: Tensor, generator: torch.Generator) -> Batch:
        """Samples, each mirrored and reversed with even odds."""
        coins = torch.rand(2, len(rows), generator=generator) < 0.5
        return self.batch(rows, coins[0], coins[1])


def _used(mask: Tensor) -> int:
    """How many columns of a mask (B, N) are used, at least 1."""
    used = mask.any(dim=0).nonzero()
    return int(used.max()) + 1 if len(used) else 1
