"""Explanations: why a module was active or not, why an actuator was commanded, in a frame of a run."""
