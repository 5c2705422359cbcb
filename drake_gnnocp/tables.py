"""The command `python -m drake_gnnocp.tables`, see `drake_gnnocp.experiments.reports.tables_command`."""

import sys

from drake_gnnocp.experiments.reports.tables_command import main

if __name__ == "__main__":
    sys.exit(main())
