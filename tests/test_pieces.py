"""However a scene is cut into pieces, it has the same plan; `python tests/test_pieces.py` prints what pieces cost."""

import statistics
import time
from itertools import pairwise

import numpy as np
import pytest
import shapely

from drake_gnnocp import Scenario, plan
from drake_gnnocp.polygons import merged

SAME_COST = 0.01  # relative
ROUNDING = 1e-7  # m^2
# a yard that is open on one side, with a wall to go around below and one above: xmin, ymin, xmax, ymax [m]
YARD = [(-6, -6, 34, -4), (-6, 14, 34, 16), (-6, -4, -4, 14), (8, -4, 12, 4), (18, 4, 22, 14)]
SIDES = {"67 pieces": 2.0, "268 pieces": 1.0, "3,283 squares": 2 / 7, "11,323 squares": 2 / 13}


def cells(box: tuple[float, float, float, float], side: float) -> list[np.ndarray]:
    """A box as squares of about one side [m]."""
    xmin, ymin, xmax, ymax = box
    x = np.linspace(xmin, xmax, round((xmax - xmin) / side) + 1)
    y = np.linspace(ymin, ymax, round((ymax - ymin) / side) + 1)
    return [np.array([(a, c), (b, c), (b, d), (a, d)]) for a, b in pairwise(x) for c, d in pairwise(y)]


def yard_in_pieces(side: float) -> Scenario:
    pieces = tuple(cell for box in YARD for cell in cells(box, side))
    return Scenario("yard", np.zeros(3), np.array([29.0, 0.0, 0.0]), pieces)


def yard_of_one_ring(first: int = 0) -> Scenario:
    """The yard as one ring, written from one of its vertices on."""
    whole = shapely.union_all([shapely.box(*box) for box in YARD])
    ring = np.roll(np.asarray(whole.exterior.coords)[:-1], -first, axis=0)
    return Scenario("yard", np.zeros(3), np.array([29.0, 0.0, 0.0]), (ring,))


@pytest.fixture(scope="module")
def cost_of_one_ring() -> float:
    made = plan(yard_of_one_ring())
    assert made.verified and made.cost is not None
    return made.cost.J


@pytest.mark.parametrize("scenario", [yard_of_one_ring(5), *map(yard_in_pieces, list(SIDES.values())[::2])])
def test_a_scene_has_the_same_plan_however_it_is_written(scenario: Scenario, cost_of_one_ring: float) -> None:
    made = plan(scenario)
    assert made.verified and made.cost is not None
    assert made.cost.J == pytest.approx(cost_of_one_ring, rel=SAME_COST)


@pytest.mark.parametrize("seed", range(5))
def test_cells_cover_the_same_when_merged(seed: int) -> None:
    """Cells of several grids at places that rounding makes differ, with some of them left out or there twice."""
    rng = np.random.default_rng(seed)
    boxes = [(x, y, x + 0.6, y + 0.9) for x, y in 0.1 * rng.integers(0, 30, size=(12, 2))]
    squares = [shapely.Polygon(cell) for box in boxes for cell in cells(box, 0.3)]
    slanted = shapely.Polygon([(0, 0), (2, 1), (1, 3), (-1, 2)])
    chosen = [squares[i] for i in rng.integers(0, len(squares), size=60)] + [slanted]
    found, expected = merged(chosen), shapely.union_all(chosen)
    assert sum(polygon.area for polygon in found) == pytest.approx(expected.area, abs=ROUNDING)
    assert shapely.union_all(found).symmetric_difference(expected).area <= ROUNDING


def main(rounds: int = 7) -> None:
    """Print the costs of the plans and the CPU times, in ratios to those of one ring, from reading to verified."""
    scenes = {"1 ring": yard_of_one_ring(), **{name: yard_in_pieces(side) for name, side in SIDES.items()}}
    plan("map_a")  # loads the network
    seconds: dict[str, list[float]] = {name: [] for name in scenes}
    for _ in range(rounds):
        for name, scene in scenes.items():
            begin = time.process_time()
            made = plan(Scenario.from_dict(scene.to_dict()))
            seconds[name].append(time.process_time() - begin)
            assert made.verified and made.cost is not None
            if len(seconds[name]) == rounds:
                middle, first = (statistics.median(seconds[which]) for which in (name, "1 ring"))
                print(f"{name:>15}: J {made.cost.J:.4f}, {middle:.3f} s, {middle / first:.2f} times that of one ring")


if __name__ == "__main__":
    main()
