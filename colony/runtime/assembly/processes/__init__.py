"""A robot or a run as processes: their specs, their start and restart, and their end."""
