"""Malformed occupancy maps of all kinds: exit code 2, one line that names file and field, no traceback, no waiting."""

from __future__ import annotations

import io
import os
import signal
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from drake_gnnocp import Scenario, command_line
from drake_gnnocp.command_line import main

BAD_INPUT = 2  # exit code
HUNG = 20  # s, for what takes milliseconds
POSES = ["--start", "-7", "0", "0deg", "--goal", "5", "0.5", "-90deg"]
GOOD = {
    "image": "map.pgm",
    "resolution": "0.5",
    "origin": "[-10.0, -10.0, 0.0]",
    "negate": "0",
    "occupied_thresh": "0.65",
    "free_thresh": "0.196",
}
WORDS = ["", "~", "nan", ".nan", ".inf", "-1", "0", "1e999", "-0.05", "65", "[]", "{}", "[1, 2]", "[[1, 2, 3], 1, 2]"]
WORDS += ["[0, 0, nan]", "[0, 0, east]", "{a: 1}", "text", "../..", "/", "/dev/zero", "map.yaml", "'a\0b'", "a" * 5000]
WORDS += ["!!python/object/apply:os.system ['true']", "!!python/name:os.system", "!own 3", "&a [*a]", "*b", "9" * 5000]
SIGNS = [
    "\t",
    "\0",
    "{",
    "}",
    "[",
    "]",
    ":",
    "- ",
    "!!",
    "&",
    "*",
    "%",
    "\n",
    "'",
    "---\n",
    "...",
    "\ufeff",
    "\x1b",
    "?",
]


def yard(suffix: str) -> bytes:
    """An image of 40 x 40 pixels with a block in it."""
    pixels = np.full((40, 40), 254, dtype=np.uint8)
    pixels[:10, :10], pixels[39, 0] = 0, 205
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "PPM" if suffix == "pgm" else suffix)
    return file.getvalue()


def text_of(keys: dict[str, str]) -> bytes:
    """The YAML text of keys."""
    return "".join(f"{key}: {value}\n" for key, value in keys.items()).encode()


def damaged(data: bytes, rng: np.random.Generator, words: list[str]) -> bytes:
    """Some bytes changed, put in or left out."""
    for _ in range(rng.integers(1, 4)):
        first, last = np.sort(rng.integers(0, len(data) + 1, 2))
        last = min(last, first + rng.integers(0, 12)) if rng.random() < 0.8 else last
        put = rng.choice(words).encode() if words and rng.random() < 0.7 else rng.bytes(int(rng.integers(0, 4)))
        data = data[:first] + put + data[last:]
    return data


def with_strange_values(rng: np.random.Generator) -> None:
    """A map with strange values, or without a key."""
    keys = dict(GOOD) | {"mode": str(rng.choice(["trinary", "scale", "raw"]))}
    for key in rng.choice(list(keys), rng.integers(1, 3)):
        if rng.random() < 0.2:
            del keys[str(key)]
            break
        keys[str(key)] = WORDS[rng.integers(len(WORDS))]
    Path("bad.yaml").write_bytes(text_of(keys))


def with_strange_text(rng: np.random.Generator) -> None:
    """A map whose YAML is damaged."""
    Path("bad.yaml").write_bytes(damaged(text_of(GOOD), rng, SIGNS))


def with_strange_image(rng: np.random.Generator) -> None:
    """A map whose image is damaged."""
    suffix = str(rng.choice(["pgm", "png", "bmp"]))
    data = damaged(yard(suffix), rng, [])
    head = len(data) if rng.random() < 0.5 else int(rng.integers(60))  # most of the damage in the first bytes
    Path(f"odd.{suffix}").write_bytes(damaged(yard(suffix)[:head], rng, []) + yard(suffix)[head:])
    Path("bad.yaml").write_bytes(text_of(GOOD | {"image": f"odd.{suffix}"}))


