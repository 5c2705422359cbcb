"""Expert iteration: the network's cheaper plans become labels, and nothing else does."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from drake_gnnocp.budget import Budget
from drake_gnnocp.experiments.dataset import improve as module
from drake_gnnocp.experiments.dataset.command import main
from drake_gnnocp.experiments.dataset.generate import (
    DatasetError,
    DatasetSettings,
    check_settings,
    load_dataset,
    load_map,
    make_map,
    settings_of,
)
from drake_gnnocp.experiments.dataset.improve import improved_label
from drake_gnnocp.experiments.dataset.label import KEPT, LEARNED, NO_PATH, SEARCHED, Label
from drake_gnnocp.experiments.dataset.records import save_records
from drake_gnnocp.guesses import Guess
from drake_gnnocp.guesses.straight import straight_line
from drake_gnnocp.learning.checkpoint import save_weights
from drake_gnnocp.learning.configs import NetworkConfig
from drake_gnnocp.learning.trainable import new_network, trained
from drake_gnnocp.scenario import Scenario
from drake_gnnocp.verification import verify

BLOCK = np.array([[4.0, 3.0], [8.0, 3.0], [8.0, 5.0], [4.0, 5.0]])
TASK = Scenario("beside a block", np.array([5.0, 5.0, 0.0]), np.array([19.0, 6.0, 0.0]), (BLOCK + 5.0,))


@dataclass(frozen=True)
class StraightHypotheses:
    """A network that knows straight lines only."""

    knots: int
    weights: Path | None = None
    most: int | None = None

    def check_available(self) -> None:
        """It is there."""

    def guesses(self, scenario: Scenario, budget: Budget) -> Iterator[Guess]:
        """The line."""
        yield Guess("gnn", straight_line(scenario, self.knots), is_timed=True)


@pytest.fixture(autouse=True)
def straight_hypotheses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "Learned", StraightHypotheses)


def solved() -> Label:
    found = improved_label(TASK, Label(NO_PATH))
    assert found.outcome == KEPT
    return found


def test_a_task_without_a_label_gets_one_that_is_verified() -> None:
    found = solved()
    assert found.source == LEARNED and found.trajectory is not None
    assert verify(TASK, found.trajectory).verified


def test_a_cheaper_plan_of_the_same_duration_replaces_the_label() -> None:
    label = replace(solved(), source=SEARCHED)
    assert label.trajectory is not None
    found = improved_label(TASK, replace(label, cost=1.5 * label.cost))
    assert found.source == LEARNED and found.trajectory is not None
    assert found.trajectory.duration == pytest.approx(label.trajectory.duration)
    assert found.cost < 1.01 * label.cost


def test_a_label_that_is_as_cheap_stays() -> None:
    label = replace(solved(), source=SEARCHED)
    assert improved_label(TASK, label) is label


def test_a_map_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="map 3 of 800 is not there"):
        load_map(tmp_path, DatasetSettings(maps=800), 3)


def test_a_whole_dataset_is_improved_with_its_own_settings(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "before").mkdir()
    before, after = tmp_path / "before", tmp_path / "after"
    command = ["--improve", str(before), "--out", str(after), "--jobs", "1"]
    assert main(command) == 2 and "before/settings.json" in capsys.readouterr().err
    settings = DatasetSettings(seed=7, maps=1, pairs=1)
    check_settings(before, settings)
    (before / "shards").mkdir()
    save_records(before / "shards" / "shard_000.npz", [make_map(settings, 0)])
    assert main(command) == 0
    assert settings_of(after) == settings_of(before) == settings
    assert [record.index for record in load_dataset(after)] == [0]
    other = tmp_path / "other.safetensors"
    save_weights(other, trained(new_network(NetworkConfig(width=16, channels=16))), {})
    capsys.readouterr()
    assert main([*command, "--weights", str(other)]) == 2  # nothing is mixed
    assert "was made with" in capsys.readouterr().err
    assert main(["--maps", "1", "--pairs", "1", "--seed", "7", "--jobs", "1", "--out", str(after)]) == 2


def test_a_cluster_that_is_not_there_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert main(["--dask", "tcp://nowhere:1", "--out", str(tmp_path)]) == 2
    assert capsys.readouterr().err.startswith("--dask: tcp://nowhere:1: ")


def test_weights_are_for_improving(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--weights", "best.safetensors", "--out", str(tmp_path / "new")]) == 2
    assert capsys.readouterr().err == "--weights: only with --improve\n"
    assert not (tmp_path / "new").exists()


def test_a_dataset_is_not_improved_in_place(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--improve", str(tmp_path), "--out", str(tmp_path)]) == 2
    assert capsys.readouterr().err.startswith("--improve: ")
