"""What is read: files that are none end with one line, whatever else bears their name."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from drake_gnnocp import Scenario, ScenarioError, Trajectory
from drake_gnnocp.files import LARGEST_FILE


def pipe(path: Path) -> None:
    """One that nobody writes to: opening it would wait for ever."""
    os.mkfifo(path)


def endless(path: Path) -> None:
    """A device that never ends."""
    path.symlink_to("/dev/zero")


def large(path: Path) -> None:
    """A sparse file: it has a size, but takes no room."""
    path.touch()
    os.truncate(path, int(LARGEST_FILE) + 1)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda path: None, "file: cannot be read: No such file or directory"),
        (Path.mkdir, "file: is a folder"),
        (pipe, "file: is no regular file"),
        (endless, "file: is no regular file"),
        (large, "file: is larger than 100 MB"),
    ],
)
@pytest.mark.parametrize("suffix", [".json", ".csv"])
def test_what_is_no_file_is_refused_without_reading_it(
    make: Callable[[Path], None], message: str, suffix: str, tmp_path: Path
) -> None:
    path = tmp_path / f"name{suffix}"
    make(path)
    with pytest.raises(ScenarioError) as refusal:
        Scenario.load(path)
    assert str(refusal.value) == f"{path}: {message}"
    with pytest.raises(ValueError) as refused:
        Trajectory.load_csv(path)
    assert str(refused.value) == f"{path}: {message}"


def test_a_vertex_count_that_no_number_of_vertices_can_be_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "counts.csv"
    for counts, asked in (("1,1e300", "2e[+]300"), ("2,1e308,1e308", "inf")):
        path.write_text(f"0,0,0,12,0,0,{counts},5,5,6,5,6,6")
        with pytest.raises(ScenarioError, match=f"the counts ask for {asked} numbers, there are 6"):
            Scenario.load(path)


def test_headings_that_are_degrees_are_noticed_but_kept(caplog: pytest.LogCaptureFixture) -> None:
    scenario = Scenario("degrees", np.array([0.0, 0.0, 90.0]), np.array([9.0, 0.0, -6.0 * np.pi]))
    assert scenario.start[2] == 90.0
    (record,) = caplog.records
    assert record.getMessage() == "start: headings are in radians, and 90 is many turns: are these degrees?"
    scenario.translated(1.0, 0.0)
    assert len(caplog.records) == 1
