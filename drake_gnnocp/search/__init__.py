"""Paths before optimal control: Hybrid A*, Reeds-Shepp curves and the speed planner."""
