"""Maps and drawings as input: occupancy grids of ROS `map_server`, GeoJSON and DXF files."""
