"""The command `python -m drake_gnnocp.figures`, see `drake_gnnocp.experiments.figures.command`."""

import sys

from drake_gnnocp.command_line import run_command
from drake_gnnocp.experiments.figures.command import main

if __name__ == "__main__":
    sys.exit(run_command(main))
