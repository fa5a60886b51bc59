"""Laser scanners."""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import partial
from struct import Struct

import numpy as np

from colony.body import devices
from colony.ir.types import Value
from colony.sim.compiled import Floats2
from colony.sim.devices.beams import DROPOUT_BITS, LidarModel, normal_quantiles, scan
from colony.sim.devices.device import Sensor
from colony.sim.mechanism import Measurement
from colony.sim.physics import Physics
from colony.sim.world.world import Situation


class _Scanners:
    """Equal scanners of the robots of a world. Stateful: the ranges of those that scanned last.

    What several of them take in one situation is cast at once, when the first of it is needed.
    """

    def __init__(self, model: LidarModel, beams: Floats2) -> None:
        self._model = model
        self._beams = beams
        self._quantiles = normal_quantiles()
        self._robots = np.empty(0, dtype=np.int64)
        self._seeds = np.empty(0, dtype=np.int64)
        self._all = np.empty(0, dtype=np.int64)
        self.ranges = np.empty((0, beams.shape[1]))
        self._taken_in: Situation | None = None
        self._taken: list[int] = []
        self._cast_in: Situation | None = None
        self._cast: set[int] = set()

    def join(self, robot: int, seed: int) -> int:
        """Add the scanner of a robot, and return its number."""
        self._robots = np.append(self._robots, robot)
        self._seeds = np.append(self._seeds, seed)
        self._all = np.arange(len(self._robots))
        self.ranges = np.empty((len(self._robots), self._beams.shape[1]))
        self._cast_in = None
        return len(self._robots) - 1

    def take(self, member: int, situation: Situation) -> None:
        """Note that a scanner takes a scan in a situation."""
        if self._taken_in is not situation:
            self._taken_in, self._taken = situation, []
        self._taken.append(member)

    def scan(self, member: int, situation: Situation, event: int) -> None:
        """Cast the beams of a scanner in a situation, and of all that took a scan in it."""
        if self._cast_in is situation and member in self._cast:
            return
        is_taken = self._taken_in is situation and member in self._taken
        self._cast_in, self._cast = situation, set(self._taken if is_taken else [member])
        members = self._all if len(self._cast) == len(self._all) else np.array(list(self._cast))
        scan(
            situation.poses,
            situation.radii,
            situation.people,
            situation.walls,
            situation.boxes,
            members,
            self._robots,
            self._seeds,
            event,
            self._model,
            self._beams,
            self._quantiles,
            self.ranges,
        )


class Lidar(Sensor):
    """The scanner of robot number `robot`. Stateful: keeps the last scan.

    It sees walls, other robots and people, at any height, but not glass. A beam without an echo is infinite.

    Args:
        lidar: the scanner.
        world: the world.
        robot: the number of the robot.
        blocked: the beams that the robot's own body blocks; they have no echo.
        seed: the seed of its noise.
    """

    def __init__(
        self, lidar: devices.Lidar, world: Physics, robot: int, *, blocked: Iterable[int], seed: int
    ) -> None:
        bearings = lidar.bearings()
        if bearings is None:
            raise ValueError(f"{lidar.count} beams take more than a turn")
        self.fields = (lidar.field,)
        step_deg = bearings.step or bearings.spacing
        self._clockwise = step_deg < 0.0
        lowest = bearings.angles[-1 if self._clockwise else 0]
        angles = math.radians(lowest) + np.arange(lidar.count) * math.radians(abs(step_deg))
        is_cast = np.ones(lidar.count)
        is_cast[list(blocked)] = 0.0
        cast_in_order = is_cast[::-1] if self._clockwise else is_cast
        beams = np.array([np.cos(angles), np.sin(angles), cast_in_order])
        model = LidarModel(
            u=lidar.pose.x_mm,
            v=lidar.pose.y_mm,
            first=float(angles[0]),
            density=1.0 / math.radians(abs(step_deg)),
            full_range=lidar.range_mm,
            noise=lidar.noise_mm,
            dropouts=round(lidar.dropouts * 2**DROPOUT_BITS),
            person=world.person_radius_mm,
        )
        self._scanners = world.shared((model, beams.tobytes()), partial(_Scanners, model, beams))
        self._member = self._scanners.join(robot, seed)
        self._struct = Struct(f"{lidar.count}d")
        self._world = world
        self._last: tuple[Situation, int, Value] | None = None

    def measure(self, field: str) -> Value:
        """Return the ranges now."""
        return self._scan(self._world.situation(), self._world.elapsed_ns)

    def take(self, field: str) -> Measurement[Value]:
        """Take a measurement of the ranges; the beams are cast when the value is needed."""
        situation = self._world.situation()
        self._scanners.take(self._member, situation)
        return partial(self._scan, situation, self._world.elapsed_ns)

    def _scan(self, situation: Situation, event: int) -> Value:
        last = self._last
        if last is not None and last[0] is situation and last[1] == event:
            return last[2]
        self._scanners.scan(self._member, situation, event)
        ranges = self._scanners.ranges[self._member]
        # Structs unpack to a tuple, without the list in between.
        value: Value = self._struct.unpack(ranges[::-1].copy().data if self._clockwise else ranges.data)
        self._last = (situation, event, value)
        return value
