"""Simulated robots that tests drive."""

from __future__ import annotations

from colony.sim.cameras.camera import rome_camera
from colony.sim.cameras.ceiling import rome_ceiling_camera
from colony.sim.config import rome_config, without_errors

ROME = rome_config()

IDEAL = without_errors(ROME)
"""RoME without errors: sensors are exact, and the odometry is the true pose."""

FRONT_CAMERA, UP_CAMERA = rome_camera(), rome_ceiling_camera()
