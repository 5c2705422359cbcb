"""What is stored of a map: the place, its tasks, and a verified trajectory of every task that has one.

Maps are stored in `.npz` files, one or many a file, as arrays without pickled objects:

    map_*       one row a map: index, kind, area, vehicle, number of rings, lines, slots and tasks, whether bounded
    ring_size, vertices, slots                     rings and slots of all maps one after the other
    line_size, line_vertices                       walls without thickness likewise
    task_*      one row a task: start, goal, outcome, cost, iterations, rounds, source
    duration, knots                                one row a task whose outcome is "kept"; knots are float32
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from drake_gnnocp.experiments.dataset.label import KEPT, SEARCHED, Label
from drake_gnnocp.experiments.tasks.draw import PAPER_MAPS
from drake_gnnocp.experiments.tasks.place import Place
from drake_gnnocp.files import write_atomically
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.trajectory import Trajectory
from drake_gnnocp.vehicle import Vehicle

SPLITS = ("train", "validation", "test")
_OF_MAP = ("index", "kind", "area", "vehicle", "rings", "lines", "slots", "tasks", "bounded")


@dataclass(frozen=True)
class MapRecord:
    """A map with its tasks and how each of them ended."""

    index: int
    place: Place
    tasks: tuple[Scenario, ...]
    labels: tuple[Label, ...]

    @property
    def split(self) -> str:
        """One of SPLITS: maps, never samples, are split."""
        return split_of(self.index)

    @property
    def trajectories(self) -> list[Trajectory]:
        """Those of the tasks that were solved."""
        return [label.trajectory for label in self.labels if label.trajectory is not None]


def split_of(index: int) -> str:
    """The split of map `index`: of ten maps two are for validation and for the test.

    Of the paper's maps those for validation are open ones and car parks, those for the test open ones and yards. Of the
    maps after them it is the other way round, so that there is every kind in every split.
    """
    held_out = ("validation", "test") if index < PAPER_MAPS else ("test", "validation")
    return {8: held_out[0], 9: held_out[1]}.get(index % 10, "train")


def save_records(path: Path, records: list[MapRecord]) -> None:
    """Write maps; a killed run leaves no half-written file."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **_arrays(records))  # type: ignore[arg-type]
    write_atomically(path, buffer.getvalue())


def load_records(path: Path) -> list[MapRecord]:
    """Read what `save_records` wrote.

    Raises:
        ValueError: a number is not finite, or whatever zipfile, zlib and numpy raise for a file that is damaged.
    """
    # opened here: numpy leaves a file open that is no whole archive
    with path.open("rb") as source, np.load(source, allow_pickle=False) as file:
        arrays = dict(file)
    for name, array in arrays.items():
        if array.dtype.kind == "f" and name != "task_cost" and not np.isfinite(array).all():  # no plan has no cost
            raise ValueError(f"{name}: holds numbers that are not finite")
    n = len(arrays["map_index"])
    before = {  # files from before these were kept
        "task_source": np.full(len(arrays["task_outcome"]), SEARCHED),
        "map_lines": np.zeros(n, dtype=int),
        "map_bounded": np.zeros(n, dtype=bool),
        "line_size": np.zeros(0, dtype=int),
        "line_vertices": np.zeros((0, 2)),
    }
    arrays = before | arrays
    rings = iter(np.split(arrays["vertices"], np.cumsum(arrays["ring_size"])[:-1]))
    lines = iter(np.split(arrays["line_vertices"], np.cumsum(arrays["line_size"])[:-1]))
    slots, rows = iter(arrays["slots"]), iter(range(len(arrays["task_outcome"])))
    samples = zip(arrays["duration"], arrays["knots"], strict=True)
    records = []
    maps = (arrays[f"map_{key}"] for key in _OF_MAP)
    for index, kind, area, vehicle, n_rings, n_lines, n_slots, n_tasks, is_bounded in zip(*maps, strict=True):
        obstacles, free = tuple(islice(rings, n_rings)), tuple(islice(slots, n_slots))
        walls, car = tuple(islice(lines, n_lines)), Vehicle(*vehicle.tolist())
        place = Place(str(kind), tuple(area.tolist()), obstacles, free, car, walls, bool(is_bounded))
        of_map = list(islice(rows, n_tasks))
        tasks = tuple(_scenario(arrays, row, place) for row in of_map)
        records.append(MapRecord(int(index), place, tasks, tuple(_label(arrays, row, samples) for row in of_map)))
    return records


def _scenario(arrays: dict[str, np.ndarray], task: int, place: Place) -> Scenario:
    name, start, goal = (arrays[f"task_{key}"][task] for key in ("name", "start", "goal"))
    return place.task(str(name), start, goal)


def _label(arrays: dict[str, np.ndarray], task: int, samples: Iterator[tuple[float, np.ndarray]]) -> Label:
    outcome, cost, iterations, rounds = (
        arrays[f"task_{key}"][task].item() for key in ("outcome", "cost", "iterations", "rounds")
    )
    trajectory = None
    if outcome == KEPT:
        duration, knots = next(samples)
        knots = knots.astype(float)
        trajectory = Trajectory(np.linspace(0.0, float(duration), len(knots)), knots[:, :5], knots[:, 5:])
    return Label(outcome, trajectory, cost, iterations, rounds, str(arrays["task_source"][task]))


def _arrays(records: list[MapRecord]) -> dict[str, np.ndarray]:
    places = [record.place for record in records]
    rings = [ring for place in places for ring in place.obstacles]
    lines = [line for place in places for line in place.lines]
    tasks = [task for record in records for task in record.tasks]
    labels = [label for record in records for label in record.labels]
    kept = [trajectory for record in records for trajectory in record.trajectories]
    knots = [np.hstack([trajectory.states, trajectory.inputs]) for trajectory in kept]
    return {
        "map_index": np.array([record.index for record in records]),
        "map_kind": np.array([place.kind for place in places]),
        "map_area": np.array([place.area for place in places]).reshape(-1, 4),
        "map_vehicle": np.array([list(place.vehicle.to_dict().values()) for place in places]),
        "map_rings": np.array([len(place.obstacles) for place in places]),
        "map_lines": np.array([len(place.lines) for place in places]),
        "map_bounded": np.array([place.is_bounded for place in places]),
        "map_slots": np.array([len(place.slots) for place in places]),
        "map_tasks": np.array([len(record.tasks) for record in records]),
        "ring_size": np.array([len(ring) for ring in rings], dtype=int),
        "vertices": np.concatenate([np.zeros((0, 2)), *rings]),
        "line_size": np.array([len(line) for line in lines], dtype=int),
        "line_vertices": np.concatenate([np.zeros((0, 2)), *lines]),
        "slots": np.array([slot for place in places for slot in place.slots]).reshape(-1, 3),
        "task_name": np.array([task.name for task in tasks], dtype=str),
        "task_start": np.array([task.start for task in tasks]).reshape(-1, 3),
        "task_goal": np.array([task.goal for task in tasks]).reshape(-1, 3),
        "task_outcome": np.array([label.outcome for label in labels], dtype=str),
        "task_cost": np.array([label.cost for label in labels], dtype=float),
        "task_iterations": np.array([label.iterations for label in labels], dtype=int),
        "task_rounds": np.array([label.rounds for label in labels], dtype=int),
        "task_source": np.array([label.source for label in labels], dtype=str),
        "duration": np.array([trajectory.duration for trajectory in kept], dtype=float),
        "knots": np.array(knots, dtype=np.float32).reshape(len(kept), -1, 7) if kept else np.zeros((0, 2, 7)),
    }
