"""The command `python -m drake_gnnocp.benchmark`, see `drake_gnnocp.experiments.reports.planning`."""

import sys

from drake_gnnocp.command_line import command_of

if __name__ == "__main__":
    sys.exit(command_of("drake_gnnocp.experiments.reports.planning"))
