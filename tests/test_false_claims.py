"""No false claims: what is verified, and what is refused, beside an integrator of its own with far finer steps.

Fast cars among posts, needles, slivers and bounds that stand within millimetres of what they sweep, looked at every
0.1 ms; and plans of the dataset, spoiled a little, looked at every 0.5 ms.

`python tests/test_false_claims.py 5000 100000` tries until so many fast drives are verified, and so many spoiled
plans, and prints what came out of both.
"""

from __future__ import annotations

import math
import sys
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import shapely

from drake_gnnocp import Scenario, ScenarioError, Trajectory, Vehicle, verify
from drake_gnnocp.experiments.dataset.records import load_records
from drake_gnnocp.vehicle import Input, State

SHARD = Path(__file__).parent.parent / "artifacts" / "dataset" / "shards" / "shard_000.npz"
FINE, HALF_FINE = 1e-4, 5e-4  # s
CLEAR, KEPT, LIMITS, AT_REST = 1e-3, 1e-5, 1e-3, 1e-3  # m clean without doubt, m of bounds, relative, at the ends
GOAL_M, GOAL_RAD = 0.01, math.radians(1.0)


def fine_states(start: np.ndarray, trajectory: Trajectory, wheelbase: float, step: float) -> np.ndarray:
    """States (M, 5) of the drive: v and phi exact, theta by the midpoint rule and x, y along the chord of each step."""
    n = math.ceil((trajectory.t[-1] - trajectory.t[0]) / step)
    t = np.unique(np.append(np.linspace(trajectory.t[0], trajectory.t[-1], 2 * n + 1), trajectory.t))
    a, w = (np.interp(t, trajectory.t, column) for column in trajectory.inputs.T)
    h = np.diff(t)
    v, phi = (np.append(0.0, np.cumsum(h * (u[1:] + u[:-1]) / 2)) for u in (a, w))
    middle = h / 8  # the quadratics half-way: the mean, less the second difference
    v_mid = (v[1:] + v[:-1]) / 2 - middle * np.diff(a)
    phi_mid = (phi[1:] + phi[:-1]) / 2 - middle * np.diff(w)
    theta = start[2] + np.append(0.0, np.cumsum(h * v_mid * np.tan(phi_mid) / wheelbase))
    heading = (theta[1:] + theta[:-1]) / 2
    x, y = (start[i] + np.append(0.0, np.cumsum(h * v_mid * f(heading))) for i, f in enumerate((np.cos, np.sin)))
    return np.column_stack([x, y, theta, v, phi])


def least_distance(scenario: Scenario, corners: np.ndarray) -> float:
    """Of footprints (M, 4, 2) from the polygons: all are looked at that the way from a neighbour leaves in question."""
    if not len(scenario.polygons):
        return math.inf
    polygons = scenario.polygons
    way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=2).max(axis=1)))
    some = np.unique(np.append(np.arange(0, len(corners), 100), len(corners) - 1))

    def distances(which: np.ndarray) -> np.ndarray:
        if not len(which):
            return np.array([math.inf])
        cars, tree = shapely.polygons(corners[which]), shapely.STRtree(polygons)
        return tree.query_nearest(cars, return_distance=True, all_matches=False)[1]

    found = distances(some)
    after = np.clip(np.searchsorted(some, np.arange(len(corners))), 1, len(some) - 1)
    low = (found[after - 1] + found[after] - (way[some[after]] - way[some[after - 1]])) / 2
    return float(min(found.min(), distances(np.flatnonzero(low < found.min())).min()))


def margin(scenario: Scenario, trajectory: Trajectory, step: float) -> float:
    """How far the drive is from what must be refused: negative where it must, infinite with nothing around it [m]."""
    vehicle, states = scenario.vehicle, fine_states(scenario.start, trajectory, scenario.vehicle.wheelbase, step)
    off = np.abs(states[-1, :3] - scenario.goal)
    stated = np.hstack([trajectory.states, trajectory.inputs])[[0, -1], State.V :]
    limits = np.array([vehicle.v_max, vehicle.phi_max, vehicle.a_max, vehicle.w_max])
    peaks = np.append(np.abs(states[:, 3:]).max(axis=0), np.abs(trajectory.inputs).max(axis=0))
    is_kept = (
        off[:2].max() <= GOAL_M
        and abs(math.remainder(off[2], 2 * math.pi)) <= GOAL_RAD
        and np.abs(trajectory.poses[0] - scenario.start).max() <= AT_REST
        and max(np.abs(stated).max(), np.abs(states[-1, 3:]).max()) <= AT_REST
        and (peaks <= limits * (1 + LIMITS)).all()
    )
    if not is_kept:
        return -1.0
    corners = vehicle.footprints(states[:, :3])
    inside = math.inf
    if scenario.bounds is not None:
        low, high = np.reshape(scenario.bounds, (2, 2)).T
        inside = float(min((corners.min(axis=(0, 1)) - low).min(), (high - corners.max(axis=(0, 1))).min()))
    distance = least_distance(scenario, corners)
    return min(distance if distance > 0 else -1.0, inside + KEPT)


