"""How the time of a plan grows with its knots, its way and its changes of gear: `python tests/test_scaling.py`.

(`python tests/test_pieces.py` prints it for the number of obstacles.)
"""

from __future__ import annotations

import statistics
import time

import numpy as np
import pytest

from drake_gnnocp import Plan, PlanOptions, Scenario, plan

KNOTS = (30, 60, 120, 240, 480)
WAYS = (10.0, 25.0, 50.0, 100.0, 200.0, 400.0)  # m
GAPS = (3.0, 2.0, 1.4, 1.0, 0.8)  # m, of a parallel slot beyond the car's length
SAME_COST = 0.05  # relative, of a plan with half or twice the knots
CAR, WIDTH = 4.689, 1.9  # m


def lane(way: float) -> Scenario:
    """A lane of a length [m], with a box every 20 m that stands into it on one side or the other."""
    boxes = []
    for i, x in enumerate(np.arange(15.0, way - 9.0, 20.0)):
        low, high = (-4.0, -0.5) if i % 2 else (0.5, 4.0)
        boxes.append(np.array([(x, low), (x + 2, low), (x + 2, high), (x, high)]))
    return Scenario(f"lane of {way:g} m", np.zeros(3), np.array([way, 0.0, 0.0]), tuple(boxes), (-5, way + 9, -5, 5))


def slot(gap: float) -> Scenario:
    """A parallel slot that is longer than the car by a gap [m], between two cars at a kerb."""
    first, last = 0.0, CAR + gap
    rings = [[(x, 0.0), (x + 4.5, 0.0), (x + 4.5, WIDTH), (x, WIDTH)] for x in (first - 4.5, last)]
    kerb = [(-20.0, -0.7), (30.0, -0.7), (30.0, -0.4), (-20.0, -0.4)]
    wall = [(-20.0, 7.0), (30.0, 7.0), (30.0, 7.3), (-20.0, 7.3)]
    goal = np.array([0.929 + gap / 2, WIDTH / 2, 0.0])
    return Scenario(f"gap of {gap:g} m", np.array([-8.0, 4.2, 0.0]), goal, tuple(map(np.array, [*rings, kerb, wall])))


@pytest.mark.parametrize("knots", KNOTS[1:4])
def test_plans_of_fewer_and_of_more_knots_cost_about_the_same(knots: int) -> None:
    usual, made = plan("map_c"), plan("map_c", options=PlanOptions(knots=knots))
    assert made.verified and made.cost is not None and usual.cost is not None
    assert made.cost.J == pytest.approx(usual.cost.J, rel=SAME_COST)


@pytest.mark.parametrize("scenario", [lane(50.0), lane(200.0), slot(1.4)], ids=lambda scenario: scenario.name)
def test_what_is_measured_is_planned(scenario: Scenario) -> None:
    assert plan(scenario).verified


def main(rounds: int = 5) -> None:
    """Print the CPU times, the medians of some rounds."""
    plan("map_a")  # loads the network
    cases: list[tuple[str | Scenario, PlanOptions, str]]
    cases = [("map_c", PlanOptions(knots=knots), f"map_c, {knots} knots") for knots in KNOTS]
    cases += [(lane(way), PlanOptions(), lane(way).name) for way in WAYS]
    cases += [(slot(gap), PlanOptions(), slot(gap).name) for gap in GAPS]
    for scenario, options, name in cases:
        seconds, made = [], None
        for _ in range(rounds):
            begin = time.process_time()
            made = plan(scenario, options=options)
            seconds.append(time.process_time() - begin)
        print(_line(name, statistics.median(seconds), made))


def _line(name: str, seconds: float, made: Plan | None) -> str:
    if made is None or made.trajectory is None:
        return f"{name:>18}: no plan"
    way, changes = made.trajectory.path_length, made.trajectory.gear_changes
    knots, status = len(made.trajectory), made.status
    return f"{name:>18}: {seconds:.3f} s, {status}, {knots} knots, {way:.0f} m, {changes} changes of gear"


if __name__ == "__main__":
    main()
