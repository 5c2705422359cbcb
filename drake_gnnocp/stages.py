"""The command `python -m drake_gnnocp.stages`, see `drake_gnnocp.experiments.reports.stages`."""

import sys

from drake_gnnocp.command_line import command_of

if __name__ == "__main__":
    sys.exit(command_of("drake_gnnocp.experiments.reports.stages"))