# --- fast cars ---


def fast_drive(rng: np.random.Generator) -> tuple[Vehicle, Trajectory]:
    """From rest to rest at up to 15 m/s, the wheels swinging, with knots of any spacing."""
    seconds, n = rng.uniform(1.0, 4.0), rng.integers(6, 60)
    t = np.sort(np.append(rng.uniform(0.0, seconds, n), np.linspace(0.0, seconds, 7)))
    t = t[np.append(True, np.diff(t) > 1e-3)]
    speed, angle, phase = rng.uniform(1.0, 15.0), rng.uniform(-0.6, 0.6), 2 * math.pi * t / t[-1]
    shape = np.sin(phase * rng.integers(1, 4))
    inputs = np.stack([speed * math.pi / t[-1] * np.sin(phase), angle * math.pi / t[-1] * shape], axis=1)
    inputs[[0, -1]] = 0.0
    for column in inputs.T:  # at rest: what is left over is taken from the last inner knot
        column[-2] -= 2 * np.trapezoid(column, t) / (t[-1] - t[-3])
    lengths = rng.uniform([0.5, 0.1, 0.1, 0.4], [3.0, 1.0, 1.0, 2.0])
    wheelbase, front_hang, rear_hang, width = lengths.tolist()
    vehicle = Vehicle(wheelbase, front_hang, rear_hang, width, v_max=1e3, a_max=1e4, phi_max=1.5, w_max=1e3)
    states = fine_states(np.zeros(3), Trajectory(t, np.zeros((len(t), 5)), inputs), vehicle.wheelbase, FINE)[[0, -1]]
    stated = np.zeros((len(t), 5))
    stated[-1, :3] = states[1, :3]
    return vehicle, Trajectory(t, stated, inputs)


def thin_thing(rng: np.random.Generator, at: np.ndarray, away: np.ndarray) -> np.ndarray:
    """A post, a needle or a sliver whose nearest point is at (2,), in the direction away (2,)."""
    across = np.array([-away[1], away[0]])
    long, wide = {0: (0.01, 0.01), 1: (rng.uniform(0.05, 2.0), 1e-3), 2: (1e-3, rng.uniform(0.05, 1.0))}[
        int(rng.integers(3))
    ]
    return np.array([at, at + long * away + wide / 2 * across, at + long * away - wide / 2 * across])


def fast_tasks(rng: np.random.Generator) -> Iterator[tuple[Scenario, Trajectory]]:
    """Drives among things that stand from 4 mm within to 30 mm beside what the corners sweep, and between bounds."""
    while True:
        vehicle, trajectory = fast_drive(rng)
        states = fine_states(np.zeros(3), trajectory, vehicle.wheelbase, FINE)
        corners = vehicle.footprints(states[:, :3])
        things = []
        for _ in range(rng.integers(1, 5)):
            k, c = rng.integers(len(states)), rng.integers(4)
            away = corners[k, c] - corners[k].mean(axis=0)
            away /= np.linalg.norm(away)
            things.append(thin_thing(rng, corners[k, c] + rng.uniform(-0.004, 0.03) * away, away))
        low, high = (f(corners, axis=(0, 1)) + rng.uniform(-0.001, 0.01, 2) * s for f, s in ((np.min, -1), (np.max, 1)))
        bounds = (low[0], high[0], low[1], high[1]) if rng.random() < 0.3 else None
        try:
            yield Scenario("fast", np.zeros(3), states[-1, :3], tuple(things), bounds, vehicle), trajectory
        except ScenarioError:  # a thing stands in the car at an end, or has no area to speak of
            continue


# --- spoiled plans ---


