r"""Where the car starts and stops on a place: in a slot or anywhere, but where a way is not out of the question.

Away from slots the car mostly stands between things, and along the aisle or the corridor it is in. Both are told from
what can be seen from there. With r(beta) the sight in direction beta, cut off at some distance, a place is open where
the mean of r is large, and the direction of an aisle is the principal axis of what is seen: half the angle of
sum r(beta)^2 exp(2 i beta).

A disc as wide as the car, around the middle of its rectangle, moves along with the car. Where the disc cannot get from
one end to the other, the car cannot either, and such ends are not taken.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import shapely

from drake_gnnocp.experiments.tasks.open_maps import TaskOptions, random_ends
from drake_gnnocp.experiments.tasks.place import TIGHT, Place, are_clear, union

SLOT_SHARE = 0.7  # of the tasks begin or end in a slot, where the place has any
LEAVING_SHARE = 1 / 3  # of these begin in it
ALONG_SHARE = 0.75  # of the other ends stand along the aisle
ALONG_SPREAD = 0.08  # rad, standard deviation of their headings
SIGHT = 12.0  # m, and no further
OPEN_SIGHT = 7.5  # m, in the mean: in the open it is longer, in aisles up to 7 m wide shorter
OPEN_SHARE = 0.25  # of the poses drawn in the open are taken
BETA = np.arange(24) * math.pi / 12  # rad, where to look
AROUND = 20.0  # m, how far from the area the disc may go round things
POSES, PAIRS = 300, 50  # most draws of a pose, and of a pair before the place is given up
DEFAULT_OPTIONS = TaskOptions()
IN_TIGHT_PLACES = TaskOptions(distance=(3.0, 25.0), clearance=0.05, unobstructed=1.0)  # for a car of the usual length


def random_ends_of(
    rng: np.random.Generator, place: Place, options: TaskOptions | None = None
) -> tuple[np.ndarray, np.ndarray] | None:
    """Start and goal, (3,) x, y, theta each [m, m, rad], collision-free and with the car inside the place's area.

    Args:
        rng: source of randomness.
        place: an open map, a car park or a yard.
        options: distance of the ends and clearance of those that are not slots; None: what suits the place.

    Returns:
        None where the place gives none after many draws.
    """
    options = options or _options_of(place)
    if place.kind == "open":
        return random_ends(rng, place.obstacles, place.area[1] - place.area[0], options)
    site = _Site(place)
    in_slot = bool(place.slots) and rng.uniform() < SLOT_SHARE
    leaving = in_slot and rng.uniform() < LEAVING_SHARE
    may_be_free = in_slot or rng.uniform() < options.unobstructed
    for _ in range(PAIRS):
        free = site.free_pose(rng, options.clearance)
        other = site.slot(rng) if in_slot else site.free_pose(rng, options.clearance)
        if free is None or other is None:
            continue
        line = shapely.LineString([free[:2], other[:2]])
        if (
            options.distance[0] <= line.length <= options.distance[1]
            and (may_be_free or site.blocked.dwithin(line, place.vehicle.width / 2))
            and site.has_a_way(free, other)
        ):
            return (other, free) if leaving else (free, other)
    return None


def _options_of(place: Place) -> TaskOptions:
    if place.kind != TIGHT:
        return DEFAULT_OPTIONS
    unit = place.vehicle.size
    nearest, farthest = IN_TIGHT_PLACES.distance
    return replace(
        IN_TIGHT_PLACES, distance=(unit * nearest, unit * farthest), clearance=unit * IN_TIGHT_PLACES.clearance
    )


class _Site:
    """A place as poses are looked for in it."""

    def __init__(self, place: Place) -> None:
        self.place = place
        self.blocked = union(place.obstacles, place.lines)
        shapely.prepare(self.blocked)
        self._vertices = np.concatenate([*place.obstacles, *(line[:-1] for line in place.lines)])
        edges = [np.roll(ring, -1, axis=0) - ring for ring in place.obstacles]
        self._edges = np.concatenate([*edges, *(np.diff(line, axis=0) for line in place.lines)])
        self._regions = self._disc_regions()

    def slot(self, rng: np.random.Generator) -> np.ndarray:
        """Pose (3,) of one of the slots."""
        return self.place.slots[int(rng.integers(len(self.place.slots)))].copy()

    def free_pose(self, rng: np.random.Generator, clearance: float) -> np.ndarray | None:
        """A pose (3,) anywhere in the area, or None where none is found."""
        poses = (self._pose(rng, clearance) for _ in range(POSES))
        return next((pose for pose in poses if pose is not None), None)

    def has_a_way(self, start: np.ndarray, goal: np.ndarray) -> bool:
        """Whether the disc's middle can get from one pose (3,) to the other."""
        middles = self.place.vehicle.footprints(np.stack([start, goal])).mean(axis=1)
        contained = shapely.contains(self._regions[:, None], shapely.points(middles))
        return bool(contained.all(axis=1).any())

    def _pose(self, rng: np.random.Generator, clearance: float) -> np.ndarray | None:
        """The next pose (3,), or None where it is not free, or in the open."""
        area, vehicle = self.place.area, self.place.vehicle
        point, heading = rng.uniform(area[0::2], area[1::2]), rng.uniform(-math.pi, math.pi)
        is_along, takes_open = rng.uniform(size=2) < (ALONG_SHARE, OPEN_SHARE)
        off, turned = rng.normal(0.0, ALONG_SPREAD), rng.integers(2) * math.pi
        if self.blocked.dwithin(shapely.Point(point), vehicle.width / 2):
            return None
        sight = self._sight(point)
        if sight.mean() > OPEN_SIGHT and not takes_open:
            return None
        if is_along:
            axis = float(np.angle(np.sum(sight**2 * np.exp(2j * BETA)))) / 2
            heading = math.remainder(axis + off + turned, 2 * math.pi)
        pose = np.array([*point, heading])
        return pose if are_clear(vehicle, pose[None], self.blocked, area, clearance)[0] else None

    def _sight(self, point: np.ndarray) -> np.ndarray:
        """How far one sees from a point (2,) in the directions BETA: (len(BETA),) [m].

        The ray r u from the point meets the edge p + s d where r = p x d / u x d and s = p x u / u x d.
        """
        u, d = np.column_stack([np.cos(BETA), np.sin(BETA)])[:, None], self._edges
        p = self._vertices - point
        with np.errstate(divide="ignore", invalid="ignore"):  # parallel ones never meet: NaN and infinity compare so
            r, s = _cross(p, d) / _cross(u, d), _cross(p, u) / _cross(u, d)
            meets = (r >= 0.0) & (s >= 0.0) & (s <= 1.0)
        return np.where(meets, r, SIGHT).min(axis=1).clip(max=SIGHT)

    def _disc_regions(self) -> np.ndarray:
        """The connected regions in which the middle of the disc can move: polygons."""
        xmin, xmax, ymin, ymax = self.place.area
        world = shapely.box(xmin - AROUND, ymin - AROUND, xmax + AROUND, ymax + AROUND)
        # the buffer's outline runs inside the true one: what it takes away is blocked for sure
        regions = shapely.get_parts(world.difference(self.blocked.buffer(self.place.vehicle.width / 2, quad_segs=4)))
        shapely.prepare(regions)
        return np.asarray(regions)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
