"""Random tasks: places (open maps, car parks, yards) and pairs of poses in them, everything from one seed."""
