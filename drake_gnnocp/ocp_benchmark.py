"""The command `python -m drake_gnnocp.ocp_benchmark`, see `drake_gnnocp.experiments.reports.solving`."""

import sys

from drake_gnnocp.experiments.reports.solving import main

if __name__ == "__main__":
    sys.exit(main())
