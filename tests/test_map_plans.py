"""Large occupancy maps from file to verified plan, beside an independent oracle of what can be connected.

`python tests/test_map_plans.py 100 --vehicle robot --jobs 2 --out /tmp/robot.json` draws maps of 2,000 x 2,000 cells,
of which 5, 10 and 20 % are occupied, asks the oracle (`lattice_oracle.py`) which of 100 random pairs of poses a map can
be connected, plans all of them, and prints a table. What the file holds already is not done again; `--only 20:37`
repeats one pair, and `--maps FOLDER` leaves the map's files there. To take over what an oracle said
for another planner: `grep connectable /tmp/robot.json > /tmp/new.json`.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import re
import tempfile
from collections.abc import Sequence
from concurrent.futures import as_completed
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import shapely
from lattice_edges import HEADINGS, edges_of
from lattice_oracle import Oracle
from map_plan_runs import STAGES, Answer, Pair, Records, Run, asked, looked_at, map_of, pair_of, planned, table
from map_tasks import CELL, VEHICLES, TaskMap, draw_map, footprints
from raw_cells import RawCells, covered, driven, rectangles

from drake_gnnocp import Scenario, Trajectory, plan
from drake_gnnocp.simulation import drive
from drake_gnnocp.workers import workers

ROBOT = VEHICLES["robot"]
SAME = 1e-9  # m, rounding
SAME_MOTION = 1e-6  # m, two integrations
ENOUGH = 0.97  # of the connectable pairs
SMALL = 16.0  # m, side of a small map


@cache
def small_map() -> TaskMap:
    return draw_map(10, side=SMALL, seed=2)


def walled(gap: float) -> TaskMap:
    """A room of 10 m x 8 m, with a wall across that has a gap in the middle."""
    occupied = np.zeros((160, 200), dtype=bool)
    occupied[:, 98:102] = True
    half = round(gap / 2 / CELL)
    occupied[80 - half : 80 + half, 98:102] = False
    return TaskMap(0, RawCells(occupied, CELL, np.array([-5.0, -4.0])))


# --- the cells ---


def test_covered_cells_are_those_that_share_area() -> None:
    rng = np.random.default_rng(0)
    poses = np.column_stack([rng.uniform(5, 8, (40, 2)), rng.uniform(-4, 4, 40)])
    poses[:4, 2] = np.arange(4) * math.pi / 2
    poses[2:4, :2] = np.round(poses[2:4, :2])
    polygons = rectangles(poses, -1.0, 3.0, 1.5)
    runs = covered(polygons)
    for k, polygon in enumerate(polygons):
        found = {
            (row, column)
            for row, first, last, there in zip(*(part[k] for part in dataclasses.astuple(runs)), strict=True)
            for column in range(first, last + 1)
            if there
        }
        i, j = np.indices((14, 14)).reshape(2, -1)
        area = shapely.area(shapely.intersection(shapely.box(j, i, j + 1, i + 1), shapely.Polygon(polygon)))
        assert found == set(zip(i[area > SAME].tolist(), j[area > SAME].tolist(), strict=True))


def test_a_car_hits_what_it_touches_with_some_area_and_what_lies_outside() -> None:
    occupied = np.zeros((20, 40), dtype=bool)
    occupied[10, 20] = True  # from (0, 0) to (0.5, 0.5)
    cells = RawCells(occupied, 0.5, np.array([-10.0, -5.0]))
    poses = np.array([[-1.0, 0.2, 0.0], [-0.99, 0.2, 0.0], [9.1, 0.0, 0.0], [-1.0, -3.0, 1.0]])
    cars = rectangles(poses, -1.0, 1.0, 0.5)  # the first one's front is at x = 0
    assert cells.hits(cars).tolist() == [False, True, True, False]
    assert [cells.touched(cars[:1]), cells.touched(cars[:2])] == [0, 1]


def test_driving_follows_the_inputs_in_small_steps() -> None:
    t, start = np.array([0.0, 2.0, 2.5, 5.0, 8.0]), np.array([1.0, 2.0, 0.5])
    a, w = np.array([0.0, 0.6, 0.3, -0.9, 0.0]), np.array([0.0, 0.3, -0.5, 0.1, 0.0])
    poses = driven(start, t, a, w, ROBOT.wheelbase, ROBOT.length, 0.01)
    motion = drive(start, Trajectory(t, np.zeros((5, 5)), np.column_stack([a, w])), ROBOT)
    assert poses[-1] == pytest.approx(motion.states[-1, :3], abs=SAME_MOTION)
    corners = footprints(ROBOT, poses)
    assert np.linalg.norm(np.diff(corners, axis=0), axis=2).max() <= 0.0101


# --- the maps ---


def test_maps_are_drawn_alike_and_as_full_as_asked() -> None:
    again = draw_map(10, side=SMALL, seed=2)
    assert again.checksum == small_map().checksum != draw_map(10, side=SMALL, seed=3).checksum
    assert 0.1 <= draw_map(10).cells.occupied.mean() <= 0.105


def test_pairs_are_free_and_their_number_changes_none() -> None:
    pairs = small_map().pairs(ROBOT, 5)
    assert all(
        (one == other).all()
        for few, many in zip(small_map().pairs(ROBOT, 2), pairs, strict=False)
        for one, other in zip(few, many, strict=True)
    )
    assert all(5 <= math.dist(start[:2], goal[:2]) <= 60 for start, goal in pairs)
    assert not small_map().cells.hits(footprints(ROBOT, np.concatenate(pairs))).any()


def test_a_map_that_is_written_is_read_as_it_was_drawn(tmp_path: Path) -> None:
    start, goal = small_map().pairs(ROBOT, 1)[0]
    scenario = Scenario.load(small_map().write(tmp_path), start=start, goal=goal, vehicle=ROBOT)
    rng = np.random.default_rng(1)
    poses = np.column_stack([rng.uniform(1 - SMALL / 2, SMALL / 2 - 1, (300, 2)), rng.uniform(-4, 4, 300)])
    cars = footprints(ROBOT, poses)
    tree = shapely.STRtree(scenario.shapes.polygons)
    hit = np.zeros(len(cars), dtype=bool)
    hit[tree.query(shapely.polygons(cars), predicate="intersects")[0]] = True
    assert (hit == small_map().cells.hits(cars)).all() and 0 < hit.sum() < len(hit)


# --- the oracle ---


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_edges_lead_exactly_from_lattice_point_to_lattice_point(vehicle: str) -> None:
    edges = edges_of(VEHICLES[vehicle], CELL)
    for edge in edges.all:
        start = np.array([0.0, 0.0, HEADINGS[edge.start]])
        poses = edge.move.poses(start, edges.radius, edges.reach, 0.05)
        assert poses[-1, :2] == pytest.approx(0.25 * np.array(edge.offset), abs=SAME)
        assert math.remainder(poses[-1, 2] - HEADINGS[edge.end], 2 * math.pi) == pytest.approx(0, abs=SAME)
        ahead = np.diff(poses[:, 0]) * np.cos(poses[1:, 2]) + np.diff(poses[:, 1]) * np.sin(poses[1:, 2])
        turned = np.abs(np.diff(poses[:, 2]))
        assert (ahead >= -SAME).all() and (turned <= ahead * (1 + 0.05) / edges.radius + SAME).all()


@pytest.mark.parametrize(("gap", "expected"), [(0.6, False), (0.7, True), (2.0, True)])
def test_the_oracle_passes_gaps_that_are_wider_than_the_car(gap: float, expected: bool) -> None:
    ends = np.array([-3.0, 0.3, 0.1]), np.array([2.7, -1.1, 2.0])
    assert Oracle(walled(gap), ROBOT).connects(*ends) == expected


def test_the_oracle_turns_around_where_there_is_room_only() -> None:
    ends = np.array([-3.0, -0.04, 0.05]), np.array([-2.0, 0.0, 3.1])
    assert Oracle(walled(0.0), ROBOT).connects(*ends)
    occupied = np.ones((160, 200), dtype=bool)
    occupied[72:88] = False  # 0.8 m wide: less than the car is long
    corridor = Oracle(TaskMap(0, RawCells(occupied, CELL, np.array([-5.0, -4.0]))), ROBOT)
    assert not corridor.connects(*ends)
    assert corridor.connects(ends[0], np.array([-1.5, -0.04, -0.05]))


def test_the_oracle_leaves_a_pose_that_nearly_touches_a_wall() -> None:
    front = ROBOT.wheelbase + ROBOT.front_hang
    at_wall = np.array([-0.1 - front - 5e-4, 2.5, 0.0])  # as a random pose that is free may be
    assert Oracle(walled(2.0), ROBOT).connects(at_wall, np.array([2.7, -1.1, 2.0]))


# --- the runs ---


def run_of(pair: Pair, status: str, seconds: float, touched: int = 0) -> Run:
    stages = dict.fromkeys(STAGES, seconds / len(STAGES))
    return Run(pair, status, "gnn", 1, (f"gnn: {status}",), stages, seconds, touched, 0.001, 12.0, 7)


def test_records_are_found_again_and_an_unfinished_line_is_done_again(tmp_path: Path) -> None:
    pairs = [Pair("robot", 5, i, 1) for i in range(3)]
    records = Records(tmp_path / "runs.json")
    for pair in pairs:
        records.add(Answer(pair, True))
        records.add(run_of(pair, "verified", 0.5))
    text = (tmp_path / "runs.json").read_text()
    (tmp_path / "runs.json").write_text(text[:-20])
    again = Records(tmp_path / "runs.json")
    assert (list(again.answers), list(again.runs)) == (pairs, pairs[:2])
    again.add(run_of(pairs[2], "failed", 9.0))
    assert Records(tmp_path / "runs.json").runs == {**records.runs, pairs[2]: run_of(pairs[2], "failed", 9.0)}


def test_the_table_counts_verified_plans_of_what_is_connectable() -> None:
    records, pairs = Records(None), [pair_of("robot", 5, i) for i in range(4)]
    for pair, connectable in zip(pairs, (True, True, True, False), strict=True):
        records.add(Answer(pair, connectable))
    for pair, status, seconds in zip(
        pairs, ("verified", "failed", "verified", "no_path"), (0.5, 7.0, 1.5, 9.0), strict=True
    ):
        records.add(run_of(pair, status, seconds, touched=2 * (seconds == 1.5)))
    lines = table(records, pairs).splitlines()
    cells = {label: last for label, *_, last in (re.split("  +", line) for line in lines if "  " in line)}
    assert (cells["connectable by the oracle"], cells["verified of these [%]"]) == ("3", "66.7")
    assert [cells[f"total [s] {which}"] for which in ("median", "p95", "max")] == ["1.50", "6.45", "7.00"]
    assert [line.split("--only ")[1].split(";")[0] for line in lines if "--only" in line] == [
        *("5:1: failed, connectable", "5:2: touches 2 cells", "5:3: slow, not connectable")
    ]


def test_a_plan_on_a_small_map_touches_no_cell(tmp_path: Path) -> None:
    oracle = Oracle(small_map(), ROBOT)
    start, goal = next(pair for pair in small_map().pairs(ROBOT, 5) if oracle.connects(*pair))
    result = plan(Scenario.load(small_map().write(tmp_path), start=start, goal=goal, vehicle=ROBOT))
    assert result.verified
    touched, off_goal = looked_at(result, small_map(), ROBOT)
    assert touched == 0 and off_goal <= 0.01


@pytest.mark.slow
@pytest.mark.parametrize("vehicle", VEHICLES)
def test_what_can_be_connected_on_large_maps_is_planned(vehicle: str, tmp_path: Path) -> None:
    records = Records(None)
    pairs = [pair_of(vehicle, per_cent, i) for per_cent in (5, 10, 20) for i in range(2)]
    run_all(records, pairs, tmp_path, jobs=2, max_seconds=60.0)
    possible = [run for pair, run in records.runs.items() if records.answers[pair].connectable]
    print(table(records, pairs))
    assert sum(run.status == "verified" for run in possible) >= ENOUGH * len(possible) > 0
    assert not any(run.touched for run in possible)


def run_all(records: Records, pairs: Sequence[Pair], folder: Path, jobs: int, max_seconds: float) -> None:
    """Ask the oracle about all pairs and plan them, where there is no record of that; maps are written to a folder."""
    maps = dict.fromkeys((pair.vehicle, pair.per_cent) for pair in pairs)
    paths = {which: map_of(*which).write(folder) for which in maps}
    with workers(jobs, None) as executor:
        asking = []
        for which in maps:
            missing = [
                pair.index for pair in pairs if (pair.vehicle, pair.per_cent) == which and pair not in records.answers
            ]
            if missing:
                asking.append(executor.submit(asked, *which, missing))
        for answers in as_completed(asking):
            for answer in answers.result():
                records.add(answer)
        planning = []
        for pair in pairs:
            if pair not in records.runs:
                path = paths[pair.vehicle, pair.per_cent]
                planning.append(executor.submit(planned, pair.vehicle, pair.per_cent, pair.index, path, max_seconds))
        for made in as_completed(planning):
            run = made.result()
            records.add(run)
            print(f"{run.pair.name}: {run.status}, {run.total:.2f} s", flush=True)


def main(argv: Sequence[str] | None = None) -> None:
    """Plan pairs of large maps, and print what came out."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("pairs", nargs="?", type=int, default=100, help="of each map")
    parser.add_argument("--occupied", nargs="+", type=float, default=[5, 10, 20], metavar="PERCENT", help="the maps")
    parser.add_argument("--vehicle", choices=VEHICLES, default="robot")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--out", type=Path, metavar="FILE.json", help="records, which are not made again")
    parser.add_argument("--only", nargs="+", metavar="PERCENT:INDEX", help="these pairs")
    parser.add_argument("--max-seconds", type=float, default=60.0, help="of each plan")
    parser.add_argument("--maps", type=Path, metavar="FOLDER", help="where to leave the maps' files")
    arguments = parser.parse_args(argv)
    wanted = [(per_cent, i) for per_cent in arguments.occupied for i in range(arguments.pairs)]
    if arguments.only:
        parts = [name.split(":") for name in arguments.only]
        wanted = [(float(per_cent), int(index)) for per_cent, index in parts]
    pairs = [pair_of(arguments.vehicle, per_cent, index) for per_cent, index in wanted]
    records = Records(arguments.out)
    with tempfile.TemporaryDirectory() as folder:
        where = arguments.maps or Path(folder)
        where.mkdir(parents=True, exist_ok=True)
        run_all(records, pairs, where, arguments.jobs, arguments.max_seconds)
    print(table(records, pairs))


if __name__ == "__main__":
    main()
