"""What the command lines share: bad input is one line on stderr and exit code 2."""

from __future__ import annotations

import argparse
from typing import NoReturn

BAD_INPUT = 2  # exit code


class OneLineParser(argparse.ArgumentParser):
    """An argument parser whose errors are one line."""

    def error(self, message: str) -> NoReturn:
        """Exit with one line instead of argparse's usage and message."""
        self.exit(BAD_INPUT, f"{self.prog}: {message}\n")
