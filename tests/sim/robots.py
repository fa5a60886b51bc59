"""Simulated robots that tests drive."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from colony.body.model import Omnidirectional
from colony.sim.cameras.camera import rome_camera
from colony.sim.cameras.ceiling import rome_ceiling_camera
from colony.sim.config import RingConfig, RobotConfig, rome_config, without_errors
from colony.sim.world.world import World

ROME = rome_config()

IDEAL = without_errors(ROME)
"""RoME without errors: sensors are exact, and the odometry is the true pose."""


SIDEWAYS: dict[str, Any] = {
    "omni_wheels": Omnidirectional(wheel_base_mm=340.0, wheel_distance_mm=300.0).rolling,
    "max_sideways_mm_s": 500.0,
    "sideways_acceleration_mm_s2": 400.0,
}
"""The changes that give a robot four mecanum wheels."""


def ring_of(config: RobotConfig) -> RingConfig:
    """The ring of a robot that has one."""
    assert config.ring is not None
    return config.ring


def with_ring(config: RobotConfig, **changes: Any) -> RobotConfig:
    """A robot with changes to its ring."""
    return replace(config, ring=replace(ring_of(config), **changes))


def pass_time(world: World, seconds: float, step_s: float = 0.1) -> None:
    """Let time pass in a world, step by step."""
    for _ in range(round(seconds / step_s)):
        world.advance(step_s)


RING = ring_of(IDEAL)
"""The ring of RoME, without noise."""

FRONT_CAMERA, UP_CAMERA = rome_camera(), rome_ceiling_camera()
