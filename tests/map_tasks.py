"""Occupancy maps of halls and yards, drawn at random, and pairs of poses in them that no planner has chosen.

A map has a wall all around, specks as sensors leave them, and structures until the share of its cells is occupied:
rooms with doors, rows of racks, pillars, parked blocks and scattered boxes. About half of the structures run along the
cells, the rest at the map's own angle; boxes lie at any angle.
"""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from PIL import Image
from raw_cells import RawCells, rectangles

from drake_gnnocp import Vehicle

CELL = 0.05  # m
SIDE = 100.0  # m, of the usual maps
SPECKS = {"robot": 0.0005, "car": 0.00005}  # of all cells: with more than one in 50 m^2 a car gets nowhere
WALL = 0.25  # m, all around
NEARLY = 0.01  # of all cells: where less is missing, only boxes are added
NEAREST, FARTHEST = 5.0, 60.0  # m, from start to goal
OCCUPIED, FREE = 0, 254  # pixels, as map_saver writes them
YAML = "image: {}\nresolution: {}\norigin: [{}, {}, 0.0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
VEHICLES = {
    "robot": Vehicle(0.5, front_hang=0.2, rear_hang=0.2, width=0.6, v_max=1.0, a_max=1.0, phi_max=0.7, w_max=0.85),
    "car": Vehicle(),
}


@dataclass(frozen=True, eq=False)
class TaskMap:
    """A map that was drawn."""

    per_cent: float  # of its cells that are occupied
    cells: RawCells

    @cached_property
    def checksum(self) -> int:
        """Of its cells: results of other maps of the same name are none of this one."""
        return zlib.crc32(np.packbits(self.cells.occupied).tobytes())

    def write(self, folder: Path) -> Path:
        """Write the map as map_server's YAML and PGM into a folder; the path of the YAML."""
        name = f"map_{self.per_cent:g}"
        pixels = np.where(self.cells.occupied[::-1], OCCUPIED, FREE).astype(np.uint8)
        Image.fromarray(pixels).save(folder / f"{name}.pgm")
        path = folder / f"{name}.yaml"
        path.write_text(YAML.format(f"{name}.pgm", self.cells.cell, *self.cells.origin.tolist()))
        return path

    def pairs(self, vehicle: Vehicle, n: int) -> list[tuple[np.ndarray, np.ndarray]]:
        """The first n pairs of free poses (3,) x, y, theta, NEAREST to FARTHEST apart [m, m, rad]."""
        rng = np.random.default_rng([round(100 * self.per_cent), round(1000 * vehicle.length)])
        pairs: list[tuple[np.ndarray, np.ndarray]] = []
        while len(pairs) < n:
            start, goal = self._free_pose(vehicle, rng), self._free_pose(vehicle, rng)
            if NEAREST <= math.dist(start[:2], goal[:2]) <= FARTHEST:
                pairs.append((start, goal))
        return pairs

    def _free_pose(self, vehicle: Vehicle, rng: np.random.Generator) -> np.ndarray:
        size = self.cells.cell * np.array(self.cells.occupied.shape[::-1])
        while True:
            pose = np.append(self.cells.origin + rng.random(2) * size, rng.uniform(-math.pi, math.pi))
            if not self.cells.hits(footprints(vehicle, pose[None]))[0]:
                return pose


def footprints(vehicle: Vehicle, poses: np.ndarray, grown: float = 0.0) -> np.ndarray:
    """The car's rectangle, larger by a margin [m], at poses (N, 3): (N, 4, 2) corners [m]."""
    front = vehicle.wheelbase + vehicle.front_hang
    return rectangles(poses, -vehicle.rear_hang - grown, front + grown, vehicle.width / 2 + grown)


def draw_map(per_cent: float, specks: float = SPECKS["robot"], side: float = SIDE, seed: int = 0) -> TaskMap:
    """Draw a square map, of which so many per cent are occupied, and a little more; equal arguments, equal maps."""
    rng, n = np.random.default_rng([seed, round(100 * per_cent), round(side)]), round(side / CELL)
    drawing = _Drawing(rng.random((n, n)) < specks, rng.uniform(-0.4, 0.4))
    edge = round(WALL / CELL)
    for strip in (np.s_[:edge], np.s_[-edge:], np.s_[:, :edge], np.s_[:, -edge:]):
        drawing.occupied[strip] = True
    while (missing := per_cent / 100 - drawing.occupied.mean()) > 0:
        structure = _boxes if missing < NEARLY else STRUCTURES[rng.integers(len(STRUCTURES))]
        angle = float(rng.choice([0.0, drawing.angle])) + float(rng.integers(4)) * math.pi / 2
        structure(drawing.at(rng.uniform(0, side, 2), angle), rng)
    return TaskMap(per_cent, RawCells(drawing.occupied, CELL, np.array([-side / 2, -side / 2])))


