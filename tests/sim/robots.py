"""Simulated robots that tests drive."""

from __future__ import annotations

from colony.sim.config import rome_config, without_errors

ROME = rome_config()

IDEAL = without_errors(ROME)
"""RoME without errors: sensors are exact, and the odometry is the true pose."""
