"""The figures of the paper, drawn from what this package does: `python -m drake_gnnocp.figures` is the command line."""
