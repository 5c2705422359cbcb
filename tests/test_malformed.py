"""Malformed scenario files of all kinds: exit code 2, one line, no traceback, and no waiting."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from malformed_drawings import damaged_dxf, damaged_geojson

from drake_gnnocp import Scenario, command_line
from drake_gnnocp.command_line import main

BAD_INPUT = 2  # exit code
HUNG = 20  # s, for what takes milliseconds
RING = [[8, 8], [11, 8], [11, 10], [9, 9], [8, 11]]
GOOD: dict[str, Any] = {
    "name": "task",
    "start": [0, 0, 0],
    "goal": [14, 0, 0.5],
    "obstacles": [RING, [[5, -8], [6, -8], [6, -5]]],
    "bounds": [-20, 40, -20, 20],
    "vehicle": {"width": 1.8, "v_max": 2.0},
}
TPCAP = "0,0,0,14,0,0.5,2,4,3,8,8,11,8,11,10,9,11,5,-8,6,-8,6,-5"
STRANGE: list[Any] = [
    *(float("nan"), float("inf"), -1e308, 1e308, 1e13, -0.0, 1e-320, 10**400, -1, 2.5, True, None),
    *("", "0", "\x00", "\ud800", "ä" * 300, "../..", "$\\frac{", [], {}, [[]], [None], [[[[0]]]], {"": 0}, [0] * 50),
]
WORDS = [
    "NaN",
    "Infinity",
    "null",
    "[",
    "]",
    "{",
    "}",
    ",",
    '"',
    "1e999",
    "\\u0000",
    "-",
    "//",
    "\ufeff",
    "\n",
    "9" * 400,
]


def is_fifo(path: Path) -> None:
    """A pipe that nobody writes to."""
    os.mkfifo(path)


def is_device(path: Path) -> None:
    """A device that never ends."""
    path.symlink_to("/dev/zero")


def is_loop(path: Path) -> None:
    """A link to itself."""
    path.symlink_to(path)


def with_strange_value(rng: np.random.Generator) -> bytes:
    """A scenario in which some value, however deep, is another one, is left out, or comes twice."""
    data = json.loads(json.dumps(GOOD))
    for _ in range(rng.integers(1, 4)):
        holder: Any = data
        while True:
            keys = list(holder) if isinstance(holder, dict) else list(range(len(holder)))
            if not keys:
                break
            key = keys[rng.integers(len(keys))]
            if isinstance(holder[key], dict | list) and rng.random() < 0.7:
                holder = holder[key]
                continue
            if rng.random() < 0.2:
                del holder[key]
            elif isinstance(holder, dict) and rng.random() < 0.2:
                holder[f"{key}{key}"] = holder[key]
            else:
                holder[key] = STRANGE[rng.integers(len(STRANGE))]
            break
    return json.dumps(data).encode("utf-8", "surrogatepass")


def with_strange_ring(rng: np.random.Generator) -> bytes:
    """A scenario with an obstacle that is thin, crosses or repeats itself, or is in the way, at times far away."""
    n = int(rng.integers(3, 30))
    ring = np.round(rng.uniform(-6, 6, (n, 2)) * 10.0 ** rng.integers(-2, 2), int(rng.integers(0, 12)))
    ring = np.concatenate([ring, ring[rng.integers(n, size=rng.integers(0, n))]]) + rng.choice([0, 5, 1e6, 1e11])
    ring += rng.choice([0, 1e-12, 1e-9, 1e-8, 1e-7]) * rng.normal(size=ring.shape)
    return json.dumps(GOOD | {"obstacles": [RING, ring.tolist()]}).encode()


def with_other_bytes(text: str, words: list[str]) -> Callable[[np.random.Generator], bytes]:
    """A text with some bytes changed, put in or left out."""

    def damaged(rng: np.random.Generator) -> bytes:
        data = text.encode()
        for _ in range(rng.integers(1, 5)):
            first, last = np.sort(rng.integers(0, len(data) + 1, 2))
            last = min(last, first + rng.integers(0, 12)) if rng.random() < 0.8 else last
            put = words[rng.integers(len(words))].encode() if rng.random() < 0.7 else rng.bytes(int(rng.integers(0, 4)))
            data = data[:first] + put + data[last:]
        return data

    return damaged


CELLS = ["nan", "inf", "1e308", "-1", "0", "1e300", "", ",,", "x", "\n", ";", "1e-320", "3.5", "999999999"]
KINDS: list[tuple[str, Callable[[np.random.Generator], bytes]]] = [
    (".json", with_strange_value),
    (".json", with_strange_ring),
    (".json", with_other_bytes(json.dumps(GOOD), WORDS)),
    (".csv", with_other_bytes(TPCAP, CELLS)),
    (".json", lambda rng: rng.bytes(int(rng.integers(0, 200)))),
    (".csv", lambda rng: ",".join(rng.choice([*CELLS, "1", "2", "7.5"], rng.integers(0, 40))).encode()),
]


class PlannedError(Exception):
    """The input was good enough to be planned."""


@pytest.fixture(autouse=True)
def nothing_is_planned(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work in an empty folder; what is not refused is moved and cut into convex parts, as a plan would."""

    def moved(scenario: Scenario, *_: object) -> None:
        assert scenario.translated(*-scenario.start[:2]).convex_obstacles is not None
        raise PlannedError

    monkeypatch.setattr(command_line, "plan", moved)
    monkeypatch.chdir(tmp_path)


def is_refused(name: str, capsys: pytest.CaptureFixture[str]) -> bool:
    """Whether a file is refused, with one line that names it."""
    signal.alarm(HUNG)  # ends the tests, as a hang would
    try:
        code = main([name, "--no-pictures", "--out", "out"])
    except PlannedError:
        return False
    finally:
        signal.alarm(0)
    out, err = capsys.readouterr()
    assert code == BAD_INPUT and out == "", err
    assert err.startswith(f"{name}: ") and err.endswith("\n") and len(err.splitlines()) == 1, err
    return True


@pytest.mark.parametrize("wanted", [200, pytest.param(10_000, marks=pytest.mark.slow)])
def test_malformed_files_are_one_line_each(wanted: int, capsys: pytest.CaptureFixture[str]) -> None:
    rng, refused = np.random.default_rng(wanted), 0
    while refused < wanted:
        suffix, make = KINDS[rng.integers(len(KINDS))]
        path = Path(f"bad{suffix}")
        path.write_bytes(make(rng))
        refused += is_refused(path.name, capsys)
    assert {path.name for path in Path().iterdir()} <= {"bad.json", "bad.csv", "out"}


@pytest.mark.parametrize(("suffix", "make"), [(".dxf", damaged_dxf), (".geojson", damaged_geojson)])
@pytest.mark.parametrize("wanted", [150, pytest.param(5_000, marks=pytest.mark.slow)])
def test_malformed_drawings_are_one_line_each(
    wanted: int, suffix: str, make: Callable[[np.random.Generator], bytes], capsys: pytest.CaptureFixture[str]
) -> None:
    rng, refused = np.random.default_rng(wanted), 0
    path = Path(f"bad{suffix}")
    while refused < wanted:
        path.write_bytes(make(rng))
        refused += is_refused(path.name, capsys)


@pytest.mark.parametrize("make", [is_fifo, is_device, is_loop, Path.mkdir])
@pytest.mark.parametrize("suffix", [".json", ".csv", ".geojson", ".dxf"])
def test_what_is_no_file_is_one_line(
    make: Callable[[Path], None], suffix: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = Path(f"bad{suffix}")
    make(path)
    assert is_refused(path.name, capsys)
