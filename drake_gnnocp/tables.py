"""The command `python -m drake_gnnocp.tables`, see `drake_gnnocp.experiments.reports.tables_command`."""

import sys

from drake_gnnocp.command_line import command_of

if __name__ == "__main__":
    sys.exit(command_of("drake_gnnocp.experiments.reports.tables_command"))
