"""Runs of the planner on pairs of poses of large maps, one record each, and a table of them."""

from __future__ import annotations

import json
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields
from functools import cache
from pathlib import Path
from unittest.mock import patch

import numpy as np
from lattice_oracle import Oracle
from map_tasks import SPECKS, VEHICLES, TaskMap, draw_map, footprints
from raw_cells import driven

from drake_gnnocp import Plan, Scenario, Trajectory, Vehicle, plan
from drake_gnnocp.ocp import refine
from drake_gnnocp.verification import Verification, verify

SPACING = 0.005  # m, no corner moves farther from one pose that is checked to the next
STAGES = ("read", "guess", "build", "solve", "check", "rest")
QUANTILES = {0.5: "median", 0.95: "p95", 0.99: "p99", 1.0: "max"}
VERIFIED = "verified"
SLOW = 5.0  # s of the processor, such runs are listed: they are slow on an idle machine as well


@dataclass(frozen=True)
class Pair:
    """Two poses of a map: what a record is about."""

    vehicle: str
    per_cent: float
    index: int
    checksum: int  # of the map

    @property
    def name(self) -> str:
        """As on the command line."""
        return f"{self.per_cent:g}:{self.index}"


@dataclass(frozen=True)
class Answer:
    """What the oracle says of a pair."""

    pair: Pair
    connectable: bool


@dataclass(frozen=True)
class Run:
    """What the planner made of a pair."""

    pair: Pair
    status: str
    source: str  # of the guess that led to the plan
    attempts: int  # from which something was solved
    reasons: tuple[str, ...]  # of all attempts: their sources, and why they were given up
    seconds: dict[str, float]  # s, of the STAGES
    cpu: float  # s, of the processor: reading and planning
    touched: int  # occupied cells
    off_goal: float  # m, where the inputs lead to
    length: float  # m, of the plan's path
    polygons: int  # of the map

    @property
    def total(self) -> float:
        """Reading and planning [s]."""
        return sum(self.seconds.values())


Record = Answer | Run


@cache
def map_of(vehicle: str, per_cent: float) -> TaskMap:
    """The usual map for a vehicle, drawn once a process."""
    return draw_map(per_cent, SPECKS[vehicle])


def pair_of(vehicle: str, per_cent: float, index: int) -> Pair:
    """A pair of the usual map."""
    return Pair(vehicle, per_cent, index, map_of(vehicle, per_cent).checksum)


def asked(vehicle: str, per_cent: float, indices: Iterable[int]) -> list[Answer]:
    """What the oracle says of some pairs of a map."""
    indices, car, task_map = list(indices), VEHICLES[vehicle], map_of(vehicle, per_cent)
    oracle, pairs = Oracle(task_map, car), task_map.pairs(car, max(indices) + 1)
    return [Answer(pair_of(vehicle, per_cent, i), oracle.connects(*pairs[i])) for i in indices]


def planned(vehicle: str, per_cent: float, index: int, path: Path, max_seconds: float) -> Run:
    """Read a map that was written, plan a pair of its poses, and look at what the plan touches."""
    task_map, car = map_of(vehicle, per_cent), VEHICLES[vehicle]
    start, goal = task_map.pairs(car, index + 1)[index]
    _warmed()
    begin, cpu = time.perf_counter(), time.process_time()
    scenario = Scenario.load(path, start=start, goal=goal, vehicle=car)
    read = time.perf_counter() - begin
    with _timed_checks() as checks:
        result = plan(scenario, max_seconds=max_seconds)
    total, cpu = time.perf_counter() - begin, time.process_time() - cpu
    touched, off_goal = looked_at(result, task_map, car) if result.verified else (0, 0.0)
    return Run(
        pair_of(vehicle, per_cent, index),
        result.status,
        result.guess_source,
        sum(made.best is not None for made in result.attempts),
        tuple(f"{made.source}: {made.reason or VERIFIED}" for made in result.attempts),
        _stages(result, read, sum(checks), total),
        cpu,
        touched,
        off_goal,
        result.trajectory.path_length if result.trajectory else 0.0,
        len(scenario.obstacles),
    )


@cache
def _warmed() -> None:
    """Load the network, and what else is loaded at a process's first plan."""
    plan("map_a")


@contextmanager
def _timed_checks() -> Iterator[list[float]]:
    """How long the verifications take that planning makes meanwhile [s]."""
    seconds: list[float] = []

    def timed(scenario: Scenario, trajectory: Trajectory) -> Verification:
        begin = time.perf_counter()
        found = verify(scenario, trajectory)
        seconds.append(time.perf_counter() - begin)
        return found

    with patch.object(refine, "verify", timed):
        yield seconds


def _stages(result: Plan, read: float, check: float, total: float) -> dict[str, float]:
    guess = sum(made.guess_seconds for made in result.attempts)
    build = sum(made.build_seconds for made in result.attempts)
    solve = sum(made.solve_seconds for made in result.attempts)
    return dict(
        zip(STAGES, (read, guess, build, solve, check, total - read - guess - build - solve - check), strict=True)
    )


def looked_at(result: Plan, task_map: TaskMap, vehicle: Vehicle) -> tuple[int, float]:
    """How many occupied cells a plan touches, and how far from the goal it ends [m], when its inputs are driven."""
    trajectory, start = result.trajectory, result.scenario.start
    assert trajectory is not None
    a, w = trajectory.inputs.T
    poses = driven(start, trajectory.t, a, w, vehicle.wheelbase, vehicle.length, SPACING)
    off_goal = float(np.abs(poses[-1, :2] - result.scenario.goal[:2]).max())
    return task_map.cells.touched(footprints(vehicle, poses)), off_goal


