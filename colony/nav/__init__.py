"""Navigation: maps, route planning, pose estimation and missions."""
