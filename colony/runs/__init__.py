"""Runs of whole robots: what they are asked for, and in a simulated building; missions."""
