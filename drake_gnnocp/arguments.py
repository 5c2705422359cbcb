"""Arguments that change the task of a command's scenario: poses, angles with units, and vehicles."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from drake_gnnocp.files import parse_json, read_text
from drake_gnnocp.maps.occupancy_grid import FARTHEST, MEANINGS
from drake_gnnocp.vehicle import Vehicle

ENDS = ("start", "goal")
TASK = (*ENDS, "vehicle", "unknown", "layers")  # what `add_task_arguments` adds, keywords of `Scenario.load`
FREE = "free"  # heading of a goal that may have any
UNITS = {"rad": 1.0, "deg": math.pi / 180}  # rad
SIGNED = re.compile(r"-[\d.]")


def add_task_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the TASK options; of start, goal and vehicle there are none unless they are given."""
    for end in ENDS:
        parser.add_argument(
            f"--{end}",
            nargs=3,
            action=_Pose,
            metavar=("X", "Y", "THETA"),
            help=f"{end} in m and rad, or 90deg{', or free' if end == 'goal' else ''} (default: the scenario's; maps "
            "have none)",
        )
    parser.add_argument("--vehicle", type=vehicle_in, metavar="JSON", help="a file with the car's measures")
    parser.add_argument(
        "--unknown",
        choices=MEANINGS,
        default=MEANINGS[0],
        help="what unknown cells of an occupancy map are taken for (default: %(default)s)",
    )
    parser.add_argument(
        "--layers",
        type=names,
        default=(),
        metavar="NAME,NAME",
        help="of a .dxf file: only what is on these layers is an obstacle (default: all that are shown)",
    )


def with_signed_numbers(argv: Sequence[str]) -> list[str]:
    """Arguments in which argparse takes no number of a pose for an option: it knows -1, but not -90deg or -1e3."""
    marked, left = [], 0
    for argument in argv:
        left = 3 if argument in {f"--{end}" for end in ENDS} else left - 1
        marked.append(f" {argument}" if left >= 0 and SIGNED.match(argument) else argument)
    return marked


def angle(text: str) -> float:
    """An angle [rad] from a number with its unit, rad or deg; without one it is in rad.

    Raises:
        ValueError: the text is none.
    """
    word = text.strip().lower().replace("°", "deg")
    unit = next((unit for unit in UNITS if word.endswith(unit)), "")
    return float(word.removesuffix(unit)) * UNITS.get(unit, 1.0)


def pose(texts: Sequence[str], may_be_free: bool = False) -> tuple[float | None, ...]:
    """A pose x, y, theta [m, m, rad] from three texts; the heading may be FREE where that is allowed, and is None then.

    Raises:
        ValueError: one of them is no number.
    """
    if may_be_free and texts[2].strip().lower() == FREE:
        return (*pose((*texts[:2], "0"))[:2], None)
    values: list[float | None] = []
    for what, text in zip(("X", "Y", "THETA"), texts, strict=True):
        try:
            value = angle(text) if what == "THETA" else float(text)
        except ValueError:
            value = math.nan
        if not abs(value) <= FARTHEST:  # NaN as well
            meaning = "an angle such as 1.57, 1.57rad or 90deg" if what == "THETA" else "a number in m"
            raise ValueError(f"{what} must be {meaning}, not {text.strip()!r}")
        values.append(value)
    return tuple(values)


def names(text: str) -> tuple[str, ...]:
    """An argument that is a list of names."""
    found = tuple(name.strip() for name in text.split(","))
    if not all(found):
        raise argparse.ArgumentTypeError(f"must be names with commas between, not {text!r}")
    return found


def vehicle_in(name: str) -> Vehicle:
    """An argument that names a JSON file with some of the parameters of a vehicle."""
    try:
        data = parse_json(read_text(Path(name)))
        if not isinstance(data, dict):
            raise ValueError("vehicle: must be an object")
        return Vehicle.from_dict(data)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{name}: {error}") from None


class _Pose(argparse.Action):
    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,
        option_string: str | None = None,
    ) -> None:
        try:
            setattr(namespace, self.dest, pose(values, may_be_free=self.dest == "goal"))
        except ValueError as error:
            raise argparse.ArgumentError(self, str(error)) from None
