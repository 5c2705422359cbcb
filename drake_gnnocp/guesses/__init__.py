"""Where the first guess of the optimal control problem comes from."""
