"""Maps of ROS `map_server` and `nav2_map_server`: a YAML file that names an image, whose pixels are cells.

The first row of pixels is the row of cells with the largest y. A pixel's shade s is the mean of its colours, 0 black to
1 white, and p = 1 - s (with `negate` p = s) says how occupied it is. The cell, -1 (unknown) or 0 to 100 per cent, is

    trinary   100 where p > occupied_thresh, 0 where p < free_thresh, else -1; the opacity counts as one more colour
    scale     -1 where the pixel is not opaque, 100 and 0 as above, else 100 (p - free) / (occupied - free), rounded
    raw       255 s, rounded, where this is at most 100, else -1; neither `negate` nor thresholds are looked at

as nav2_map_server publishes it (map_server differs: it negates raw maps too, and rounds down where nav2 rounds). Cells
of at least 100 occupied_thresh per cent are occupied. Other keys of the YAML are ignored, as there. Images are PGM and
PNG (8 or 16 bits; of colours with 16 bits the upper 8 are read), PPM, PBM or BMP.
"""

from __future__ import annotations

import math
import struct
import warnings
import zlib
from dataclasses import dataclass
from pathlib import Path
from reprlib import repr as shown

import numpy as np
import yaml
from PIL import Image, UnidentifiedImageError

from drake_gnnocp.files import first_line, read_text
from drake_gnnocp.maps.occupancy_grid import (
    FARTHEST,
    FREE,
    MEANINGS,
    MOST_CELLS,
    OCCUPIED,
    UNKNOWN,
    Grid,
    grid_of_cells,
)

MODES = ("trinary", "scale", "raw")
NEGATE = dict.fromkeys(("0", "false", "no", "off", "n"), False) | dict.fromkeys(("1", "true", "yes", "on", "y"), True)
REQUIRED_KEYS = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh")
KEYS = (*REQUIRED_KEYS, "mode")
LONGEST_TEXT = 100_000  # characters of YAML, of which a map has ten lines
LARGEST_IMAGE = 1e9  # bytes
FORMATS = ("PPM", "PNG", "BMP")  # as Pillow calls them, PPM includes PGM
BAD_IMAGE = (OSError, SyntaxError, ValueError, EOFError, IndexError, OverflowError, struct.error, zlib.error)
WITH_ALPHA = {"L": "LA", "RGB": "RGBA", "P": "RGBA"}  # where one colour of an image stands for transparency
PLAIN = {"1": "L", "P": "RGB"}


@dataclass(frozen=True)
class Description:
    """What the YAML file of a map says."""

    image: Path
    resolution: float  # m, length of a pixel's side
    origin: tuple[float, ...]  # x, y, yaw of the lower left corner of the lower left pixel [m, m, rad]
    negate: bool  # white is occupied
    occupied_thresh: float  # share of 1, above it a pixel is occupied
    free_thresh: float  # share of 1, below it a pixel is free
    mode: str  # one of MODES


def read_map(path: Path, unknown: str = MEANINGS[0]) -> Grid:
    """Read a map.

    Args:
        path: of the YAML file.
        unknown: what unknown cells are taken for: "occupied" or "free".

    Raises:
        ValueError: a file is missing or unreadable, or a value is illegal; the message is one line and names the field.
    """
    described = _description(path)
    cells = _cells(described, *_shades(described))
    return grid_of_cells(
        cells[::-1],
        described.resolution,
        described.origin,
        unknown=unknown,
        occupied_thresh=described.occupied_thresh,
    )


def _description(path: Path) -> Description:
    values = _values(read_text(path))
    for key in REQUIRED_KEYS:
        if key not in values:
            raise ValueError(f"{key}: missing")
    origin = values["origin"]
    if not isinstance(origin, list) or len(origin) != 3:
        raise ValueError(f"origin: must be 3 numbers [x, y, yaw], not {shown(origin)}")
    occupied, free = (_number(key, values[key]) for key in ("occupied_thresh", "free_thresh"))
    if not (0 < occupied <= 1 and 0 <= free <= occupied):
        raise ValueError(
            "occupied_thresh: must be above 0, at most 1 and not below free_thresh, "
            f"not {occupied:g} with a free_thresh of {free:g}"
        )
    image = values["image"]
    if not isinstance(image, str) or not image or not image.isprintable():
        raise ValueError(f"image: must be the path of a file, not {shown(image)}")
    negate, mode = str(values["negate"]).lower(), str(values.get("mode", MODES[0])).lower()
    if negate not in NEGATE:
        raise ValueError(f"negate: must be 0 or 1, not {shown(values['negate'])}")
    if mode not in MODES:
        raise ValueError(f"mode: must be {', '.join(MODES[:-1])} or {MODES[-1]}, not {shown(values['mode'])}")
    return Description(
        image=path.parent / image,
        resolution=_number("resolution", values["resolution"]),
        origin=tuple(_number(f"origin[{i}]", value) for i, value in enumerate(origin)),
        negate=NEGATE[negate],
        occupied_thresh=occupied,
        free_thresh=free,
        mode=mode,
    )


