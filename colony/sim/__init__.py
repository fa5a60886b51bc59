"""The simulator: a building with robots, their sensors and cameras, and the hazards of a run."""
