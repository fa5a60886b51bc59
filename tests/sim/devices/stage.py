"""A robot with devices of its own in a world, and what the tests of devices read of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from colony.body.model import Body
from colony.body.reader import body_of_text
from colony.body.servers import servers_of
from colony.ir.types import Value
from colony.sim.config import config_of
from colony.sim.devices import devices_of
from colony.sim.hazards.scenery import Scenery
from colony.sim.mechanism import Given, nothing_given
from colony.sim.world.world import World

CHASSIS = """
[robot]
name = "probe"

[body]
footprint = { shape = "circle", radius = "300 mm" }

[body.drive]
kind       = "differential"
wheel_base = "400 mm"

[body.limits]
velocity          = "1 m/s"
turn              = "90 deg/s"
acceleration      = "10 m/s^2"
turn_acceleration = "900 deg/s^2"

[server.RServer]
simulated = { device = "base" }
"""


MECANUM = CHASSIS.replace(
    '"differential"\nwheel_base = "400 mm"',
    '"omnidirectional"\nwheel_base = "400 mm"\nwheel_distance = "300 mm"',
)
"""The same on four mecanum wheels."""


def body_with(servers: str, chassis: str = CHASSIS) -> Body:
    """A small round robot with these servers besides its base."""
    found = body_of_text(chassis + servers, "probe.toml")
    assert found.body is not None, found.diagnostics
    return found.body


class Stage:
    """Robots of one body in a world, and the devices of each. Mutable: the world goes on."""

    def __init__(
        self,
        servers: str,
        *,
        walls: Any = (),
        poses: Sequence[tuple[float, float, float]] = ((0.0, 0.0, 0.0),),
        seed: int = 1,
        given: Given = nothing_given,
        holes: Sequence[Any] = (),
        chassis: str = CHASSIS,
        docks: Sequence[tuple[float, float, float]] = (),
    ) -> None:
        self.body = body_with(servers, chassis)
        walls = walls if isinstance(walls, Scenery) else np.array(walls, dtype=float)
        self.world = World(walls=walls, poses=poses, config=config_of(self.body), holes=holes, docks=docks)
        specs = servers_of(self.body)
        self.devices = [
            devices_of(self.body, specs, self.world, robot, seed=seed, given=given)
            for robot in range(len(poses))
        ]

    def read(self, server: str, field: str, robot: int = 0) -> Value | None:
        """What a field reads now."""
        sample = self.devices[robot][server].sense(self.world.elapsed_ns)[field]
        return None if sample is None else sample.value

    def time_of(self, server: str, field: str) -> int | None:
        """When the value of a field was measured."""
        sample = self.devices[0][server].sense(self.world.elapsed_ns)[field]
        return None if sample is None else sample.t_ns

    def advance(self, seconds: float, step_s: float = 0.05) -> None:
        """Let time pass."""
        for _ in range(round(seconds / step_s)):
            self.world.advance(step_s)

    def drive(self, seconds: float, velocity: float, turn: float = 0.0) -> None:
        """Drive for a time, and stop."""
        self.world.command(0, velocity, turn)
        self.advance(seconds)
        self.world.command(0, 0.0, 0.0)
        self.advance(1.0)
