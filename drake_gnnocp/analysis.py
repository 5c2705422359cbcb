"""The command `python -m drake_gnnocp.analysis`, see `drake_gnnocp.experiments.reports.analysis_command`."""

import sys

from drake_gnnocp.experiments.reports.analysis_command import main

if __name__ == "__main__":
    sys.exit(main())
