"""Files that were damaged, folders that are in use, and workers that die: one clear error, or another try."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Executor, Future
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from safetensors import safe_open

from drake_gnnocp import GuessUnavailable, PlanOptions, Scenario, plan
from drake_gnnocp.experiments.dataset import command
from drake_gnnocp.experiments.dataset.generate import DatasetError, DatasetSettings, MakeMap, load_dataset, make_map
from drake_gnnocp.experiments.dataset.records import MapRecord, save_records
from drake_gnnocp.experiments.reports.planning import main as benchmark_main
from drake_gnnocp.files import locked
from drake_gnnocp.guesses.learned import bundled_weights
from drake_gnnocp.learning.checkpoint import WeightsError, load_weights, save_weights
from drake_gnnocp.learning.configs import config_of
from drake_gnnocp.learning.trainable import Network, new_network, trained

BAD_INPUT = 2  # exit code
FIELD = Scenario("field", np.zeros(3), np.array([12.0, 4.0, 0.4]))  # no obstacles


@pytest.fixture
def network() -> Network:
    """An untrained one."""
    torch.manual_seed(0)
    return new_network(config_of("paper"))


def test_the_packages_weights_have_a_checksum() -> None:
    for config in ("default", "paper"):
        with safe_open(bundled_weights(config), framework="numpy") as file:
            assert re.fullmatch("[0-9a-f]{64}", file.metadata()["checksum"])


def test_weights_that_were_damaged_are_noticed(tmp_path: Path, network: Network) -> None:
    path = tmp_path / "weights.safetensors"
    save_weights(path, trained(network), {})
    load_weights(path)
    whole, largest = path.read_bytes(), max(network.state_dict().values(), key=torch.numel)
    at = whole.index(largest.numpy().tobytes()[:64])
    for damaged in (
        whole[: at + 8] + b"\x01\x02\x03" + whole[at + 11 :],  # in the numbers
        whole[: len(whole) // 2],
        b"PK" + whole[5:],
        b"",
    ):
        path.write_bytes(damaged)
        with pytest.raises(WeightsError, match=rf"^{re.escape(str(path))}: (damaged|not weights of this version)"):
            load_weights(path)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_weights_that_are_not_finite_are_refused(
    value: float, tmp_path: Path, network: Network, capsys: pytest.CaptureFixture[str]
) -> None:
    with torch.no_grad():
        next(network.parameters()).view(-1)[0] = value
    save_weights(tmp_path / "weights.safetensors", trained(network), {})
    with pytest.raises(GuessUnavailable, match=r"weights.safetensors: holds weights that are not finite"):
        plan(FIELD, "gnn", options=PlanOptions(weights=tmp_path / "weights.safetensors"))
    arguments = [
        "map_a",
        "--methods",
        "gnn",
        "--out",
        str(tmp_path / "out"),
        "--weights",
        str(tmp_path / "weights.safetensors"),
    ]
    assert benchmark_main(arguments) == BAD_INPUT
    assert capsys.readouterr().err.count("\n") == 1


def test_a_network_that_predicts_nonsense_gives_way_to_the_search(tmp_path: Path, network: Network) -> None:
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.mul_(1e18)
    save_weights(tmp_path / "weights.safetensors", trained(network), {})
    result = plan(FIELD, options=PlanOptions(weights=tmp_path / "weights.safetensors"))
    assert result.verified and result.guess_source == "hybrid_astar"


def damaged_copies(whole: bytes, rng: np.random.Generator) -> list[bytes]:
    """A file with other bytes in it, cut off, or with a piece left out."""
    copies = []
    for _ in range(40):
        first, last = np.sort(rng.integers(0, len(whole), 2))
        noise = rng.integers(0, 256, min(last - first, 20), dtype=np.uint8).tobytes()
        copies += [whole[:first] + noise + whole[first + len(noise) :], whole[:first], whole[:first] + whole[last:]]
    return copies


def test_every_damage_of_a_shard_is_the_same_error(
    tmp_path: Path, straight_record: Callable[..., MapRecord], small_dataset: DatasetSettings
) -> None:
    path = tmp_path / "shards" / "shard_000.npz"
    path.parent.mkdir()
    save_records(path, [straight_record(small_dataset, index) for index in range(2)])
    whole = path.read_bytes()
    refused = 0
    for damaged in damaged_copies(whole, np.random.default_rng(0)):
        path.write_bytes(damaged)
        try:
            records = load_dataset(tmp_path)
        except DatasetError as error:
            refused += 1
            assert str(error).startswith(f"{path}: not maps of a dataset, or damaged: ") and "\n" not in str(error)
        else:  # dates and the like: what matters has a checksum of zip
            path.with_name("again.npz").unlink(missing_ok=True)
            save_records(path.with_name("again.npz"), records)
            assert all(record.tasks for record in records)
            path.with_name("again.npz").unlink()
    assert refused > 100


@pytest.mark.parametrize("name", ["knots", "vertices", "map_vehicle", "task_start", "duration"])
def test_a_shard_with_numbers_that_are_not_finite_is_refused(
    name: str, tmp_path: Path, straight_record: Callable[..., MapRecord], small_dataset: DatasetSettings
) -> None:
    path = tmp_path / "parts" / "map_00000.npz"
    path.parent.mkdir()
    save_records(path, [straight_record(small_dataset, 0)])
    with np.load(path) as file:
        arrays: dict[str, Any] = dict(file)
    arrays[name].reshape(-1)[0] = np.nan
    np.savez(path, **arrays)
    with pytest.raises(DatasetError, match=f"{name}: holds numbers that are not finite"):
        load_dataset(tmp_path)


def test_a_folder_is_worked_in_by_one_run_at_a_time(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    benchmark = ["empty_field", "--methods", "hybrid_astar", "--out", str(tmp_path)]
    dataset = ["--maps", "1", "--pairs", "0", "--jobs", "1", "--out", str(tmp_path)]
    with locked(tmp_path):
        for main, arguments in ((benchmark_main, benchmark), (command.main, dataset)):
            assert main(arguments) == BAD_INPUT
            assert capsys.readouterr().err == (
                f"{tmp_path}: another run is at work here; wait for it, or choose another --out\n"
            )
    with locked(tmp_path):
        pass


def test_the_lock_of_a_process_that_was_killed_does_not_block(tmp_path: Path) -> None:
    code = "import sys, time; from pathlib import Path; from drake_gnnocp.files import locked\n"
    code += "with locked(Path(sys.argv[1])):\n    print('locked', flush=True); time.sleep(60)"
    with subprocess.Popen([sys.executable, "-c", code, str(tmp_path)], stdout=subprocess.PIPE) as other:
        assert other.stdout is not None and other.stdout.readline() == b"locked\n"
        with pytest.raises(ValueError, match="another run is at work here"), locked(tmp_path):
            pass
        other.kill()
    with locked(tmp_path):
        pass


class Dying(Executor):
    """Makes maps in this process, but its workers are killed by some of them, which ends all that wait as well."""

    def __init__(self, make: MakeMap, deadly: list[int]) -> None:
        self._make, self._deadly, self._is_broken = make, deadly, False

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Run it now."""
        future: Future[Any] = Future()
        settings, index = args
        if index in self._deadly:
            self._is_broken = True
            self._deadly.remove(index)
        if self._is_broken:
            future.set_exception(BrokenExecutor())
        else:
            future.set_result(self._make(settings, index))
        return future