def _values(text: str) -> dict[str, str | list[str]]:
    """The texts, and lists of texts, that a YAML text gives the KEYS; what is a number is up to the reader."""
    if len(text) > LONGEST_TEXT:
        raise ValueError(f"file: is no map, it has more than {LONGEST_TEXT} characters")
    try:
        root = yaml.compose(text, Loader=yaml.BaseLoader)  # composed, not constructed: tags make nothing
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        what = ", ".join(part for part in (error.context, error.problem) if part)
        raise ValueError(f"{where}is not YAML: {what}") from None
    except yaml.YAMLError as error:  # characters that YAML does not allow
        raise ValueError(f"file: is not YAML: {first_line(error)}") from None
    except RecursionError:
        raise ValueError("file: is nested too deeply") from None
    if not isinstance(root, yaml.MappingNode):
        raise ValueError(f"file: must have the keys {', '.join(KEYS)}, and is no mapping of keys")
    values: dict[str, str | list[str]] = {}
    for key_node, node in root.value:
        key = key_node.value if isinstance(key_node, yaml.ScalarNode) else ""
        if key in values:
            raise ValueError(f"{key}: appears twice")
        if key in KEYS:
            values[key] = _value(key, node)
    return values


def _value(key: str, node: yaml.Node) -> str | list[str]:
    if not node.tag.startswith("tag:yaml.org,2002:") or ":python" in node.tag:
        raise ValueError(f"{key}: must have no tag, unlike {shown(node.tag)}")
    if isinstance(node, yaml.ScalarNode):
        return str(node.value)
    if isinstance(node, yaml.SequenceNode) and all(isinstance(item, yaml.ScalarNode) for item in node.value):
        return [item.value for item in node.value]
    raise ValueError(f"{key}: must be a text, a number or a list of numbers")


def _number(key: str, value: str | list[str]) -> float:
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise ValueError(f"{key}: must be a number, not {shown(value)}") from None
    if not abs(number) <= FARTHEST:  # NaN as well
        raise ValueError(f"{key}: must be finite and at most {FARTHEST:g}, not {shown(value)}")
    return number


def _shades(described: Description) -> tuple[np.ndarray, int, np.ndarray | None]:
    """The shades of a map's pixels as sums of their colours (H, W), the sum of white, and which are not opaque."""
    pixels = _pixels(described.image)
    white = 255 if pixels.dtype == np.uint8 else 65535
    if pixels.ndim == 2:
        return pixels, white, None
    colours, alpha = (pixels[..., :-1], pixels[..., -1]) if pixels.shape[2] in (2, 4) else (pixels, None)
    # a gray with transparency is three equal colours
    total = np.sum(colours, axis=2, dtype=np.uint32) * (3 // colours.shape[2])
    if alpha is None:
        return total, 3 * white, None
    if described.mode == "trinary":
        return total + alpha, 4 * white, None
    return total, 3 * white, alpha != white


def _cells(described: Description, shades: np.ndarray, white: int, is_clear: np.ndarray | None) -> np.ndarray:
    """The cells of a map's pixels, -1 or 0 to 100: (H, W), the rows as in the image."""
    s = np.arange(white + 1) / white
    p = s if described.negate else 1 - s
    occupied, free = described.occupied_thresh, described.free_thresh
    if described.mode == "raw":
        percent = np.floor(255 * s + 0.5)
        return np.where(percent <= OCCUPIED, percent, UNKNOWN).astype(np.int8)[shades]
    between = np.full(white + 1, float(UNKNOWN))
    if described.mode == "scale":
        between = np.rint(OCCUPIED * (p - free) / max(occupied - free, math.ulp(1.0)))
    cells = np.where(p > occupied, OCCUPIED, np.where(p < free, FREE, between)).astype(np.int8)[shades]
    if described.mode == "scale" and is_clear is not None:
        cells[is_clear] = UNKNOWN
    return cells


def _pixels(path: Path) -> np.ndarray:
    """The pixels of an image: (H, W), or (H, W, C) with 2 to 4 channels, of 8 bits or 16."""
    try:
        _check_file(path)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about sizes, which are checked here, and about what a PNG has besides
            with Image.open(path, formats=FORMATS) as image:
                width, height = image.size
                if width * height > MOST_CELLS:
                    raise _ImageError(f"has {width} x {height} pixels, more than {MOST_CELLS / 1e6:g} million")
                return _channels(image)
    except _ImageError as error:
        reason = str(error)
    except Image.DecompressionBombError:
        reason = f"has more than {MOST_CELLS / 1e6:g} million pixels"
    except UnidentifiedImageError:
        reason = "is no image (PGM, PNG or BMP), or has no pixels"
    except BAD_IMAGE as error:
        in_system = isinstance(error, OSError) and error.strerror
        reason = f"cannot be read: {in_system}" if in_system else f"is damaged: {first_line(error)}"
    raise ValueError(f"image: {path}: {reason}")


class _ImageError(ValueError):
    """What is wrong with an image, said in words of this module."""


def _check_file(path: Path) -> None:
    if path.is_dir():
        raise _ImageError("is a folder")
    if path.exists() and not path.is_file():  # reading a pipe or a device may never end
        raise _ImageError("is no regular file")
    if path.stat().st_size > LARGEST_IMAGE:
        raise _ImageError(f"is larger than {LARGEST_IMAGE / 1e6:g} MB")


def _channels(image: Image.Image) -> np.ndarray:
    if "transparency" in image.info and image.mode in WITH_ALPHA:
        return np.asarray(image.convert(WITH_ALPHA[image.mode]))
    if image.mode in PLAIN:
        return np.asarray(image.convert(PLAIN[image.mode]))
    if image.mode in ("L", "LA", "RGB", "RGBA"):
        return np.asarray(image)
    if image.mode in ("I", "I;16", "I;16B"):
        return np.asarray(image).astype(np.uint16)
    raise _ImageError(f"has pixels of the kind {image.mode}, neither gray nor coloured ones of 8 or 16 bits")