class Records:
    """Records in a file, one a line: a line that was not finished is left out."""

    def __init__(self, path: Path | None) -> None:
        self.path = path
        self.answers: dict[Pair, Answer] = {}
        self.runs: dict[Pair, Run] = {}
        if path is not None and path.exists():
            text = path.read_text()
            for line in text.splitlines():
                self._keep(_record_of(line))
            if not text.endswith("\n"):
                path.write_text(text + "\n")

    def add(self, record: Record) -> None:
        """Keep a record, in the file as well."""
        self._keep(record)
        if self.path is not None:
            with self.path.open("a") as file:
                file.write(json.dumps(asdict(record)) + "\n")

    def _keep(self, record: Record | None) -> None:
        if isinstance(record, Answer):
            self.answers[record.pair] = record
        elif record is not None:
            self.runs[record.pair] = record


def _record_of(line: str) -> Record | None:
    try:
        values = json.loads(line)
    except json.JSONDecodeError:
        return None
    kind = Answer if "connectable" in values else Run
    values["pair"] = Pair(**values["pair"])
    values["reasons"] = tuple(values.get("reasons", ()))
    return kind(**{field.name: values[field.name] for field in fields(kind)})


def table(records: Records, pairs: list[Pair]) -> str:
    """What came out of some pairs, map by map and all together, and every one that fails or is slow."""
    done = [pair for pair in pairs if pair in records.runs and pair in records.answers]
    parts = {f"{pair.per_cent:g} %": [other for other in done if other.per_cent == pair.per_cent] for pair in done}
    columns = [_column(records, part) for part in [*parts.values(), done]]
    heads = ["", *parts, "all"]
    rows = [[label, *(column[label] for column in columns)] for label in columns[-1]]
    width = [max(len(row[k]) for row in [heads, *rows]) for k in range(len(heads))]
    lines = [
        "  ".join([row[0].ljust(width[0]), *(cell.rjust(size) for cell, size in zip(row[1:], width[1:], strict=True))])
        for row in [heads, *rows]
    ]
    return "\n".join([*lines, "", *_listed(records, done)])


def _column(records: Records, pairs: list[Pair]) -> dict[str, str]:
    runs = [records.runs[pair] for pair in pairs]
    possible = [run for run in runs if records.answers[run.pair].connectable]
    others = [run for run in runs if not records.answers[run.pair].connectable]
    verified = [run for run in possible if run.status == VERIFIED]
    column = {
        "pairs": str(len(runs)),
        "connectable by the oracle": str(len(possible)),
        "verified of these": str(len(verified)),
        "verified of these [%]": f"{100 * len(verified) / max(len(possible), 1):.1f}",
        "verified of the others": str(sum(run.status == VERIFIED for run in others)),
        "no path of the others": str(sum(run.status == "no_path" for run in others)),
        "plans of the network": str(sum(run.source == "gnn" for run in verified)),
        "plans of the fallback": str(sum(run.source != "gnn" for run in verified)),
        "plans of the first solved attempt": str(sum(run.attempts == 1 for run in verified)),
        "solved attempts at most": str(max((run.attempts for run in runs), default=0)),
        "raw cells touched": str(sum(run.touched for run in runs)),
        "off the goal at most [mm]": f"{1e3 * max((run.off_goal for run in runs), default=0.0):.1f}",
        "polygons": str(max((run.polygons for run in runs), default=0)),
    }
    spreads = {
        "map to polygons [s]": ([run.seconds["read"] for run in runs], (0.5, 1.0)),
        "total [s]": ([run.total for run in possible], (0.5, 0.95, 0.99, 1.0)),
        "of processor [s]": ([run.cpu for run in possible], (0.5, 0.95, 0.99, 1.0)),
        **{f"{stage} [s]": ([run.seconds[stage] for run in possible], (0.5, 0.95)) for stage in STAGES},
    }
    for what, (values, quantiles) in spreads.items():
        for quantile in quantiles:
            number = f"{np.quantile(values, quantile):.2f}" if values else "-"
            column[f"{what} {QUANTILES[quantile]}"] = number
    return column


def _listed(records: Records, pairs: list[Pair]) -> Iterator[str]:
    for pair in pairs:
        run, connectable = records.runs[pair], records.answers[pair].connectable
        faults = [
            *([f"{run.status}, connectable"] if connectable and run.status != VERIFIED else []),
            *([f"touches {run.touched} cells"] if run.touched else []),
            *([f"slow{'' if connectable else ', not connectable'}"] if run.cpu > SLOW else []),
        ]
        if faults:
            start, goal = map_of(pair.vehicle, pair.per_cent).pairs(VEHICLES[pair.vehicle], pair.index + 1)[pair.index]
            ends = " to ".join(f"({x:.6f}, {y:.6f}, {theta:.6f})" for x, y, theta in (start, goal))
            stages = ", ".join(f"{stage} {run.seconds[stage]:.1f}" for stage in STAGES)
            command = f"--vehicle {pair.vehicle} --only {pair.name}"
            yield f"{command}: {'; '.join(faults)}; {run.total:.1f} s, {run.cpu:.1f} s of processor ({stages}); {ends}"
            yield from (f"    {reason}" for reason in run.reasons)
