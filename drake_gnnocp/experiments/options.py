"""Options that the commands of the experiments share."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Collection
from pathlib import Path

from drake_gnnocp.console import OneLineParser, seconds

TIMING_EPILOG = "Exit code: 0 done, however many plans failed; 2 bad input. Timings want an otherwise idle machine."


def measuring_parser(name: str, description: str, epilog: str = TIMING_EPILOG) -> OneLineParser:
    """The parser of a command that measures."""
    return OneLineParser(prog=f"python -m drake_gnnocp.{name}", description=description, epilog=epilog)


def add_out(parser: argparse.ArgumentParser, *parts: str) -> None:
    """The folder to write; its default is in artifacts/."""
    out = Path("artifacts", *parts)
    parser.add_argument("--out", type=Path, default=out, metavar="DIR", help="folder to write (default: %(default)s)")


def add_budget(parser: argparse.ArgumentParser, default: float | None, of: str, shown: str = "%(default)g") -> None:
    """The wall-clock seconds of one plan."""
    text = f"wall-clock {of} in seconds (default: {shown})"
    parser.add_argument("--max-seconds", type=seconds, default=default, metavar="S", help=text)


def one_of(names: Collection[str]) -> Callable[[str], str]:
    """An argument that is one of some names, also where there may be none of them."""

    def name(text: str) -> str:
        if text not in names:
            raise argparse.ArgumentTypeError(f"must be one of {', '.join(names)}, not {text!r}")
        return text

    return name
