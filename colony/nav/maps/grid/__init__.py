"""Occupancy grids, as SLAM saves them: an image of cells, and a YAML file with their size and place."""
