"""Simulated rangers: laser scanners and range sensors."""

from __future__ import annotations

import math
from collections.abc import Iterable
from functools import partial
from struct import Struct

import numpy as np

from colony.body import devices
from colony.ir.types import Value
from colony.sim.compiled import Floats2
from colony.sim.devices.beams import DROPOUT_BITS, LidarModel, find_ranges, normal_quantiles, scan
from colony.sim.devices.device import SimulatedSensor
from colony.sim.mechanism import Measurement
from colony.sim.physics import Physics
from colony.sim.world.world import Situation

# --- lidar --------------------------------------------------------------------------------------------
#
# Laser scanners.


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


class Lidar(SimulatedSensor):
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
        self, lidar: devices.LidarSpec, world: Physics, robot: int, *, blocked: Iterable[int], seed: int
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


# --- range finder -------------------------------------------------------------------------------------
#
# Single range finders.

RAY_STEP_DEG = 1.0
"""Largest angle between two rays of a cone."""


class RangeFinders(SimulatedSensor):
    """The range finders of robot number `robot`. Stateful: keeps the last ranges.

    They see walls, other robots and people, at any height, but not glass. One without an echo is infinite.

    Args:
        finder: the range finders.
        world: the world.
        robot: the number of the robot.
        seed: the seed of their noise.
    """

    def __init__(self, finder: devices.RangeFinder, world: Physics, robot: int, *, seed: int) -> None:
        self.fields = (finder.field,)
        half = math.radians(finder.half_beam_deg)
        count = 2 * math.ceil(finder.half_beam_deg / RAY_STEP_DEG) + 1
        offsets = np.linspace(-half, half, count)
        directions = [math.radians(pose.bearing_deg) + offsets for pose in finder.poses]
        rays = [row for angles in directions for row in (np.cos(angles), np.sin(angles), np.ones(count))]
        self._rays = np.array(rays)
        self._cones = np.array(
            [(pose.x_mm, pose.y_mm, angles[0]) for pose, angles in zip(finder.poses, directions, strict=True)]
        )
        self._model = LidarModel(
            u=0.0,
            v=0.0,
            first=0.0,
            density=(count - 1) / (2.0 * half) if count > 1 else 1.0,
            full_range=finder.range_mm,
            noise=finder.noise_mm,
            dropouts=round(finder.dropouts * 2**DROPOUT_BITS),
            person=world.person_radius_mm,
        )
        self._nearest = finder.nearest_mm
        self._noise_fraction = finder.noise_fraction
        self._quantiles = normal_quantiles()
        self._nearness = np.empty(count)
        self._ranges = np.empty(len(finder.poses))
        self._world = world
        self._robot = robot
        self._seed = seed
        self._last: tuple[Situation, int, Value] | None = None

    def measure(self, field: str) -> Value:
        """Return the ranges now."""
        return self._find(self._world.situation(), self._world.elapsed_ns)

    def take(self, field: str) -> Measurement[Value]:
        """Take a measurement of the ranges; the rays are cast when the value is needed."""
        return partial(self._find, self._world.situation(), self._world.elapsed_ns)

    def _find(self, situation: Situation, event: int) -> Value:
        last = self._last
        if last is not None and last[0] is situation and last[1] == event:
            return last[2]
        find_ranges(
            situation.poses,
            situation.radii,
            situation.people,
            situation.walls,
            situation.boxes,
            self._robot,
            event,
            self._seed,
            self._model,
            self._nearest,
            self._noise_fraction,
            self._cones,
            self._rays,
            self._quantiles,
            self._nearness,
            self._ranges,
        )
        value: Value = tuple(self._ranges.tolist())
        self._last = (situation, event, value)
        return value