@cache
def dataset_plans() -> list[tuple[Scenario, Trajectory]]:
    records = load_records(SHARD)
    pairs = [pair for record in records for pair in zip(record.tasks, record.labels, strict=True)]
    return [
        (task.translated(*-task.start[:2]), label.trajectory.translated(*-task.start[:2]))
        for task, label in pairs
        if label.trajectory is not None
    ]


def spoiled(rng: np.random.Generator, plan: Trajectory) -> Trajectory:
    """A plan with shifted states, scaled or noisy inputs, or time stretched as a whole or between two knots."""
    t, states, inputs = plan.t.copy(), plan.states.copy(), plan.inputs.copy()
    size = 10 ** rng.uniform(-6, -1)
    match rng.integers(6):
        case 0:
            states[:, :3] += rng.normal(size=3) * size
        case 1:
            inputs *= 1 + size * rng.normal(size=2)
        case 2:
            inputs[1:-1] += rng.normal(size=(len(t) - 2, 2)) * size
        case 3:
            k = rng.integers(1, len(t) - 1)
            inputs[k] += rng.normal(size=2) * size
        case 4:  # the same path, quicker or slower
            share = 1 + rng.normal() * size
            t, states[:, State.V], inputs = t * share, states[:, State.V] / share, inputs / [share**2, share]
        case _:
            k = rng.integers(1, len(t))
            t[k:] += abs(rng.normal()) * size * (t[k] - t[k - 1])
    return Trajectory(t, states, inputs)


def spoiled_plans(rng: np.random.Generator) -> Iterator[tuple[Scenario, Trajectory]]:
    plans = dataset_plans()
    while True:
        scenario, plan = plans[rng.integers(len(plans))]
        yield scenario, spoiled(rng, plan)


def tally(tasks: Iterator[tuple[Scenario, Trajectory]], step: float, tried: int, verified: int = 10**9) -> Counter[str]:
    """Counts over so many tasks, or until so many are verified."""
    counts: Counter[str] = Counter(tried=0, verified=0, false=0, clean=0, needless=0)
    while counts["tried"] < tried and counts["verified"] < verified:
        scenario, trajectory = next(tasks)
        is_verified, found = verify(scenario, trajectory).verified, margin(scenario, trajectory, step)
        counts["tried"] += 1
        counts["verified"] += is_verified
        counts["false"] += is_verified and found < 0
        counts["clean"] += found > CLEAR
        counts["needless"] += not is_verified and found > CLEAR
        counts["touching"] += found < 0
    return counts


@pytest.mark.parametrize("n", [40, pytest.param(2000, marks=pytest.mark.slow)])
def test_no_fast_car_that_is_verified_touches_anything(n: int) -> None:
    counts = tally(fast_tasks(np.random.default_rng(n)), FINE, n)
    assert counts["false"] == 0
    assert counts["needless"] <= 0.005 * counts["clean"]
    assert min(counts["verified"], counts["touching"]) > n / 10


@pytest.mark.parametrize("n", [80, pytest.param(4000, marks=pytest.mark.slow)])
def test_no_spoiled_plan_is_verified_that_finer_steps_refuse(n: int) -> None:
    counts = tally(spoiled_plans(np.random.default_rng(n)), HALF_FINE, n)
    assert counts["false"] == 0
    assert counts["needless"] <= 0.005 * counts["clean"]
    assert min(counts["verified"], counts["touching"]) > n / 10


def test_the_finer_check_sees_what_is_planted() -> None:
    scenario, plan = next((task, plan) for task, plan in dataset_plans() if verify(task, plan).verified)
    clearance = verify(scenario, plan).min_clearance_m
    assert margin(scenario, plan, HALF_FINE) == pytest.approx(clearance, abs=1.5e-3)
    for column, size in ((Input.A, 0.05), (Input.W, 0.05)):
        inputs = plan.inputs.copy()
        inputs[50, column] += size
        assert margin(scenario, Trajectory(plan.t, plan.states, inputs), HALF_FINE) < 0


if __name__ == "__main__":
    fast, spoils = (int(argument) for argument in sys.argv[1:])
    seed = np.random.default_rng(0)
    print("fast cars, every 0.1 ms:", dict(tally(fast_tasks(seed), FINE, 10**9, fast)), flush=True)
    print("spoiled plans, every 0.5 ms:", dict(tally(spoiled_plans(seed), HALF_FINE, spoils)), flush=True)
