"""The devices of simulated robots, as the servers of a robot want them.

Several robots may share a world and a clock; the world is brought up to the clock's present whenever one of
its devices is read or commanded, so that time passes for all of them alike.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from colony.runtime.drivers import BaseState, Drivers
from colony.runtime.messages import Sample
from colony.sim.world import MAX_STEP_S, World


class Plant:
    """A world in step with a clock, which gives nanoseconds. Mutable: up to when time has passed."""

    def __init__(self, world: World, clock: Callable[[], int]) -> None:
        self.world = world
        self._clock = clock
        self._reached_ns = clock()

    def catch_up(self) -> int:
        """Let time pass up to the present, which is returned."""
        now = self._clock()
        while self._reached_ns < now:
            step = min(now - self._reached_ns, int(MAX_STEP_S * 1e9))
            self.world.advance(step / 1e9)
            self._reached_ns += step
        return now


class SimulatedBase:
    """The base of robot number `robot`."""

    def __init__(self, plant: Plant, robot: int) -> None:
        self._plant = plant
        self._robot = robot

    def drive(self, velocity: float, turn: float) -> None:
        self._plant.catch_up()
        self._plant.world.command(self._robot, velocity, turn)

    def stop(self) -> None:
        self.drive(0.0, 0.0)

    def state(self) -> BaseState:
        now = self._plant.catch_up()
        world, robot = self._plant.world, self._robot
        pose, speed, bumper = world.odometry(robot), world.speed(robot), world.bumper(robot)
        half = math.radians(speed.turn_deg_s) * world.config.wheel_base_mm / 2.0
        left, right = speed.velocity_mm_s - half, speed.velocity_mm_s + half
        return BaseState(
            t_ns=now,
            x=pose.x_mm,
            y=pose.y_mm,
            heading=pose.heading_deg,
            front_bumper=bumper.front,
            rear_bumper=bumper.rear,
            speed=speed.velocity_mm_s,
            turn_rate=speed.turn_deg_s,
            wheel_speed=(abs(left) + abs(right)) / 2.0,
        )


class SimulatedProximity:
    """The sonars and infrared detectors of robot number `robot`; each ring is measured when it is read."""

    def __init__(self, plant: Plant, robot: int) -> None:
        self._plant = plant
        self._robot = robot

    def sonar(self) -> Sample:
        now = self._plant.catch_up()
        return Sample(tuple(self._plant.world.sonar(self._robot).tolist()), now)

    def infrared(self) -> Sample:
        now = self._plant.catch_up()
        return Sample(tuple(self._plant.world.infrared(self._robot).tolist()), now)


def simulated_drivers(plant: Plant, robot: int = 0) -> Drivers:
    """All devices of one simulated robot."""
    return Drivers(base=SimulatedBase(plant, robot), proximity=SimulatedProximity(plant, robot))
