"""The command `python -m drake_gnnocp.ocp_benchmark`, see `drake_gnnocp.experiments.reports.solving`."""

import sys

from drake_gnnocp.command_line import command_of

if __name__ == "__main__":
    sys.exit(command_of("drake_gnnocp.experiments.reports.solving"))
