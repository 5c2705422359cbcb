"""How well and how fast plans are made, method against method, on many scenarios: see `__main__`."""
