"""The sensors of the simulated robots: sonars, infrared detectors, compass."""
