"""The command `python -m drake_gnnocp.notebooks`, see `drake_gnnocp.experiments.notebooks`."""

import sys

from drake_gnnocp.command_line import run_command
from drake_gnnocp.experiments.notebooks import main

if __name__ == "__main__":
    sys.exit(run_command(main))
