"""Occupancy maps: what the files of map_server and nav2_map_server say, with values computed by hand."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from drake_gnnocp.maps.occupancy_map import read_map

YAML = "image: {}\nresolution: 0.05\norigin: [-10.0, 5.0, 0.0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
GRAYS, HIGH, COLOURS, GRAY_ALPHA, COLOURS_ALPHA = (8, 0), (16, 0), (8, 2), (8, 4), (8, 6)  # PNG: bits, kind of colour


def png(pixels: np.ndarray, kind: tuple[int, int]) -> bytes:
    """A PNG file of pixels (H, W) or (H, W, C); 16 bits where it says so."""
    bits, colour = kind
    rows = np.asarray(pixels, dtype=f">u{bits // 8}")
    lines = b"".join(b"\0" + row.tobytes() for row in rows)

    def chunk(name: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    header = struct.pack(">IIBBBBB", rows.shape[1], rows.shape[0], bits, colour, 0, 0, 0)
    body = chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(lines)) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + body


def states_of(folder: Path, image: bytes, text: str = YAML) -> str:
    """The cells of a map, row by row from the lowest: # occupied, . free, ? unknown."""
    (folder / "map.img").write_bytes(image)
    (folder / "map.yaml").write_text(text.format("map.img"))
    strict, lenient = (read_map(folder / "map.yaml", unknown).occupied for unknown in ("occupied", "free"))
    return "/".join(
        "".join("#" if sure else "?" if maybe else "." for maybe, sure in zip(*rows, strict=True))
        for rows in zip(strict, lenient, strict=True)
    )


@pytest.mark.parametrize(
    ("image", "expected"),
    [
        (b"P5 2 3 255\n\0\xfe\xfe\xfe\xfe\0", ".#/../#."),  # the first row is the uppermost
        (b"P2\n# drawn\n3 2\n15\n0 15 15\n15 15 0\n", "..#/#.."),
        (b"P5 3 1 255\n\x59\x5a\xcd", "#??"),  # (255 - 89) / 255 = 0.651, (255 - 90) / 255 = 0.647, 0.1961
        (b"P5 2 1 255\n\xcc\xce", "?."),  # 0.2, 0.1922
        (b"P5 2 1 65535\n\x59\x99\x59\x9a", "#?"),  # 65535 (1 - 0.65) = 22937.25 = 0x5999 + 0.25
        (png(np.array([[0x5999, 0x599A]]), HIGH), "#?"),
        (png(np.array([[89, 90, 205, 206]]), GRAYS), "#??."),
        (png(np.array([[[0, 0, 255], [0, 0, 0], [255, 255, 107], [255, 255, 106]]]), COLOURS), "##.."),
        (png(np.array([[[0, 0, 0], [255, 255, 105], [255, 255, 106]]]), COLOURS), "#?."),  # (765 - 615) / 765 = 0.1961
    ],
)
def test_pixels_are_cells(image: bytes, expected: str, tmp_path: Path) -> None:
    assert states_of(tmp_path, image) == expected


def test_the_opacity_is_one_more_colour_in_trinary_maps(tmp_path: Path) -> None:
    # p of black is 1 - (0 + 255) / 4 / 255 = 0.75, of clear white 0.25, of clear black 1, of gray 205 it is 0.147
    pixels = np.array([[[0, 255], [255, 0], [0, 0], [205, 255], [255, 255]]])
    assert states_of(tmp_path, png(pixels, GRAY_ALPHA)) == "#?#.."
    colours = np.concatenate([pixels[..., :1].repeat(3, axis=2), pixels[..., 1:]], axis=2)
    assert states_of(tmp_path, png(colours, COLOURS_ALPHA)) == "#?#.."


def test_negated_maps_are_occupied_where_white(tmp_path: Path) -> None:
    image = b"P5 3 1 255\n\0\x80\xff"
    for word in ("1", "true", "yes"):
        assert states_of(tmp_path, image, YAML.replace("negate: 0", f"negate: {word}")) == ".?#"
    for word in ("0", "false"):
        assert states_of(tmp_path, image, YAML.replace("negate: 0", f"negate: {word}")) == "#?."


def test_scale_maps_have_cells_in_between_and_unknown_where_they_are_not_opaque(tmp_path: Path) -> None:
    text = YAML + "mode: scale\n"
    # 100 (p - 0.196) / 0.454: 130 gives 64.8, rounded 65; 131 gives 63.9
    assert states_of(tmp_path, b"P5 4 1 255\n\0\x82\x83\xff", text) == "##.."
    pixels = np.array([[[0, 255], [255, 255], [0, 254], [255, 0]]])
    assert states_of(tmp_path, png(pixels, GRAY_ALPHA), text) == "#.??"


def test_raw_maps_hold_per_cent(tmp_path: Path) -> None:
    text = YAML + "mode: raw\n"
    image = bytes([0, 64, 65, 100, 101, 254, 255])
    assert states_of(tmp_path, b"P5 7 1 255\n" + image, text) == "..##???"
    assert states_of(tmp_path, b"P5 7 1 255\n" + image, text.replace("0.65", "0.55")) == ".###???"
    assert states_of(tmp_path, b"P5 7 1 255\n" + image, text.replace("negate: 0", "negate: 1")) == "..##???"


def test_palettes_and_two_colours_are_read(tmp_path: Path) -> None:
    for mode in ("P", "1"):
        Image.fromarray(np.array([[0, 255], [255, 255]], dtype=np.uint8)).convert(mode).save(tmp_path / "map.png")
        assert states_of(tmp_path, (tmp_path / "map.png").read_bytes()) == "../#."


def test_numbers_of_all_spellings_and_other_keys_are_read(tmp_path: Path) -> None:
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "a b.pgm").write_bytes(b"P5 2 1 255\n\0\xff")
    (tmp_path / "m.yaml").write_text(
        "# a map\nimage: 'maps/a b.pgm'\nresolution: 5e-2\norigin:\n- -1\n- 2.5\n- .5\nnegate: 0\nMODE: x\n"
        "occupied_thresh: '0.65'\nfree_thresh: .196\nframe_id: map\nlayers: [{a: 1}]\n"
    )
    grid = read_map(tmp_path / "m.yaml")
    assert (grid.resolution, grid.origin.tolist(), grid.occupied.tolist()) == (0.05, [-1, 2.5, 0.5], [[True, False]])
