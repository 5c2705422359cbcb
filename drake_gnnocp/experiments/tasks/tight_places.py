"""Random tight places, as real cars meet them: slots, garages, corridors and rooms with hardly any room beside the car.

Every place is laid out around one spot, in the frame of the car's size: lengths that are given for a car of the usual
length grow and shrink with the car. What stands around is a parked car, a wall of some thickness, or a line without
any, as perception and drawings give it; some places are bounded by a box instead of walls.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import shapely

from drake_gnnocp.experiments.tasks.place import TIGHT, Area, Place, are_clear, union
from drake_gnnocp.experiments.tasks.shapes import Range, both_ways, box, moved, moved_poses, rectangle, standing
from drake_gnnocp.experiments.tasks.tight_vehicles import log_uniform, random_tight_vehicle
from drake_gnnocp.vehicle import Vehicle

LEAST_CLEARANCE = 0.015  # m, of the car in a slot, for such a car
SQUARE = math.pi / 2


@dataclass(frozen=True)
class TightOptions:
    """Sizes [m] for a car of the usual length."""

    shares: tuple[float, ...] = (0.24, 0.22, 0.12, 0.14, 0.18, 0.1)  # of the places, in the order of LAYOUTS
    side: Range = (0.05, 0.4)  # on each side of the car in a slot; drawn by its logarithm
    behind: Range = (0.1, 0.6)  # between a slot's end and the car
    aisle: Range = (3.6, 6.5)  # in front of perpendicular slots; in front of slanted ones narrower
    slanted_aisle: Range = (3.0, 5.0)
    slant: Range = (0.5, 1.1)  # rad
    extra: Range = (0.5, 1.5)  # length of a parallel slot over the car's
    kerb: Range = (0.02, 0.3)  # from a parallel slot's car to the kerb
    lane: Range = (2.8, 4.5)  # beside a parallel slot's car
    door: Range = (0.08, 0.35)  # on each side of the car in a garage's door
    court: Range = (4.8, 8.0)  # in front of a garage, and half of that more to its sides
    corridor: Range = (2.9, 4.6)  # width
    leg: Range = (4.0, 9.0)  # of a corridor, beyond its corners
    room: Range = (5.5, 11.0)  # mean radius of an irregular room
    reach: Range = (7.0, 13.0)  # of an aisle or a lane to either side
    closed: float = 0.4  # share of the ends of aisles and lanes that are closed
    thickness: Range = (0.1, 0.5)  # of walls


DEFAULT_OPTIONS = TightOptions()


@dataclass(eq=False)
class _Layout:
    """A place while it is laid out, in metres of a car of the usual length."""

    rings: list[np.ndarray] = field(default_factory=list)  # (N, 2)
    lines: list[np.ndarray] = field(default_factory=list)  # (N, 2)
    slots: list[np.ndarray] = field(default_factory=list)  # (3,)


@dataclass(frozen=True, eq=False)
class _Draw:
    """What layouts are drawn with."""

    rng: np.random.Generator
    vehicle: Vehicle  # as long as the usual car
    options: TightOptions
    style: str  # of what stands around: "cars", "walls" or "lines"

    def of(self, bounds: Range) -> float:
        """A number between two."""
        return float(self.rng.uniform(*bounds))

    def side(self) -> float:
        """The free room on one side of the car [m]."""
        return log_uniform(self.rng, self.options.side)

    def chance(self, share: float) -> bool:
        """Whether something with a probability happens."""
        return bool(self.rng.uniform() < share)

    def add_wall(self, layout: _Layout, corners: np.ndarray) -> None:
        """A wall to the left of a polyline (N, 2), or the line itself."""
        if self.style == "lines" or (self.style == "cars" and self.chance(0.5)):
            layout.lines.append(corners)
            return
        wall = shapely.LineString(corners).buffer(
            self.of(self.options.thickness), single_sided=True, join_style="mitre"
        )
        layout.rings.append(np.asarray(wall.exterior.coords)[:-1])


def random_tight_place(rng: np.random.Generator, options: TightOptions = DEFAULT_OPTIONS) -> Place:
    """A tight place with at least one spot for its vehicle."""
    while True:
        vehicle = random_tight_vehicle(rng)
        unit = vehicle.size
        make = LAYOUTS[int(rng.choice(len(LAYOUTS), p=options.shares))]
        draw = _Draw(rng, vehicle.scaled(1 / unit), options, str(rng.choice(("cars", "walls", "lines"))))
        layout = make(draw)
        if layout.slots and (place := _placed(rng, layout, vehicle, unit)).slots:
            return place


def _placed(rng: np.random.Generator, layout: _Layout, vehicle: Vehicle, unit: float) -> Place:
    """The layout, turned and at its size, with the slots in which the car can stand."""
    is_upright = rng.uniform() < 0.5
    turn = float(rng.integers(4)) * SQUARE if is_upright else rng.uniform(-math.pi, math.pi)
    frame = np.array([0.0, 0.0, turn])
    rings = [unit * moved(ring, frame) for ring in layout.rings]
    lines = [unit * moved(line, frame) for line in layout.lines]
    slots = moved_poses(np.array(layout.slots), frame) * (unit, unit, 1.0)
    points = np.concatenate([*rings, *lines, vehicle.footprints(slots).reshape(-1, 2)])
    low, high = points.min(axis=0), points.max(axis=0)
    area: Area = (float(low[0]), float(high[0]), float(low[1]), float(high[1]))
    clear = are_clear(vehicle, slots, union(rings, lines), area, LEAST_CLEARANCE * unit)
    is_bounded = bool(is_upright and rng.uniform() < 0.5)
    return Place(TIGHT, area, tuple(rings), tuple(slots[clear]), vehicle, tuple(lines), is_bounded)


def _neighbour(draw: _Draw, layout: _Layout, inner: float, depth: float) -> None:
    """What stands beside a slot along the y axis: from x = `inner` on away from that axis, as deep as the slot."""
    away = math.copysign(1.0, inner)
    if draw.style == "cars":
        width, length = draw.of((1.7, 2.0)), draw.of((4.2, 5.0))
        centre = np.array([inner + away * width / 2, draw.of((0.0, 0.4)) + length / 2])
        layout.rings.append(moved(rectangle(length, width), (*centre, SQUARE)))
        return
    wall = np.array([[inner, depth], [inner, draw.of((-0.1, 0.3))]])
    draw.add_wall(layout, wall if away > 0 else wall[::-1])


def _street(draw: _Draw, layout: _Layout, low: float, high: float) -> None:
    """The far side of an aisle at y = `low`; its ends, up to y = `high`, are closed now and then."""
    left, right = -draw.of(draw.options.reach), draw.of(draw.options.reach)
    corners = [[left, low], [right, low]]
    if draw.chance(draw.options.closed):
        corners.insert(0, [left, high])
    if draw.chance(draw.options.closed):
        corners.append([right, high])
    draw.add_wall(layout, np.array(corners[::-1]))


def _perpendicular(draw: _Draw) -> _Layout:
    """A slot square to an aisle; y = 0 is its mouth."""
    layout, vehicle = _Layout(), draw.vehicle
    depth = vehicle.length + draw.of(draw.options.behind) + draw.of((0.0, 0.4))
    left, right = draw.side(), draw.side()
    _neighbour(draw, layout, -vehicle.width / 2 - left, depth)
    _neighbour(draw, layout, vehicle.width / 2 + right, depth)
    if draw.chance(0.7):
        draw.add_wall(layout, np.array([[-4.0, depth], [4.0, depth]]))
    _street(draw, layout, -draw.of(draw.options.aisle), 0.0)
    middle = depth - draw.of(draw.options.behind) - vehicle.length / 2
    layout.slots += both_ways(vehicle, np.array([0.0, middle]), SQUARE)
    return layout


def _slanted(draw: _Draw) -> _Layout:
    """An echelon slot between two others."""
    layout, vehicle = _Layout(), draw.vehicle
    slant = draw.of(draw.options.slant) * (1 if draw.chance(0.5) else -1)
    sides = np.array([-1.0, 1.0]) * (vehicle.width + np.array([draw.side(), draw.side()]))
    heading = SQUARE + slant
    axis, across = _axes(heading)
    for away in sides:
        shape = rectangle(draw.of((4.2, 5.0)), draw.vehicle.width)
        centre = away * across + draw.of((-0.4, 0.4)) * axis
        if draw.style == "cars":
            layout.rings.append(moved(shape, (*centre, heading)))
        else:
            inner = math.copysign(abs(away) - vehicle.width / 2, away) * across
            wall = np.stack([inner + 2.4 * axis, inner - 2.2 * axis])
            draw.add_wall(layout, wall[::-1] if away > 0 else wall)
    lowest = float(moved(rectangle(vehicle.length, vehicle.width), (0.0, 0.0, heading))[:, 1].min())
    _street(draw, layout, lowest - draw.of(draw.options.slanted_aisle), lowest)
    layout.slots += both_ways(vehicle, np.zeros(2), heading)
    return layout


def _axes(heading: float) -> tuple[np.ndarray, np.ndarray]:
    """The unit vectors along a heading [rad], and to its left."""
    cos, sin = math.cos(heading), math.sin(heading)
    return np.array([cos, sin]), np.array([-sin, cos])


def _parallel(draw: _Draw) -> _Layout:
    """A slot along a lane, between two cars or walls, with a kerb."""
    layout, vehicle = _Layout(), draw.vehicle
    half = (vehicle.length + draw.of(draw.options.extra)) / 2
    kerb = vehicle.width / 2 + draw.of(draw.options.kerb)
    for away in (-1.0, 1.0):
        length, width = draw.of((3.5, 5.0)), draw.of((1.7, 2.0))
        begin = max(vehicle.width / 2 - width + draw.of((-0.15, 0.1)), 0.02 - kerb)
        far = sorted((away * half, away * (half + length)))
        layout.rings.append(box(far[0], far[1], begin, begin + width))
    reach = half + 6.0
    draw.add_wall(layout, np.array([[reach, -kerb], [-reach, -kerb]]))
    top = vehicle.width / 2 + draw.of(draw.options.lane)
    draw.add_wall(layout, np.array([[-reach, top], [reach, top]]))
    heading = math.pi * draw.rng.integers(2)
    slack = half - vehicle.length / 2
    layout.slots.append(standing(vehicle, np.array([draw.of((-0.3, 0.3)) * slack, 0.0]), heading))
    return layout


def _garage(draw: _Draw) -> _Layout:
    """A garage with a narrow door, in front of it a court with walls around."""
    layout, vehicle, options = _Layout(), draw.vehicle, draw.options
    door = vehicle.width / 2 + draw.of(options.door)
    inside = door + draw.of((0.0, 0.5))
    depth, court = vehicle.length + 2 * draw.of(options.behind), draw.of(options.court)
    left, right = inside + draw.of((1.5, options.court[1] / 2)), inside + draw.of((1.5, options.court[1] / 2))
    lip = draw.of((0.1, 0.4))  # of the wall that the door is in
    outline = [[-left, 0.0], [-door, 0.0], [-door, lip], [-inside, lip], [-inside, depth]]
    outline += [[inside, depth], [inside, lip], [door, lip], [door, 0.0], [right, 0.0]]
    around = [[right, -court], [-left, -court]]
    if draw.chance(0.6):  # all around
        draw.add_wall(layout, np.array([*outline, *around, outline[0]]))
    else:
        draw.add_wall(layout, np.array(outline))
        draw.add_wall(layout, np.array(around))
    layout.slots += both_ways(vehicle, np.array([0.0, lip / 2 + depth / 2]), SQUARE)
    return layout


def _corridor(draw: _Draw) -> _Layout:
    """A corridor with one corner or two, or a T; its ends are dead ends now and then."""
    layout, vehicle, options = _Layout(), draw.vehicle, draw.options
    width, kind = draw.of(options.corridor), draw.rng.integers(3)
    first, second, third = (draw.of(options.leg) for _ in range(3))
    turn = 1.0 if draw.chance(0.5) else -1.0
    centre = [np.array([[-first, 0.0], [0.0, 0.0], [0.0, turn * second]])]
    if kind == 1:  # S, or U
        third *= 1.0 if draw.chance(0.7) else -1.0
        centre = [np.array([[-first, 0.0], [0.0, 0.0], [0.0, turn * second], [third, turn * second]])]
    elif kind == 2:  # T
        centre = [np.array([[-first, 0.0], [third, 0.0]]), np.array([[0.0, 0.0], [0.0, turn * second]])]
    free = shapely.union_all(
        [shapely.LineString(line).buffer(width / 2, cap_style="flat", join_style="mitre") for line in centre]
    )
    ring = np.asarray(free.exterior.coords)[:-1]
    is_open = not draw.chance(0.5)
    first_edge = int(np.argmin(np.linalg.norm((ring + np.roll(ring, -1, axis=0)) / 2 - centre[0][0], axis=1)))
    ring = np.roll(ring, -first_edge - 1, axis=0)  # begins and ends at the first end of the corridor
    draw.add_wall(layout, (ring if is_open else np.concatenate([ring, ring[:1]]))[::-1])
    ends = [(line[0], line[0] - line[1]) for line in centre] + [(line[-1], line[-1] - line[-2]) for line in centre]
    for place, outwards in ends:
        heading = math.atan2(outwards[1], outwards[0])
        back = vehicle.length / 2 + draw.of((0.3, 1.0))
        across = draw.of((-0.5, 0.5)) * max(width - vehicle.width - 0.2, 0.0)
        axis, left = _axes(heading)
        if np.linalg.norm(place) > 1e-6:  # the T's middle is no end
            layout.slots += both_ways(vehicle, place - back * axis + across * left, heading)
    return layout


def _room(draw: _Draw) -> _Layout:
    """A room with an irregular outline of hundreds of vertices, and one thing or two in it."""
    layout, vehicle = _Layout(), draw.vehicle
    outline = _wavy(draw, draw.of(draw.options.room), int(draw.rng.integers(200, 701)), closed=True)
    layout.lines.append(outline)
    for _ in range(int(draw.rng.integers(3))):
        at, turn = draw.rng.uniform(-5.0, 5.0, 2), draw.of((-math.pi, math.pi))
        thing = _wavy(draw, draw.of((0.4, 1.5)), int(draw.rng.integers(30, 200)), closed=False)
        layout.rings.append(moved(thing, (*at, turn)))
    beta = draw.rng.uniform(-math.pi, math.pi, 12)
    distance = draw.rng.uniform(2.0, draw.options.room[1], 12)
    middles = distance[:, None] * np.column_stack([np.cos(beta), np.sin(beta)])
    inside = shapely.contains(shapely.Polygon(outline), shapely.points(middles))
    for middle, angle in zip(middles[inside], beta[inside], strict=True):
        layout.slots.append(standing(vehicle, middle, angle + draw.rng.normal(0.0, 0.3)))
    return layout


def _wavy(draw: _Draw, radius: float, n: int, closed: bool) -> np.ndarray:
    """A star-shaped outline of n vertices whose radius varies by some waves, and a little from vertex to vertex."""
    beta = np.linspace(-math.pi, math.pi, n, endpoint=False)
    waves = np.arange(2, 8)
    size, phase = draw.rng.normal(0.0, 0.25, len(waves)) / waves, draw.rng.uniform(-math.pi, math.pi, len(waves))
    r = radius * np.exp(size @ np.cos(waves[:, None] * beta + phase[:, None]) + draw.rng.normal(0.0, 0.004, n))
    ring = r[:, None] * np.column_stack([np.cos(beta), np.sin(beta)])
    return np.concatenate([ring, ring[:1]]) if closed else ring


LAYOUTS: tuple[Callable[[_Draw], _Layout], ...] = (_perpendicular, _parallel, _slanted, _garage, _corridor, _room)
