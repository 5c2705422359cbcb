"""The command `python -m drake_gnnocp.dataset`, see `drake_gnnocp.experiments.dataset.command`."""

import sys

from drake_gnnocp.command_line import run_command
from drake_gnnocp.experiments.dataset.command import main

if __name__ == "__main__":
    sys.exit(run_command(main))
