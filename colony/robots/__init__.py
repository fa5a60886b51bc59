"""Whole robots, put together from all packages: what runs a program on one, simulated or real."""
