"""Tasks without a path: each is refused with its reason, none that has a path is, and what is near is a short move."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from drake_gnnocp import Scenario, Vehicle, plan
from drake_gnnocp.budget import Budget
from drake_gnnocp.command_line import main
from drake_gnnocp.search.hybrid_astar import search
from drake_gnnocp.search.reachability import has_many_corners

KINDS = 6
Rng = np.random.Generator


def box(xmin: float, xmax: float, ymin: float, ymax: float) -> np.ndarray:
    return np.array([[xmin, ymin], [xmax, ymin], [xmax, ymax], [xmin, ymax]])


def walls_around(x: float, y: float, half_length: float, half_width: float, thickness: float) -> list[np.ndarray]:
    left, right, low, high, t = x - half_length, x + half_length, y - half_width, y + half_width, thickness
    return [
        box(left - t, left, low - t, high + t),
        box(right, right + t, low - t, high + t),
        box(left, right, low - t, low),
        box(left, right, high, high + t),
    ]


def moved(name: str, rng: Rng, goal: Sequence[float], obstacles: Sequence[np.ndarray]) -> Scenario:
    """A task that starts at the origin, turned and moved."""
    angle, shift = rng.uniform(-math.pi, math.pi), rng.uniform(-50.0, 50.0, 2)
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    rings = tuple(ring @ turn.T + shift for ring in obstacles)
    return Scenario(name, np.append(shift, angle), np.append(turn @ np.array(goal[:2]) + shift, angle + goal[2]), rings)


def walled_goal(rng: Rng) -> Scenario:
    x, y = rng.uniform(14.0, 25.0), rng.uniform(-8.0, 8.0)
    walls = walls_around(x, y, rng.uniform(5.0, 7.0), rng.uniform(5.0, 7.0), rng.uniform(0.1, 0.5))
    return moved("walled_goal", rng, (x, y, rng.uniform(-3.0, 3.0)), walls)


def narrow_gate(rng: Rng) -> Scenario:
    gap, wall, y = rng.uniform(1.0, 1.88), rng.uniform(0.2, 2.0), rng.uniform(-4.0, 4.0)
    halves = [box(8.0, 8.0 + wall, -20.0, y - gap / 2), box(8.0, 8.0 + wall, y + gap / 2, 20.0)]
    bounds = (-6.0, 30.0, -12.0, 12.0)
    return Scenario("narrow_gate", np.zeros(3), np.array([18.0, y, rng.uniform(-0.5, 0.5)]), tuple(halves), bounds)


def short_slot(rng: Rng) -> Scenario:
    """Room of 5 to 6 cm before and behind the car, which cannot leave but by hundreds of moves of a centimetre."""
    room, kerb = rng.uniform(0.051, 0.06), rng.uniform(0.1, 0.3)
    cars = [box(-6.0, -0.929 - room, -1.0, 0.95), box(3.76 + room, 9.0, -1.0, 0.95)]
    street = [box(-15.0, 18.0, -1.2 - kerb, -0.95 - kerb), box(-15.0, 18.0, 5.0, 5.4)]
    task = moved("short_slot", rng, (-7.0, -2.6, 0.0), [ring - [7.0, 2.6] for ring in cars + street])
    return task


def closed_courtyard(rng: Rng) -> Scenario:
    gap, x = rng.uniform(0.3, 1.85), rng.uniform(-4.0, 4.0)
    yard = walls_around(0.0, 0.0, 14.0, 14.0, 1.0)[:3]
    yard += [box(-14.0, x - gap / 2, 14.0, 15.0), box(x + gap / 2, 14.0, 14.0, 15.0)]
    return moved("closed_courtyard", rng, (rng.uniform(-20.0, 20.0), 30.0, 0.0), yard)


def tight_bounds(rng: Rng) -> Scenario:
    bounds = (-1.5, rng.uniform(4.5, 6.0), -1.2, rng.uniform(1.5, 2.6))
    return Scenario("tight_bounds", np.zeros(3), np.array([3.0, 0.0, math.pi]), (), bounds)


def narrow_corner(rng: Rng) -> Scenario:
    """A corridor round a corner that a ladder as long and wide as the car does not pass either."""
    width = rng.uniform(2.1, 2.9)
    x, half = 12.0, width / 2
    walls = [
        box(-8.0, x - half, half, 14.0),
        box(-8.0, x + half, -half - 1.0, -half),
        box(x + half, x + half + 1.0, -half - 1.0, 14.0),
        box(-9.0, -8.0, -half - 1.0, half + 1.0),
        box(x - half, x + half, 14.0, 15.0),
    ]
    return moved("narrow_corner", rng, (x, 8.0, math.pi / 2), walls)


MAKERS: tuple[Callable[[Rng], Scenario], ...] = (
    walled_goal, narrow_gate, short_slot, closed_courtyard, tight_bounds, narrow_corner,
)  # fmt: skip


def assert_refused(task: Scenario) -> None:
    result = plan(task)
    assert result.status == "no_path" and result.trajectory is None and result.no_path is not None, result.summary
    assert result.no_path.proven == (task.name != "short_slot"), result.summary
    assert result.reason == result.no_path.text
    assert all(attempt.source != "straight" for attempt in result.attempts)


@pytest.mark.parametrize("make", MAKERS)
def test_an_impossible_task_of_every_kind_is_refused(make: Callable[[Rng], Scenario]) -> None:
    assert_refused(make(np.random.default_rng(3)))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(100))
def test_a_hundred_impossible_tasks_are_refused(seed: int) -> None:
    assert_refused(MAKERS[seed % len(MAKERS)](np.random.default_rng(100 + seed)))


SUV = Vehicle(wheelbase=3.0, front_hang=0.9, rear_hang=1.0, width=2.0, phi_max=0.58)
VAN = Vehicle(wheelbase=3.4, front_hang=0.95, rear_hang=1.1, width=2.05, phi_max=0.62)


@pytest.mark.parametrize("room", [0.35, 0.55])
@pytest.mark.parametrize("vehicle", [Vehicle(), SUV, VAN], ids=["car", "suv", "van"])
def test_a_slot_with_little_room_before_and_behind_and_a_kerb_near_by_is_no_dead_end(
    vehicle: Vehicle, room: float
) -> None:
    """At the coarse resolutions a car there has some tens of states and no way out."""
    back, front, half = -vehicle.rear_hang, vehicle.wheelbase + vehicle.front_hang, vehicle.width / 2
    cars = [box(back - room - 5.0, back - room, -half, half), box(front + room, front + room + 5.0, -half, half)]
    street = [box(-15.0, 18.0, -half - 0.3, -half - 0.1), box(-15.0, 18.0, half + 3.6, half + 3.8)]
    goal = np.array([-front - room, -2 * half - 0.7, 0.0])
    task = Scenario("slot", np.zeros(3), goal, tuple(ring + goal[:2] for ring in cars + street), vehicle=vehicle)
    assert search(task.in_car_lengths, Budget.unlimited()).status == "found"


def test_among_very_many_corners_a_goal_behind_walls_is_refused_before_anything_is_solved() -> None:
    x, y = np.meshgrid(np.arange(-40.0, 80.0, 2.5), np.arange(-60.0, 60.0, 2.5))
    posts = [box(a, a + 0.2, b, b + 0.2) for a, b in zip(x.ravel(), y.ravel(), strict=True) if abs(b) > 14.0]
    task = Scenario("posts", np.zeros(3), np.array([25.0, 0.0, 0.0]), (*walls_around(25.0, 0.0, 6.0, 6.0, 0.3), *posts))
    assert has_many_corners(task)
    assert_refused(task)


def test_the_passage_that_is_too_narrow_is_named_in_the_coordinates_of_the_task() -> None:
    halves = (box(108.0, 108.5, -20.0, 0.9), box(108.0, 108.5, 2.6, 20.0))
    task = Scenario("gate", np.array([100.0, 0, 0]), np.array([118.0, 0, 0]), halves, (94.0, 130.0, -12.0, 12.0))
    result = plan(task, "straight")
    assert result.no_path is not None and result.no_path.place is not None and result.no_path.width is not None
    np.testing.assert_allclose(result.no_path.place, (108.25, 1.75), atol=0.05)
    assert result.no_path.width == pytest.approx(1.7, abs=0.01)
    assert result.reason == "the passage near (108.2, 1.8) is 1.70 m wide, the car 1.90 m"


def test_what_has_no_path_exits_3_with_its_reason_and_writes_no_trajectory(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = tmp_path / "walled_in.json", tmp_path / "out"
    path.write_text(json.dumps(walled_goal(np.random.default_rng(0)).to_dict()))
    assert main(["empty_field", "--out", str(out), "--no-pictures"]) == 0
    assert main([str(path), "--out", str(out)]) == 3
    result = json.loads((out / "result.json").read_text())
    assert result["status"] == "no_path" and result["t_final"] is None
    assert result["no_path"]["proven"] and result["no_path"]["reason"] == "the goal is enclosed on all sides"
    assert [attempt["guess"] for attempt in result["attempts"]] == ["reachability"]
    assert "no path (proven)" in capsys.readouterr().out
    assert {file.name for file in out.iterdir()} == {"plan.png", "result.json", "scenario.json"}


def test_where_start_and_goal_are_the_same_there_is_nothing_to_drive() -> None:
    start, turned = np.array([300.0, -2.0, 0.4]), np.array([300.0, -2.0, 0.4 - 4 * np.pi])
    result = plan(Scenario("stay", start, turned))
    assert result.verified and result.trajectory is not None and len(result.trajectory) == 120
    assert np.ptp(result.trajectory.states, axis=0).max() == 0 and "nothing to drive" in result.summary
    assert plan(Scenario("stay", start, start), horizon=7.0).to_dict()["t_final"] == 7.0


def test_a_move_shorter_than_the_car_takes_no_detour() -> None:
    result = plan(Scenario("creep", np.zeros(3), np.array([0.3, 0.0, 0.0])))
    assert result.verified and result.trajectory is not None
    assert result.trajectory.path_length < 0.32
