"""The dataset made map by map: by any executor, resumable at any time.

A finished map is a file in `parts/`; when all maps of a shard are there, they become one file in `shards/`. A run that
is killed loses the maps it was working on, no more.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Callable
from concurrent.futures import Executor, Future, as_completed
from dataclasses import asdict, dataclass
from pathlib import Path

from tqdm import tqdm

from drake_gnnocp.experiments.dataset.label import label
from drake_gnnocp.experiments.dataset.records import MapRecord, load_records, save_records
from drake_gnnocp.experiments.tasks.draw import WIDE_MAPS, draw_place, draw_tasks, kind_of
from drake_gnnocp.experiments.tasks.place import TIGHT
from drake_gnnocp.files import first_line, write_atomically

logger = logging.getLogger(__name__)

MAPS_PER_SHARD = 20
ORIGIN = "origin"  # in settings.json, beside the settings


class DatasetError(ValueError):
    """A folder does not hold the dataset it should; the message names the file."""


@dataclass(frozen=True)
class DatasetSettings:
    """What is drawn."""

    seed: int = 0
    maps: int = WIDE_MAPS + 530
    pairs: int = 15  # of start and goal, on each map; the paper's
    tight_pairs: int = 8  # on each tight place: there is less to be different


MakeMap = Callable[[DatasetSettings, int], MapRecord]


def make_map(settings: DatasetSettings, index: int) -> MapRecord:
    """Draw map `index` and solve its tasks; called in the executor's workers."""
    place = draw_place(settings.seed, index)
    tasks = draw_tasks(settings.seed, index, place, settings.tight_pairs if place.kind == TIGHT else settings.pairs)
    return MapRecord(index, place, tuple(tasks), tuple(map(label, tasks)))


def generate(
    settings: DatasetSettings,
    kinds: tuple[str, ...],
    folder: Path,
    executor: Executor,
    make: MakeMap = make_map,
    origin: str = "",
) -> None:
    """Make the maps that are not in the folder yet.

    Args:
        settings: those of the folder, where it holds a dataset already.
        kinds: of the maps to make now.
        folder: made where it is missing.
        executor: any with the interface of `concurrent.futures`; maps are its jobs.
        make: called in the executor's workers.
        origin: what else `make` depends on; a dataset goes on with the same only.

    Raises:
        DatasetError: the folder holds a dataset with other settings.
        OSError: the folder cannot be written.
    """
    for name in ("parts", "shards"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    check_settings(folder, settings, origin)
    missing = missing_maps(folder, settings, kinds)
    jobs: set[Future[MapRecord]] = {executor.submit(make, settings, index) for index in missing}
    try:
        for job in tqdm(as_completed(jobs), total=len(jobs), unit="map", smoothing=0.05):
            _store(job, folder, settings)
            jobs.remove(job)
    finally:  # where one failed, what others have done is not lost
        for job in jobs:
            if not job.cancel() and job.done() and job.exception() is None:
                _store(job, folder, settings)


def _store(job: Future[MapRecord], folder: Path, settings: DatasetSettings) -> None:
    record = job.result()
    save_records(_part(folder, record.index), [record])
    _merge(folder, settings, record.index // MAPS_PER_SHARD)


def load_dataset(folder: Path) -> list[MapRecord]:
    """All maps of a dataset in their order, those of unfinished shards too.

    Raises:
        DatasetError: there is no dataset, or a file of it cannot be read.
    """
    # parts first: while a dataset is being made, they may become a shard, which is found afterwards
    records = _read(sorted((folder / "parts").glob("*.npz"))) | _read(sorted((folder / "shards").glob("*.npz")))
    if not records:
        raise DatasetError(f"{folder}: no dataset here; make one with python -m drake_gnnocp.dataset --out {folder}")
    return [records[index] for index in sorted(records)]


def load_map(folder: Path, settings: DatasetSettings, index: int) -> MapRecord:
    """One map of a dataset.

    Raises:
        DatasetError: it is not there, or its file cannot be read.
    """
    part, shard = _part(folder, index), _shard(folder, index // MAPS_PER_SHARD)
    record = _read([part, shard]).get(index)
    if record is None:
        raise DatasetError(f"{folder}: map {index} of {settings.maps} is not there; finish this dataset first")
    return record


def _read(files: list[Path]) -> dict[int, MapRecord]:
    records = {}
    for path in files:
        try:
            records.update({record.index: record for record in load_records(path)})
        except FileNotFoundError:
            continue
        except Exception as error:  # zip, zlib and numpy have no common class for what damage looks like
            raise DatasetError(f"{path}: not maps of a dataset, or damaged: {first_line(error)}") from None
    return records


def check_settings(folder: Path, settings: DatasetSettings, origin: str = "") -> None:
    """Write the settings of a new dataset, or see that they are those of the folder.

    Raises:
        DatasetError: they are not.
    """
    path = folder / "settings.json"
    text = json.dumps(asdict(settings) | ({ORIGIN: origin} if origin else {}), indent=1) + "\n"
    if not path.exists():
        write_atomically(path, text)
    elif (found := path.read_text(encoding="utf-8", errors="replace")) != text:
        there = " ".join(found.split())
        raise DatasetError(f"{path}: the dataset here was made with {there}; choose another --out")


def settings_of(folder: Path) -> DatasetSettings:
    """The settings of the dataset in a folder.

    Raises:
        DatasetError: there is none.
    """
    path = folder / "settings.json"
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        return DatasetSettings(**{name: value for name, value in found.items() if name != ORIGIN})
    except (OSError, AttributeError, TypeError, ValueError) as error:
        raise DatasetError(f"{path}: not the settings of a dataset: {error}") from None


def missing_maps(folder: Path, settings: DatasetSettings, kinds: tuple[str, ...]) -> list[int]:
    """Indices of the maps of some kinds that are not in a folder yet."""
    done = {int(path.stem.split("_")[1]) for path in (folder / "parts").glob("map_*.npz")}
    for path in (folder / "shards").glob("shard_*.npz"):
        done.update(_maps_of(settings, int(path.stem.split("_")[1])))
    return [index for index in range(settings.maps) if index not in done and kind_of(index) in kinds]


def _maps_of(settings: DatasetSettings, shard: int) -> range:
    return range(shard * MAPS_PER_SHARD, min((shard + 1) * MAPS_PER_SHARD, settings.maps))


def _part(folder: Path, index: int) -> Path:
    return folder / "parts" / f"map_{index:05d}.npz"


def _shard(folder: Path, number: int) -> Path:
    return folder / "shards" / f"shard_{number:03d}.npz"


def _merge(folder: Path, settings: DatasetSettings, shard: int) -> None:
    """Make a shard of its parts, where all are there."""
    parts = [_part(folder, index) for index in _maps_of(settings, shard)]
    if all(part.exists() for part in parts):
        records = _read(parts)
        save_records(_shard(folder, shard), [records[index] for index in sorted(records)])
        for part in parts:
            part.unlink()
