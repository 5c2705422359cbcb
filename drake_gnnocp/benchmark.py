"""The command `python -m drake_gnnocp.benchmark`, see `drake_gnnocp.experiments.reports.planning`."""

import sys

from drake_gnnocp.experiments.reports.planning import main

if __name__ == "__main__":
    sys.exit(main())
