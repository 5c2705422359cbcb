"""Map `index` of a seed, and its tasks: the same whatever else is drawn.

Of the first PAPER_MAPS maps two of three are open ones as in the paper, with varying numbers of obstacles, and one is a
car park or a yard. The maps after them are car parks and yards, where a guess fails more often, and those after
WIDE_MAPS are tight places.
"""

from __future__ import annotations

import numpy as np

from drake_gnnocp.experiments.tasks.car_parks import random_car_park
from drake_gnnocp.experiments.tasks.ends import random_ends_of
from drake_gnnocp.experiments.tasks.open_maps import MapOptions, random_obstacles
from drake_gnnocp.experiments.tasks.place import TIGHT, Place
from drake_gnnocp.experiments.tasks.tight_places import random_tight_place
from drake_gnnocp.experiments.tasks.yards import random_yard
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.vehicle import Vehicle

PAPER_MAPS, WIDE_MAPS = 800, 1060
OBSTACLES = (3, 14)  # fewest and most on an open map
PLACE, PAIRS = 0, 1  # last word of the seeds


def kind_of(index: int) -> str:
    """What map `index` is: one of KINDS."""
    if index >= WIDE_MAPS:
        return TIGHT
    if index >= PAPER_MAPS:
        return "car_park" if index % 2 == 0 else "yard"
    if index % 3 < 2:
        return "open"
    return "car_park" if index // 3 % 2 == 0 else "yard"


def draw_place(seed: int, index: int) -> Place:
    """Map `index` of a seed."""
    rng = np.random.default_rng([seed, index, PLACE])
    kind = kind_of(index)
    if kind == "car_park":
        return random_car_park(rng)
    if kind == "yard":
        return random_yard(rng)
    if kind == TIGHT:
        return random_tight_place(rng)
    options = MapOptions(n_obstacles=int(rng.integers(OBSTACLES[0], OBSTACLES[1] + 1)))
    area = (0.0, options.side, 0.0, options.side)
    return Place("open", area, random_obstacles(rng, options), (), Vehicle())


def draw_tasks(seed: int, index: int, place: Place, n: int) -> list[Scenario]:
    """Up to n tasks on map `index` of a seed; fewer where the map has no room for more."""
    drawn = (draw_task(seed, index, place, pair) for pair in range(n))
    return [task for task in drawn if task is not None]


def draw_task(seed: int, index: int, place: Place, pair: int) -> Scenario | None:
    """The task of one pair of start and goal on map `index` of a seed; None where the map has no room for it."""
    ends = random_ends_of(np.random.default_rng([seed, index, PAIRS, pair]), place)
    if ends is None:
        return None
    name = f"{place.kind}_{seed}_{index:04d}_{pair:02d}"
    return place.task(name, *ends)