@pytest.mark.parametrize(("deadly", "code"), [([1, 4], 0), ([1, 1], BAD_INPUT)])
def test_maps_of_a_worker_that_was_killed_are_tried_again_as_long_as_others_are_made(
    deadly: list[int],
    code: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    straight_record: MakeMap,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(command, "workers", lambda *_: nullcontext(Dying(straight_record, deadly)))
    monkeypatch.setattr(command, "write_datasheet", lambda *_: None)
    assert command.main(["--maps", "5", "--pairs", "2", "--out", str(tmp_path)]) == code
    made = [record.index for record in load_dataset(tmp_path)]
    assert made == ([0] if code else [0, 1, 2, 3, 4])
    assert ("workers end before they have finished a map" in capsys.readouterr().err) == bool(code)


def killed_once(settings: DatasetSettings, index: int) -> MapRecord:
    """The map, but the first process that is asked for map 1 is killed."""
    mark = Path(os.environ["KILLED_ONCE"])
    if index == 1 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return make_map(settings, index)


@pytest.mark.slow
def test_a_process_that_was_killed_is_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("KILLED_ONCE", str(tmp_path / "mark"))
    monkeypatch.setattr(command, "make_map", killed_once)
    assert command.main(["--maps", "3", "--pairs", "1", "--jobs", "1", "--out", str(tmp_path / "out")]) == 0
    assert len(load_dataset(tmp_path / "out")) == 3
