"""How well and how fast plans are made and the optimal control problem is solved, method against method."""
