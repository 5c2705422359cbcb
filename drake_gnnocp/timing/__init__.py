"""When to be where along a path: speed profile, speed planner, minimum-effort timing."""
