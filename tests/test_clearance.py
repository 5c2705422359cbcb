"""A clearance that is asked for is kept at all times; without one, plans keep a comfortable one where that is cheap.

`python tests/test_clearance.py 200` plans that many tasks on test maps with several demands and prints the shares.
"""

import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from drake_gnnocp import Scenario, plan
from drake_gnnocp.command_line import main
from drake_gnnocp.experiments.benchmark.tasks import drawn_tasks
from drake_gnnocp.ocp.formulation import demand_of
from drake_gnnocp.planner.result import Plan
from drake_gnnocp.simulation import drive

PROVEN_WITHIN = 1e-3  # m, of what is asked for


def box(x0: float, y0: float, x1: float, y1: float) -> np.ndarray:
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])


CORNER = Scenario("corner", np.array([0.0, 0.0, 0.0]), np.array([18.0, 5.0, 0.0]), (box(5.0, 1.3, 12.0, 3.0),))
# a bay 2.4 m wide leaves 0.25 m on each side
BAY = Scenario(
    "bay",
    np.array([-6.0, 4.0, 0.0]),
    np.array([0.0, -3.0, np.pi / 2]),
    (box(-5.0, -5.0, -1.2, 0.0), box(1.2, -5.0, 5.0, 0.0)),
)


def distances(result: Plan) -> tuple[np.ndarray, np.ndarray]:
    """Rear axle (M, 2) and distance to the obstacles (M,) of the driven plan, every 5 ms [m]."""
    assert result.trajectory is not None
    poses = drive(result.scenario.start, result.trajectory, result.scenario.vehicle).states[:, :3]
    cars = shapely.polygons(result.scenario.vehicle.footprints(poses))
    return poses[:, :2], shapely.distance(cars, shapely.union_all(list(result.scenario.polygons)))


@pytest.mark.parametrize("asked", [0.2, 0.5])
def test_what_is_asked_for_is_kept(asked: float) -> None:
    result = plan(CORNER, clearance=asked)
    assert result.verified and result.scenario.clearance == asked and lacking(result) <= PROVEN_WITHIN
    assert distances(result)[1].min() >= asked - PROVEN_WITHIN


def test_near_an_end_that_leaves_less_the_plan_keeps_what_that_has() -> None:
    result = plan(BAY, clearance=0.4)
    assert result.verified
    axle, found = distances(result)
    near_goal = np.linalg.norm(axle - BAY.goal[:2], axis=1) < BAY.vehicle.length
    assert found[near_goal].min() == pytest.approx(0.25, abs=PROVEN_WITHIN)
    assert found[~near_goal].min() >= 0.4 - PROVEN_WITHIN


def test_the_demand_is_lowered_around_ends_alone_and_counts_bounds() -> None:
    demand = demand_of(replace(BAY, bounds=(-20.0, 20.0, -4.0, 9.0)), 0.4)
    poses = np.array([BAY.goal, BAY.goal + [0.0, 4.0, 0.0], BAY.goal + [0.0, 5.0, 0.0], BAY.start])
    at_goal = min(0.25, 4.0 - 3.0 - BAY.vehicle.rear_hang)  # to the lower bound
    assert demand.at(poses) == pytest.approx([at_goal, at_goal, 0.4, 0.4], abs=2 * PROVEN_WITHIN)


def test_a_plan_with_less_than_is_asked_for_is_not_verified() -> None:
    usual = plan(CORNER)
    assert usual.verified and usual.trajectory is not None
    asked = float(distances(usual)[1].min()) + 0.1
    again = plan(replace(CORNER, clearance=asked), usual.trajectory)
    assert again.verified and distances(again)[1].min() >= asked - PROVEN_WITHIN


def test_without_a_demand_a_plan_keeps_a_comfortable_clearance_where_it_can() -> None:
    tight = box(5.0, 1.0, 12.0, 40.0), box(5.0, -40.0, 12.0, -1.0)  # 5 cm on each side are free
    assert distances(plan(CORNER))[1].min() >= 0.1 - PROVEN_WITHIN
    through = plan(Scenario("gate", np.zeros(3), np.array([18.0, 0.0, 0.0]), tight, (-9.0, 30.0, -39.0, 39.0)))
    assert through.verified and 0.0 < distances(through)[1].min() <= 0.05


def test_the_command_line_takes_a_clearance(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    CORNER.save(tmp_path / "corner.json")
    arguments = [str(tmp_path / "corner.json"), "--out", str(tmp_path / "out"), "--no-pictures"]
    assert main([*arguments, "--clearance", "0.4"]) == 0
    assert Scenario.load(tmp_path / "out" / "scenario.json").clearance == 0.4
    assert main([*arguments, "--clearance", "-1"]) == 2
    assert "clearance: must be 0 to 100 m, not -1" in capsys.readouterr().err


def lacking(result: Plan) -> float:
    """How much the driven plan lacks of what its scenario asks for at worst, looked at every 5 ms [m]."""
    scenario, (axle, found) = result.scenario, distances(result)
    asked = np.full(len(found), scenario.clearance)
    for end, at_end in ((scenario.start, found[0]), (scenario.goal, distance_at(scenario, scenario.goal))):
        near = np.linalg.norm(axle - end[:2], axis=1) < scenario.vehicle.length
        asked[near] = np.minimum(asked[near], at_end)
    return float((asked - found).max())


def distance_at(scenario: Scenario, pose: np.ndarray) -> float:
    car = shapely.Polygon(scenario.vehicle.footprints(pose)[0])
    return float(car.distance(shapely.union_all(list(scenario.polygons))))


def figure(n: int) -> None:
    """Print what demands cost on n tasks, each beside no demand."""
    tasks = [task.local for task in drawn_tasks(n)]
    usual: list[Plan] = []
    for asked in (0.0, 0.1, 0.2, 0.3):
        begin = time.process_time()
        plans = [plan(task, clearance=asked, max_seconds=20.0) for task in tasks]
        seconds = time.process_time() - begin
        usual = usual or plans
        verified = [i for i, made in enumerate(plans) if made.verified]
        both = [i for i in verified if usual[i].verified]
        ratios = [plans[i].cost.J / usual[i].cost.J for i in both]  # type: ignore[union-attr]
        worst = max(lacking(plans[i]) for i in verified)
        print(
            f"{asked:.1f} m: {len(verified)} of {n} verified, lacking {max(worst, 0.0) * 1e3:.2f} mm at worst,", end=" "
        )
        print(f"cost ratio median {np.median(ratios):.3f}, p95 {np.quantile(ratios, 0.95):.3f},", end=" ")
        print(f"{seconds / n:.2f} s of processor a task", flush=True)
    comfortable = sum(
        made.verified and lacking(replace(made, scenario=replace(made.scenario, clearance=0.1))) < 1e-3
        for made in usual
    )
    print(f"without a demand {comfortable} of {n} keep 0.1 m by the same rule")


if __name__ == "__main__":
    figure(int(sys.argv[1]))