def with_strange_header(rng: np.random.Generator) -> None:
    """A map whose image says strange things of its size."""
    sizes = ["0", "-1", "1", "40", "41", "65536", "99999999", "9" * 30, "x", "", "1.5", "255", "65535", "70000"]
    words = [str(rng.choice(["P1", "P2", "P3", "P4", "P5", "P6", "Pf", "P7", "P9"])), *rng.choice(sizes, 3)]
    Path("odd.pgm").write_bytes(" ".join(words).encode() + b"\n" + rng.bytes(int(rng.integers(2000))))
    Path("bad.yaml").write_bytes(text_of(GOOD | {"image": "odd.pgm"}))


def with_noise(rng: np.random.Generator) -> None:
    """No map at all."""
    Path("bad.yaml").write_bytes(rng.bytes(int(rng.integers(200))))


KINDS = [with_strange_values, with_strange_text, with_strange_image, with_strange_header, with_noise]


class PlannedError(Exception):
    """The input was good enough to be planned."""


@pytest.fixture(autouse=True)
def nothing_is_planned(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work in a folder with an image; what is not refused is not planned."""

    def planned(scenario: Scenario, *_: object) -> None:
        assert scenario.polygons is not None
        raise PlannedError

    monkeypatch.setattr(command_line, "plan", planned)
    monkeypatch.chdir(tmp_path)
    Path("map.pgm").write_bytes(yard("pgm"))


def refusal(capsys: pytest.CaptureFixture[str], name: str = "bad.yaml", arguments: list[str] = POSES) -> str | None:
    """The line with which a map is refused; None where it is not."""
    signal.alarm(HUNG)  # ends the tests, as a hang would
    try:
        code = main([name, *arguments, "--no-pictures", "--out", "out"])
    except PlannedError:
        return None
    finally:
        signal.alarm(0)
    out, err = capsys.readouterr()
    assert code == BAD_INPUT and out == "", err
    assert err.startswith(f"{name}: ") and err.endswith("\n") and len(err.splitlines()) == 1 and len(err) < 600, err
    return err.removeprefix(f"{name}: ").removesuffix("\n")


@pytest.mark.parametrize("wanted", [60, pytest.param(1000, marks=pytest.mark.slow)])
def test_malformed_maps_are_one_line_each(wanted: int, capsys: pytest.CaptureFixture[str]) -> None:
    rng, refused = np.random.default_rng(wanted), 0
    while refused < wanted:
        KINDS[rng.integers(len(KINDS))](rng)
        refused += refusal(capsys) is not None


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"resolution": "nan"}, "resolution: must be finite"),
        ({"resolution": "-0.05"}, "resolution: must be 0.001 to 1000 m, not -0.05"),
        ({"resolution": "0"}, "resolution: must be"),
        ({"resolution": "[0.05]"}, "resolution: must be a number, not ['0.05']"),
        ({"resolution": "!!python/name:os.system"}, "resolution: must have no tag"),
        ({"origin": "[0, 0]"}, "origin: must be 3 numbers [x, y, yaw], not ['0', '0']"),
        ({"origin": "[0, 0, .nan]"}, "origin[2]: must be a number, not '.nan'"),
        ({"origin": "[0, 0, nan]"}, "origin[2]: must be finite"),
        ({"origin": "[0, [0], 0]"}, "origin: must be a text, a number or a list of numbers"),
        ({"origin": "0"}, "origin: must be 3 numbers"),
        ({"occupied_thresh": "0.1"}, "occupied_thresh: must be above 0, at most 1 and not below free_thresh"),
        ({"occupied_thresh": "65"}, "occupied_thresh: must be"),
        ({"free_thresh": "-1"}, "occupied_thresh: must be"),
        ({"free_thresh": "low"}, "free_thresh: must be a number, not 'low'"),
        ({"mode": "binary"}, "mode: must be trinary, scale or raw, not 'binary'"),
        ({"negate": "2"}, "negate: must be 0 or 1, not '2'"),
        ({"image": "none.pgm"}, "image: none.pgm: cannot be read: No such file or directory"),
        ({"image": "/none/none.pgm"}, "image: /none/none.pgm: cannot be read: No such file or directory"),
        ({"image": "../../none.pgm"}, "image: ../../none.pgm: cannot be read: No such file or directory"),
        ({"image": "."}, "image: .: is a folder"),
        ({"image": "/dev/zero"}, "image: /dev/zero: is no regular file"),
        ({"image": "bad.yaml"}, "image: bad.yaml: is no image"),
        ({"image": ""}, "image: must be the path of a file, not ''"),
        ({"image": "[a]"}, "image: must be the path of a file"),
    ],
)
def test_the_line_names_the_field(changes: dict[str, str], line: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path("bad.yaml").write_bytes(text_of(GOOD | changes))
    refused = refusal(capsys)
    assert refused is not None and refused.startswith(line), refused


@pytest.mark.parametrize("key", GOOD)
def test_a_missing_key_is_named(key: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path("bad.yaml").write_bytes(text_of({name: value for name, value in GOOD.items() if name != key}))
    assert refusal(capsys) == f"{key}: missing"


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (b"", "file: is empty"),
        (b"- a\n- b\n", "file: must have the keys image,"),
        (b"a text\n", "file: must have the keys image,"),
        (b"image:\tmap.pgm\n\tresolution: 1\n", "line 1, column 7: is not YAML: while scanning"),
        (b"image: [map.pgm\n", "line 2, column 1: is not YAML: "),
        (b"image: a\x07b\n", "file: is not YAML: "),
        (b"\xff\xfe\x00", "file: is not UTF-8 text"),
        (text_of(GOOD) + b"image: b.pgm\n", "image: appears twice"),
        (text_of(GOOD) + b"---\n" + text_of(GOOD), "line 7, column 1: is not YAML: expected a single document"),
        (b"a: " + b"[" * 20_000, "file: is nested too deeply"),
        (b"a: " + b"b" * 200_000, "file: is no map, it has more than 100000 characters"),
    ],
)
def test_what_is_no_yaml_of_a_map_is_said(text: bytes, line: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path("bad.yaml").write_bytes(text)
    refused = refusal(capsys)
    assert refused is not None and refused.startswith(line), refused


@pytest.mark.parametrize(
    ("image", "reason"),
    [
        (yard("pgm")[:-100], "is damaged: image file is truncated"),
        (yard("png")[:-30], "is damaged: image file is truncated"),
        (b"P5 0 40 255\n", "is no image (PGM, PNG or BMP), or has no pixels"),
        (b"P2 2 2 255\n1 2 3", "is damaged: not enough image data"),
        (b"P2 2 2 255\n1 2 3 x", "is damaged: invalid literal"),
        (b"P5 9000 9000 255\n", "has 9000 x 9000 pixels, more than 64 million"),
        (b"P5 99999 99999 255\n", "has more than 64 million pixels"),
        (b"Pf 1 1 -1\n\0\0\0\0", "has pixels of the kind F"),
        (b"GIF89a\1\0\1\0\0\0\0;", "is no image"),
        (b"", "is no image"),
    ],
)
def test_what_is_no_image_is_said(image: bytes, reason: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path("odd.pgm").write_bytes(image)
    Path("bad.yaml").write_bytes(text_of(GOOD | {"image": "odd.pgm"}))
    refused = refusal(capsys)
    assert refused is not None and refused.startswith(f"image: odd.pgm: {reason}"), refused


def is_fifo(path: Path) -> None:
    """A pipe that nobody writes to."""
    os.mkfifo(path)


def is_loop(path: Path) -> None:
    """A link to itself."""
    path.symlink_to(path)


@pytest.mark.parametrize("make", [is_fifo, is_loop, Path.mkdir])
@pytest.mark.parametrize("name", ["bad.yaml", "odd.pgm"])
def test_what_is_no_file_is_one_line(
    make: Callable[[Path], None], name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("bad.yaml").write_bytes(text_of(GOOD | {"image": "odd.pgm"}))
    Path(name).unlink(missing_ok=True)
    make(Path(name))
    assert refusal(capsys) is not None


def test_a_map_needs_start_and_goal(capsys: pytest.CaptureFixture[str]) -> None:
    Path("bad.yaml").write_bytes(text_of(GOOD))
    told = "start and goal: missing; where the file has none, give --start X Y THETA --goal X Y THETA"
    assert refusal(capsys, arguments=[]) == told
    assert (refusal(capsys, arguments=POSES[:4]) or "").startswith("goal: missing")
    assert refusal(capsys) is None
