"""Runs of whole robots: settings, runs in a simulated building, missions."""
