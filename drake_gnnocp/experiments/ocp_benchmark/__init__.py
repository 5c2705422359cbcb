"""How fast and how surely the optimal control problem is solved, and how a peer does: see `__main__`."""
