"""The command `python -m drake_gnnocp.benchmark`, see `drake_gnnocp.experiments.benchmark.command`."""

import sys

from drake_gnnocp.experiments.benchmark.command import main

if __name__ == "__main__":
    sys.exit(main())
