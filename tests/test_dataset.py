"""The dataset: resumable, exact on disk, and everything kept is verified."""

from __future__ import annotations

import itertools
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from drake_gnnocp.experiments.dataset import generate as module
from drake_gnnocp.experiments.dataset.command import main
from drake_gnnocp.experiments.dataset.generate import (
    DatasetError,
    DatasetSettings,
    MakeMap,
    generate,
    load_dataset,
)
from drake_gnnocp.experiments.dataset.label import KEPT, label
from drake_gnnocp.experiments.dataset.records import SPLITS, MapRecord, load_records, save_records, split_of
from drake_gnnocp.experiments.tasks.draw import WIDE_MAPS, kind_of
from drake_gnnocp.experiments.tasks.place import KINDS
from drake_gnnocp.experiments.training.samples import Samples
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.vehicle import State, Vehicle
from drake_gnnocp.verification import verify

SINGLE = 1e-5  # m, rad: float32 at coordinates of 40 m


class Here(Executor):
    """Makes every map at once in this process."""

    def __init__(self, make: MakeMap, stop_after: int = 1000) -> None:
        self.make = make
        self.made: list[int] = []
        self.stop_after = stop_after

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Run it now."""
        future: Future[Any] = Future()
        settings, index = args
        if len(self.made) < self.stop_after:
            self.made.append(index)
            future.set_result(self.make(settings, index))
        else:
            future.set_exception(KeyboardInterrupt())
        return future


@pytest.fixture
def records(straight_record: MakeMap, small_dataset: DatasetSettings) -> list[MapRecord]:
    return [straight_record(small_dataset, index) for index in range(6)]


def test_a_run_that_was_stopped_goes_on(
    tmp_path: Path, straight_record: MakeMap, small_dataset: DatasetSettings
) -> None:
    stopped = Here(straight_record, stop_after=3)
    with pytest.raises(KeyboardInterrupt):
        generate(small_dataset, KINDS, tmp_path, stopped)
    rest = Here(straight_record)
    generate(small_dataset, KINDS, tmp_path, rest)
    assert sorted(stopped.made + rest.made) == list(range(7))
    assert [record.index for record in load_dataset(tmp_path)] == list(range(7))


def test_full_shards_replace_their_parts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, straight_record: MakeMap, small_dataset: DatasetSettings
) -> None:
    monkeypatch.setattr(module, "MAPS_PER_SHARD", 5)
    generate(small_dataset, KINDS, tmp_path, Here(straight_record))
    assert sorted(path.name for path in tmp_path.glob("*/*.npz")) == ["shard_000.npz", "shard_001.npz"]
    again = Here(straight_record)
    generate(small_dataset, KINDS, tmp_path, again)
    assert again.made == []


def test_kinds_can_be_made_one_after_the_other(
    tmp_path: Path, straight_record: MakeMap, small_dataset: DatasetSettings
) -> None:
    generate(small_dataset, ("yard",), tmp_path, Here(straight_record))
    assert {record.place.kind for record in load_dataset(tmp_path)} == {"yard"}


def test_a_folder_of_other_settings_is_refused(
    tmp_path: Path, straight_record: MakeMap, small_dataset: DatasetSettings
) -> None:
    generate(small_dataset, KINDS, tmp_path, Here(straight_record))
    with pytest.raises(DatasetError, match="settings.json"):
        generate(DatasetSettings(seed=4), KINDS, tmp_path, Here(straight_record))
    assert main(["--seed", "4", "--out", str(tmp_path)]) == 2


def test_records_come_back_from_disk(tmp_path: Path, records: list[MapRecord]) -> None:
    save_records(tmp_path / "x.npz", records)
    for record, found in zip(records, load_records(tmp_path / "x.npz"), strict=True):
        assert (found.index, found.place.kind, found.place.area) == (record.index, record.place.kind, record.place.area)
        assert found.place.vehicle == record.place.vehicle
        assert all(np.array_equal(a, b) for a, b in zip(found.place.obstacles, record.place.obstacles, strict=True))
        assert all(np.array_equal(a, b) for a, b in zip(found.place.slots, record.place.slots, strict=True))
        for task, same in zip(record.tasks, found.tasks, strict=True):
            assert task.name == same.name and np.array_equal([task.start, task.goal], [same.start, same.goal])
        for one, other in zip(record.labels, found.labels, strict=True):
            assert one.outcome == other.outcome
            if one.trajectory is not None and other.trajectory is not None:
                np.testing.assert_allclose(other.trajectory.states, one.trajectory.states, atol=SINGLE)
                assert other.trajectory.duration == one.trajectory.duration
            else:
                assert one.trajectory is other.trajectory is None


def test_a_map_without_tasks_or_plans_can_be_stored(tmp_path: Path, records: list[MapRecord]) -> None:
    bare = MapRecord(0, records[0].place, (), ())
    save_records(tmp_path / "x.npz", [bare])
    assert load_records(tmp_path / "x.npz")[0].tasks == ()


@pytest.mark.parametrize("kept", [0.0, 0.5, 0.97, None])
def test_a_broken_file_is_named(kept: float | None, tmp_path: Path, records: list[MapRecord]) -> None:
    path = tmp_path / "shards" / "shard_000.npz"
    path.parent.mkdir()
    save_records(path, records[:1])
    whole = path.read_bytes()
    path.write_bytes(b"nothing" if kept is None else whole[: int(kept * len(whole))])
    with pytest.raises(DatasetError, match="shard_000.npz"):
        load_dataset(tmp_path)


def test_a_folder_without_a_dataset_is_named(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="no dataset"):
        load_dataset(tmp_path / "nowhere")


def test_splits_are_80_10_10_by_map_and_have_maps_of_every_kind() -> None:
    splits = [split_of(index) for index in range(800)]
    assert (splits.count("train"), splits.count("validation"), splits.count("test")) == (640, 80, 80)
    found = {(split_of(index), kind_of(index)) for index in range(WIDE_MAPS + 100)}
    assert found == set(itertools.product(SPLITS, KINDS))


def test_what_is_kept_is_verified() -> None:
    task = Scenario.load("map_b")
    found = label(task)
    assert found.outcome == KEPT and found.trajectory is not None
    assert verify(task, found.trajectory).verified


def test_samples_are_in_lengths_of_the_car(straight_record: MakeMap) -> None:
    records = [straight_record(DatasetSettings(seed=3, pairs=2), WIDE_MAPS + i) for i in range(4)]
    sizes = [record.place.vehicle.size for record in records]
    assert min(sizes) < 0.7
    samples = Samples.of(records, 30)
    length = samples.vehicle[:, :3].sum(dim=1)
    assert length.tolist() == pytest.approx([Vehicle().length] * len(records))
    for i, (record, size) in enumerate(zip(records, sizes, strict=True)):
        task, states = record.tasks[0], samples.states[samples.map == i][0]
        distance = np.hypot(*(task.goal - task.start)[:2]) / size
        assert torch.linalg.norm(states[-1, :2] - states[0, :2]).item() == pytest.approx(distance, rel=1e-4)


def test_samples_in_tight_places_may_count_more(straight_record: MakeMap) -> None:
    settings = DatasetSettings(seed=3, pairs=4)
    samples = Samples.of([straight_record(settings, index) for index in (0, WIDE_MAPS)], 30)
    more = samples.with_more_tight(3)
    before, after = (torch.bincount(of.map, minlength=2).tolist() for of in (samples, more))
    assert before == [2, 2] and after == [2, 6]
    torch.testing.assert_close(more.states[more.map == 1][::2], samples.states[samples.map == 1].repeat(3, 1, 1)[::2])


def test_batches_are_seen_from_the_start(records: list[MapRecord]) -> None:
    samples = Samples.of(records, 30)
    rows = torch.arange(len(samples))
    batch = samples.plain_batch(rows)
    tasks = [task for record in records for i, task in enumerate(record.tasks) if i % 2 == 0]
    assert len(tasks) == len(samples)
    assert (batch.states[:, 0, :3] == 0).all()
    for row, task in enumerate(tasks):
        distance = np.hypot(*(task.goal - task.start)[:2])
        assert torch.linalg.norm(batch.scene.goal[row, :2]).item() == pytest.approx(distance, rel=1e-5)
    backwards = samples.batch(rows, rows < 0, rows >= 0)
    # what was the start is the goal, seen from where the goal was
    there, back = (torch.linalg.norm(seen.scene.goal[:, :2], dim=1) for seen in (batch, backwards))
    assert torch.allclose(there, back, atol=10 * SINGLE)
    assert (backwards.states[..., State.V] <= 1e-6).all()
    in_a_mirror = samples.batch(rows, rows >= 0, rows < 0)
    assert torch.equal(in_a_mirror.states[..., State.Y], -batch.states[..., State.Y])
    for seen in (batch, backwards, in_a_mirror):  # a label ends at the goal
        assert torch.allclose(seen.states[:, -1, :2], seen.scene.goal[:, :2], atol=10 * SINGLE)
