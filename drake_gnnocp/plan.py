"""The command `python -m drake_gnnocp.plan`, see `drake_gnnocp.command_line`.

Imported, it would take the place of the function `drake_gnnocp.plan`: nothing needs to import it.
"""

import sys

from drake_gnnocp.command_line import main, run_command

if __name__ == "drake_gnnocp.plan":
    raise ImportError("drake_gnnocp.plan is a function and a command; what it is made of is in drake_gnnocp.planner")
if __name__ == "__main__":
    sys.exit(run_command(main))