@dataclass(frozen=True, eq=False)
class _Drawing:
    """Cells to draw on, in a frame of their own [m]."""

    occupied: np.ndarray  # (n, n) of bool
    angle: float  # rad, of the frame
    centre: tuple[float, float] = (0.0, 0.0)  # m, of the frame

    def at(self, centre: np.ndarray, angle: float) -> _Drawing:
        return _Drawing(self.occupied, angle, (float(centre[0]), float(centre[1])))

    def box(self, u: float, v: float, length: float, width: float, turn: float = 0.0) -> None:
        """Occupy the cells whose centres lie in a box with its centre at (u, v) of the frame, turned in it."""
        self._fill(
            u, v, math.hypot(length, width) / 2, lambda p, q: (abs(p) <= length / 2) & (abs(q) <= width / 2), turn
        )

    def disc(self, u: float, v: float, radius: float) -> None:
        """Occupy the cells whose centres lie in a disc."""
        self._fill(u, v, radius, lambda p, q: p**2 + q**2 <= radius**2)

    def _fill(self, u: float, v: float, reach: float, inside, turn: float = 0.0) -> None:  # type: ignore[no-untyped-def]
        c, s = math.cos(self.angle), math.sin(self.angle)
        x, y = self.centre[0] + c * u - s * v, self.centre[1] + s * u + c * v
        low = np.maximum(np.floor((np.array([x, y]) - reach) / CELL), 0).astype(int)
        high = np.maximum(np.ceil((np.array([x, y]) + reach) / CELL), 0).astype(int)
        window = self.occupied[low[1] : high[1], low[0] : high[0]]
        i, j = np.indices(window.shape)
        dx, dy = (low[0] + j + 0.5) * CELL - x, (low[1] + i + 0.5) * CELL - y
        c, s = math.cos(self.angle + turn), math.sin(self.angle + turn)
        window |= inside(c * dx + s * dy, c * dy - s * dx)


def _room(drawing: _Drawing, rng: np.random.Generator) -> None:
    """Four walls, each with a door or two."""
    size, thick = rng.uniform(8, 25, 2), rng.uniform(0.15, 0.3)
    for side in range(4):
        wall = drawing.at(np.array(drawing.centre), drawing.angle + side * math.pi / 2)
        length, away = size[side % 2], size[1 - side % 2] / 2
        doors = rng.uniform(1.2, 4.0, rng.integers(1, 3))
        places = np.sort(rng.uniform(-0.4, 0.4, len(doors))) * length
        begins = np.concatenate([[-length / 2], places + doors / 2])
        ends = np.concatenate([places - doors / 2, [length / 2]])
        for begin, end in zip(begins, ends, strict=True):
            if end > begin:
                wall.box((begin + end) / 2, away, end - begin, thick)


def _racks(drawing: _Drawing, rng: np.random.Generator) -> None:
    """Rows of racks with aisles between them; some bays are missing."""
    bays, bay, depth, aisle = rng.integers(3, 9), 2.7, rng.uniform(0.8, 1.4), rng.uniform(1.6, 4.5)
    rows = int(rng.integers(2, 7))
    for row in range(rows):
        for place in np.flatnonzero(rng.random(bays) < 0.9):
            drawing.box((place - bays / 2) * bay, (row - rows / 2) * (depth + aisle), bay, depth)


def _pillars(drawing: _Drawing, rng: np.random.Generator) -> None:
    """A raster of pillars, square or round."""
    (across, up), spacing, size = rng.integers(3, 7, 2), rng.uniform(5, 9), rng.uniform(0.3, 0.8)
    is_round = rng.random() < 0.5
    for u in (np.arange(across) - across / 2) * spacing:
        for v in (np.arange(up) - up / 2) * spacing:
            drawing.disc(u, v, size / 2) if is_round else drawing.box(u, v, size, size)


def _parked(drawing: _Drawing, rng: np.random.Generator) -> None:
    """Two rows of blocks of the size of cars side by side, with an aisle between them and gaps where none stands."""
    n, aisle, spacing = rng.integers(4, 11), rng.uniform(5.5, 7.0), rng.uniform(2.4, 2.9)
    for side in (-1, 1):
        for place in np.flatnonzero(rng.random(n) < 0.75):
            v = side * (aisle / 2 + 2.4) + rng.normal(0, 0.15)
            drawing.box((place - n / 2) * spacing, v, rng.uniform(1.7, 1.9), rng.uniform(4.2, 4.8), rng.normal(0, 0.03))


def _boxes(drawing: _Drawing, rng: np.random.Generator) -> None:
    """Some boxes that stand about."""
    for _ in range(rng.integers(4, 12)):
        (u, v), (length, width) = rng.normal(0, 6.0, 2), rng.uniform(0.4, 2.5, 2)
        drawing.box(u, v, length, width, rng.uniform(0, math.pi))


STRUCTURES = (_room, _racks, _pillars, _parked, _boxes)
