"""Hazards: what may go wrong in a building, and its state in one run."""
