"""The acceptance test of a robot: it is stopped, killed and frozen while a behavior drives it."""
