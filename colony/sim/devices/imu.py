"""Inertial units: what turns and accelerates, with biases that drift."""

from __future__ import annotations

import math

import numpy as np

from colony.body import devices
from colony.sim.chance import DEVICES, draw_deviates
from colony.sim.devices.device import Sensor
from colony.sim.physics import Physics
from colony.sim.world.world import STILL

_BIASES_EVENT = -1  # the event in which biases are drawn; the others are times
_TURN, _AHEAD, _ASIDE = range(3)


class Imu(Sensor):
    """The inertial unit of robot number `robot`. Stateful: its biases and its heading, step by step.

    The acceleration ahead is the mean over the last step, and the heading that of the last step plus the turn
    that is measured in this one. Nothing notices that a robot is placed elsewhere.
    """

    fields = ("turn_rate", "acceleration", "sideways_acceleration", "heading")

    def __init__(self, imu: devices.Imu, world: Physics, robot: int, *, seed: int) -> None:
        turn, acceleration = imu.turn, imu.acceleration
        self._noise = np.array([turn.noise, acceleration.noise, acceleration.noise])
        self._drift = np.array([turn.drift, acceleration.drift, acceleration.drift]) / math.sqrt(60.0)
        self._world = world
        self._robot = robot
        self._seed = seed
        biases = np.empty(3)
        draw_deviates(seed, DEVICES, _BIASES_EVENT, biases)
        self._biases = biases * (turn.bias, acceleration.bias, acceleration.bias)
        self._numbers = np.empty(6)
        self._before = (world.elapsed_ns, world.placements(robot))
        self._true_heading = self._heading = world.true_pose(robot).heading_deg
        self._speed = world.speed(robot)
        self._measured = [0.0, 0.0, 0.0]
        self._measure(0.0, 0.0)
        world.on_step(self._update)

    def measure(self, field: str) -> float:
        """Return what a field reads."""
        return self._heading if field == "heading" else self._measured[self.fields.index(field)]

    def _update(self) -> None:
        """Count the step that has just ended."""
        world, robot = self._world, self._robot
        elapsed_ns, placements = self._before
        self._before = world.elapsed_ns, world.placements(robot)
        seconds = (world.elapsed_ns - elapsed_ns) / 1e9
        before, now, heading = self._speed, world.speed(robot), world.true_pose(robot).heading_deg
        is_placed = world.placements(robot) != placements
        start = STILL if is_placed else before
        turned = (start.turn_deg_s + now.turn_deg_s) / 2.0 * seconds
        if not is_placed:
            turned += (heading - self._true_heading - turned + 180.0) % 360.0 - 180.0  # the exact turn
        self._speed, self._true_heading = now, heading
        ahead = (now.velocity_mm_s - start.velocity_mm_s) / seconds
        aside = (now.sideways_mm_s - start.sideways_mm_s) / seconds
        error = self._measure(ahead, aside, math.sqrt(seconds))
        self._heading = (self._heading + turned + error * seconds) % 360.0

    def _measure(self, ahead: float, aside: float, root_s: float = 0.0) -> float:
        """Measure at the end of a step of `root_s` squared; return the error of the turn rate, in deg/s.

        `ahead` and `aside` are the changes of the speeds in the robot's frame, in mm/s^2; as the frame turns,
        either speed accelerates the robot along the other axis.
        """
        draw_deviates(self._seed, DEVICES, self._world.elapsed_ns, self._numbers)
        self._biases += self._drift * root_s * self._numbers[3:]
        errors = (self._biases + self._noise * self._numbers[:3]).tolist()
        speed = self._speed
        turn = math.radians(speed.turn_deg_s)
        self._measured = [
            speed.turn_deg_s + errors[_TURN],
            ahead - speed.sideways_mm_s * turn + errors[_AHEAD],
            aside + speed.velocity_mm_s * turn + errors[_ASIDE],
        ]
        return float(errors[_TURN])
