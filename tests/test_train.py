"""Training: resumable, with curves and the best weights; bad input is one line."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch
from torch_scenes import torch_scene

from drake_gnnocp.experiments.dataset.generate import DatasetSettings, MakeMap, check_settings
from drake_gnnocp.experiments.dataset.records import save_records
from drake_gnnocp.experiments.training import quality
from drake_gnnocp.experiments.training.command import main, override
from drake_gnnocp.experiments.training.job import Job, beginning
from drake_gnnocp.experiments.training.samples import Samples
from drake_gnnocp.experiments.training.training import DEFAULT_TRAINING, PAPER_TRAINING, Progress, learning_rate, train
from drake_gnnocp.learning.checkpoint import load_weights, save_weights
from drake_gnnocp.learning.configs import NetworkConfig, PaperConfig
from drake_gnnocp.learning.modules import TrajectoryNetwork
from drake_gnnocp.learning.paper_network import PaperNetwork
from drake_gnnocp.learning.ranking import Ranking
from drake_gnnocp.learning.trainable import Network, trained
from drake_gnnocp.scenario import Scenario

SMALL = replace(PAPER_TRAINING, epochs=3, warm_up=1, batch=4)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory, straight_record: MakeMap, small_dataset: DatasetSettings) -> Path:
    """Ten maps: eight to train on, one for validation, one for the test."""
    folder = tmp_path_factory.mktemp("data")
    (folder / "parts").mkdir()
    check_settings(folder, small_dataset)
    save_records(folder / "parts" / "map_00000.npz", [straight_record(small_dataset, index) for index in range(10)])
    return folder


@pytest.fixture(scope="module")
def samples(straight_record: MakeMap, small_dataset: DatasetSettings) -> Samples:
    return Samples.of([straight_record(small_dataset, index) for index in range(6)], PaperConfig().points)


def small_network() -> Network:
    torch.manual_seed(0)
    return PaperNetwork(PaperConfig(hidden=16))


def test_the_command_trains_keeps_the_best_weights_and_goes_on_only_where_nothing_changed(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["--config", "paper", "--data", str(data), "--out", str(tmp_path), "--epochs", "2", "--threads", "1"]
    assert main([*command, "--check-every", "2", "--check-tasks", "1"]) == 0
    rows = list(csv.DictReader((tmp_path / "curves.csv").read_text(encoding="utf-8").splitlines()))
    assert [row["epoch"] for row in rows] == ["1", "2"]
    assert rows[0]["plan_badness"] == "" and float(rows[1]["plan_badness"]) > 0
    assert (tmp_path / "curves.png").stat().st_size > 1000
    _, about = load_weights(tmp_path / "best.safetensors")
    assert about["epoch"] == 2 and about["maps"] == 8
    assert main([*command, "--check-every", "2", "--check-tasks", "1"]) == 0  # nothing is left to do
    capsys.readouterr()
    for other, named in ((["--epochs", "3"], "epochs 2"), (["--share", "0.5"], "trajectories")):
        assert main([*command, *other]) == 2
        assert named in capsys.readouterr().err
    weights = str(tmp_path / "best.safetensors")
    assert main([*command, "--from", weights]) == 2 and "from" in capsys.readouterr().err
    (tmp_path / "last.pt").write_bytes(b"nothing")
    assert main(command) == 2 and "last.pt: not a training" in capsys.readouterr().err
    (tmp_path / "last.pt").unlink()
    network, _ = load_weights(tmp_path / "best.safetensors")
    network = replace(network, ranking=Ranking(score=0.5, duration=-0.1))
    save_weights(tmp_path / "start.safetensors", network, {})
    assert main([*command, "--from", str(tmp_path / "start.safetensors"), "--epochs", "1", "--check-tasks", "1"]) == 0
    assert load_weights(tmp_path / "best.safetensors")[0].ranking == network.ranking  # until it is fitted anew


def test_a_network_with_more_refinements_begins_as_the_one_before(tmp_path: Path) -> None:
    torch.manual_seed(0)
    small = NetworkConfig(width=16, channels=16, encoder_layers=1, hypotheses=2, refinements=1)
    before = TrajectoryNetwork(small).eval()
    for parameter in before.refiners.parameters():  # some are zero at first
        torch.nn.init.normal_(parameter, std=0.1)
    save_weights(tmp_path / "start.safetensors", trained(before), {})
    begun = beginning(
        Job(replace(small, refinements=3), DEFAULT_TRAINING, tmp_path, tmp_path / "start.safetensors")
    ).eval()
    scene = torch_scene(Scenario.load("map_a"))
    with torch.inference_mode():
        torch.testing.assert_close(begun(scene).states, before(scene).states)
    with pytest.raises(ValueError, match="other sizes"):
        beginning(Job(replace(small, refinements=0), DEFAULT_TRAINING, tmp_path, tmp_path / "start.safetensors"))


def test_a_training_that_was_stopped_ends_where_an_unbroken_one_does(samples: Samples, tmp_path: Path) -> None:
    for name in ("whole", "broken"):
        (tmp_path / name).mkdir()
    whole, broken = small_network(), small_network()
    train(whole, samples, samples, SMALL, tmp_path / "whole", lambda *_: {})

    def stop(_network: Network, progress: Progress) -> dict[str, float]:
        if progress.epoch == 2:
            raise KeyboardInterrupt
        return {}

    with pytest.raises(KeyboardInterrupt):
        train(broken, samples, samples, SMALL, tmp_path / "broken", stop)
    again = small_network()
    progress = train(again, samples, samples, SMALL, tmp_path / "broken", lambda *_: {})
    assert progress.epoch == 3 and len(progress.rows) == 3
    for one, other in zip(whole.parameters(), again.parameters(), strict=True):
        torch.testing.assert_close(one, other)


def test_the_learning_rate_warms_up_and_falls_along_a_cosine() -> None:
    options = replace(SMALL, epochs=21, warm_up=1, learning_rate=1.0, cosine=True)
    rates = [learning_rate(options, epoch) for epoch in (0.5, 1.0, 11.0, 21.0)]
    assert rates == pytest.approx([0.5, 1.0, 0.5, 0.01])


@pytest.mark.parametrize(
    "arguments",
    [
        ["--data", "nowhere"],
        ["--share", "0"],
        ["--epochs", "0"],
        ["--config", "other"],
        ["--device", "nowhere"],
        ["--device", "meta"],
        ["--from", "nowhere.safetensors"],
        ["--rank", "nowhere.safetensors"],
        ["--set", "batch=0"],
        ["--set", "hypotheses=0"],
    ],
)
def test_bad_input_is_one_line(
    arguments: list[str], data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        code = main(["--data", str(data), "--out", str(tmp_path), *arguments])
    except SystemExit as stop:
        code = int(stop.code or 0)
    error = capsys.readouterr().err
    assert code == 2 and error.count("\n") == 1
    assert arguments[-1].partition("=")[0] in error or arguments[0] in error


def test_a_dataset_without_validation_maps_is_refused(
    straight_record: MakeMap, small_dataset: DatasetSettings, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "parts").mkdir()
    save_records(tmp_path / "parts" / "map_00000.npz", [straight_record(small_dataset, 0)])
    assert main(["--data", str(tmp_path), "--out", str(tmp_path / "out")]) == 2
    assert "needs trajectories" in capsys.readouterr().err


def test_settings_change_sizes_losses_and_options() -> None:
    settings = {"hypotheses": "1", "kinematics": "0", "cosine": "0", "unknown": "1"}
    assert override(NetworkConfig(), settings).hypotheses == 1
    options = override(DEFAULT_TRAINING, settings)
    assert options.losses.kinematics == 0.0 and not options.cosine
    assert settings == {"unknown": "1"}


@pytest.mark.parametrize("setting", ["points", "points=many", "wings=2"])
def test_a_setting_that_is_none_is_refused(setting: str, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    try:
        code = main(["--set", setting, "--out", str(tmp_path)])
    except SystemExit as exit:
        code = int(str(exit.code))
    error = capsys.readouterr().err
    assert code == 2 and "--set" in error and error.count("\n") == 1


def test_trainings_are_compared_by_their_last_check(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["--compare", str(tmp_path)]) == 2
    assert capsys.readouterr().err.startswith("--compare: ")
    columns = "epoch,validation_position,plan_verified,plan_first,plan_iterations,plan_badness"
    for name, share in (("base", 0.9), ("other", 0.8)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "curves.csv").write_text(f"{columns}\n1,2,0.5,0.5,9,40\n2,1.5,{share},0.7,3,20\n3,1,,,,\n")
    assert main(["--compare", str(tmp_path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[2:] == ["| base | 2 | 1.5 | 90% | 70% | 3 | 20 |", "| other | 2 | 1.5 | 80% | 70% | 3 | 20 |"]


def test_planning_quality_counts_every_verified_plan_and_no_failure_for_less(monkeypatch: pytest.MonkeyPatch) -> None:
    def plan_of(verified: bool, iterations: int) -> SimpleNamespace:
        return SimpleNamespace(first_iterations=iterations, sqp_steps=3, verified=verified)

    plans = iter([(0, plan_of(True, 1)), (11, plan_of(True, 150)), (0, plan_of(False, 5)), (12, None)])
    monkeypatch.setattr(quality, "_planned", lambda *_: next(plans))
    found = quality.planning_quality(trained(small_network()), [Scenario.load("map_a")] * 4)
    assert found["plan_verified"] == 0.5 and found["plan_first"] == 0.25 and found["plan_iterations"] == 5
    assert found["plan_badness"] == pytest.approx((4 + 3 * quality.FAILURE) / 4)
