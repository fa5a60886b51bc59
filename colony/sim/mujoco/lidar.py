"""Laser scanners whose beams MuJoCo casts, in space: they tilt with the robot."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray

from colony.body import devices
from colony.ir.types import Value
from colony.sim.devices.beams import DROPOUT_BITS, LidarModel, normal_quantiles, read
from colony.sim.devices.device import Sensor
from colony.sim.physics import Physics

Cast = Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]
"""A function that casts rays from a place, (3,) in m, in directions, (n, 3), both in the robot's frame.

It returns the distances in m, (n,), with -1 for a ray that hits nothing.
"""


class RayLidar(Sensor):
    """A scanner whose noise and dropouts are those of `colony.sim.devices.lidar.Lidar`.

    Args:
        lidar: the scanner.
        world: the physics, for its time.
        cast: casts its beams.
        height_mm: its height above the floor.
        blocked: the beams that the robot's own body blocks; they have no echo.
        seed: the seed of its noise.
    """

    def __init__(
        self,
        lidar: devices.Lidar,
        world: Physics,
        cast: Cast,
        *,
        height_mm: float,
        blocked: Iterable[int],
        seed: int,
    ) -> None:
        bearings = lidar.bearings()
        if bearings is None:
            raise ValueError(f"{lidar.count} beams take more than a turn")
        self.fields = (lidar.field,)
        angles = np.radians(bearings.angles)
        self._directions = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(lidar.count)])
        self._place = np.array([lidar.pose.x_mm, lidar.pose.y_mm, height_mm]) / 1e3
        self._blocked = list(blocked)
        self._model = LidarModel(
            u=lidar.pose.x_mm,
            v=lidar.pose.y_mm,
            first=float(angles.min()),
            density=1.0 / math.radians(abs(bearings.step or bearings.spacing)),
            full_range=lidar.range_mm,
            noise=lidar.noise_mm,
            dropouts=round(lidar.dropouts * 2**DROPOUT_BITS),
            person=0.0,
        )
        self._world, self._cast, self._seed = world, cast, seed

    def measure(self, field: str) -> Value:
        """Return the ranges now, in mm; infinity for a beam without an echo."""
        distances = self._cast(self._place, self._directions) * 1e3
        distances[distances < 0.0] = math.inf
        distances[self._blocked] = math.inf
        ranges = np.empty(len(distances))
        read(distances, self._world.elapsed_ns, self._seed, self._model, normal_quantiles(), ranges)
        value: Value = tuple(ranges.tolist())
        return value
