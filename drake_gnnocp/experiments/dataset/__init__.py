"""The training data: verified trajectories of random tasks."""
