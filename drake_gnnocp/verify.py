"""The command `python -m drake_gnnocp.verify`, see `drake_gnnocp.verify_command`.

Imported, it would take the place of the function `drake_gnnocp.verify`: nothing needs to import it.
"""

import sys

from drake_gnnocp.command_line import run_command
from drake_gnnocp.verify_command import main

if __name__ == "drake_gnnocp.verify":
    raise ImportError("drake_gnnocp.verify is a function and a command; it is made of drake_gnnocp.verification")
if __name__ == "__main__":
    sys.exit(run_command(main))
