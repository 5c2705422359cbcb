"""What commands share: arguments, exit codes, and errors of one line.

Bad input is one line on stderr and exit code 2; output that cannot be written is one line and 4.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import NoReturn

DONE, BAD_INPUT, NOT_VERIFIED, NOT_WRITTEN, INTERRUPTED, NOBODY_READS = 0, 2, 3, 4, 130, 141  # exit codes


class OneLineParser(argparse.ArgumentParser):
    """An argument parser whose errors are one line."""

    def error(self, message: str) -> NoReturn:
        """Exit with one line instead of argparse's usage and message."""
        self.exit(BAD_INPUT, f"{self.prog}: {message}\n")


def count(text: str) -> int:
    """An argument that is a whole number of 0 or more."""
    if not text.isdecimal() or len(text) > 9:
        raise argparse.ArgumentTypeError(f"must be a number of 0 or more, not {text!r}")
    return int(text)


def positive(text: str) -> int:
    """An argument that is a whole number of 1 or more."""
    if (n := count(text)) == 0:
        raise argparse.ArgumentTypeError(f"must be a number of 1 or more, not {text!r}")
    return n


def seconds(text: str) -> float:
    """An argument that is a time in (0, 100000] [s]."""
    return _at_most(1e5, "0 to 100000 seconds", text)


def share(text: str) -> float:
    """An argument that is a number in (0, 1]."""
    return _at_most(1.0, "above 0 and at most 1", text)


def _at_most(most: float, meaning: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 < value <= most:
        raise argparse.ArgumentTypeError(f"must be {meaning}, not {text!r}")
    return value


def reported(texts: Iterable[str], out: Path, wrong: type[Exception] = ValueError) -> int:
    """Print the texts that a command makes, as they come; what is wrong with its input is one line on stderr.

    Args:
        texts: their making is the command's work, which writes into the folder `out`.
        out: see above.
        wrong: the errors that name what is wrong with the input.

    Returns:
        The exit code.
    """
    try:
        for text in texts:
            print(text)
    except (wrong, OSError) as error:
        return failed(error, out)
    print(f"written to {out}")
    return DONE


def failed(error: Exception, out: Path) -> int:
    """Say in one line on stderr what is wrong with the input or with the folder `out`; returns the exit code."""
    if not isinstance(error, OSError):
        print(" ".join(str(error).split()), file=sys.stderr)
        return BAD_INPUT
    print(f"--out: {error.filename or out}: {error.strerror or error}", file=sys.stderr)
    return BAD_INPUT if isinstance(error, FileExistsError | NotADirectoryError) else NOT_WRITTEN
