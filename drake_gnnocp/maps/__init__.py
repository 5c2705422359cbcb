"""Maps as input: occupancy grids of ROS `map_server`."""
