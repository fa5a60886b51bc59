"""Frames of a robot: the Clock that numbers them, the servers' frames, and their assembly by readers."""
