"""What the parameters are worth, as measured curves: see `__main__`."""
