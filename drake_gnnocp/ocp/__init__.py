"""The optimal control problem: direct collocation in a Drake `MathematicalProgram`, solved by Ipopt and refined."""
