"""The comparisons of the paper as tables, Markdown and CSV: see `__main__`."""
