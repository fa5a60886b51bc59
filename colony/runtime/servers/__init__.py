"""The servers of a robot: nodes that publish its sensors, drive its actuators and share data."""
