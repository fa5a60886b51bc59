"""Sensors of docks: the nearest dock that is in view and not hidden by a wall."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from colony.body import devices
from colony.ir.types import Value
from colony.sim.chance import DEVICES, deviate
from colony.sim.compiled import Floats, Floats2, compiled, inlined
from colony.sim.devices.device import Sensor
from colony.sim.physics import Physics


class DockView(NamedTuple):
    """What a sensor sees of docks; lengths in mm, angles in rad.

    Attributes:
        u, v: its place, ahead of the robot's center and to the left of it.
        bearing: the direction in which it looks.
        half_view: half the angle of view.
        full_range: the distance up to which it sees a dock.
        noise: standard deviation of a distance.
        bearing_noise: standard deviation of a bearing.
    """

    u: float
    v: float
    bearing: float
    half_view: float
    full_range: float
    noise: float
    bearing_noise: float


class DockSensor(Sensor):
    """The sensor of robot number `robot`. Stateful: keeps what it saw last.

    A dock is seen where the center of a docked robot is. The distance and the bearing are those from the
    robot's center; they have no value while no dock is seen.

    Args:
        sensor: the sensor.
        world: the world.
        robot: the number of the robot.
        seed: the seed of its noise.
    """

    fields = ("dock_seen", "dock_distance", "dock_bearing")

    def __init__(self, sensor: devices.DockSensor, world: Physics, robot: int, *, seed: int) -> None:
        self._view = DockView(
            u=sensor.pose.x_mm,
            v=sensor.pose.y_mm,
            bearing=math.radians(sensor.pose.bearing_deg),
            half_view=math.radians(sensor.view_deg / 2.0),
            full_range=sensor.range_mm,
            noise=sensor.noise_mm,
            bearing_noise=math.radians(sensor.bearing_noise_deg),
        )
        self._farthest_mm = sensor.farthest_mm
        self._world, self._robot, self._seed = world, robot, seed
        self._seen: tuple[object, int, tuple[float, float] | None] | None = None

    def measure(self, field: str) -> Value | None:
        """Return what a field reads."""
        seen = self._look()
        if field == "dock_seen":
            return seen is not None
        return None if seen is None else seen[self.fields.index(field) - 1]

    def _look(self) -> tuple[float, float] | None:
        """Return the distance in mm and the bearing in degrees of the dock that is seen, None without one."""
        world = self._world
        if not world.docks:
            return None
        situation, event = world.situation(), world.elapsed_ns
        if self._seen is None or self._seen[0] is not situation or self._seen[1] != event:
            found = np.empty(2)
            docks = np.array(world.docks)
            find_dock(
                situation.poses, situation.walls, docks, self._robot, event, self._seed, self._view, found
            )
            distance, bearing = found.tolist()
            seen = None if math.isinf(distance) else (self._clamped(distance), _turned(math.degrees(bearing)))
            self._seen = (situation, event, seen)
        return self._seen[2]

    def _clamped(self, distance_mm: float) -> float:
        return min(max(distance_mm, 0.0), self._farthest_mm)


def _turned(bearing_deg: float) -> float:
    """Return a bearing in [-180, 180)."""
    return (bearing_deg + 180.0) % 360.0 - 180.0


@inlined
def _is_hidden(x: float, y: float, dx: float, dy: float, walls: Floats2) -> bool:
    """Return True if a wall crosses the line from (x, y) by (dx, dy)."""
    for wall in range(walls.shape[0]):
        x0, y0, x1, y1 = walls[wall, 0] - x, walls[wall, 1] - y, walls[wall, 2] - x, walls[wall, 3] - y
        along_x, along_y = x1 - x0, y1 - y0
        begin, end = dx * y0 - dy * x0, dx * y1 - dy * x1
        near, far = along_y * x0 - along_x * y0, along_y * (x0 - dx) - along_x * (y0 - dy)
        if begin * end <= 0.0 and near * far < 0.0:
            return True
    return False


@compiled
def find_dock(
    poses: Floats2, walls: Floats2, docks: Floats2, robot: int, event: int, seed: int, view: DockView,
    found: Floats,
) -> None:  # fmt: skip
    """Find the nearest dock that a robot's sensor sees.

    Args:
        poses: (robots, 3), x and y in mm, heading in degrees.
        walls: (n, 7), from `wall_table`.
        docks: (docks, 3), like the poses.
        robot: the number of the robot.
        event: the event of the noise.
        seed: the seed of the noise.
        view: the sensor.
        found: (2,), set to the distance in mm and the bearing in rad, or infinite if no dock is seen.
    """
    heading = math.radians(poses[robot, 2])
    sine, cosine = math.sin(heading), math.cos(heading)
    x = poses[robot, 0] - view.u * sine - view.v * cosine
    y = poses[robot, 1] + view.u * cosine - view.v * sine
    nearest = math.inf
    found[0] = found[1] = math.inf
    for dock in range(docks.shape[0]):
        dx, dy = docks[dock, 0] - x, docks[dock, 1] - y
        distance = math.hypot(dx, dy)
        if distance <= view.full_range and distance < nearest:
            off = math.atan2(-dx * cosine - dy * sine, dy * cosine - dx * sine) - view.bearing
            off -= 2.0 * math.pi * math.floor(off / (2.0 * math.pi) + 0.5)
            is_in_view = abs(off) <= view.half_view or distance == 0.0
            if is_in_view and not _is_hidden(x, y, dx, dy, walls):
                nearest = distance
                center_x, center_y = docks[dock, 0] - poses[robot, 0], docks[dock, 1] - poses[robot, 1]
                found[0] = math.hypot(center_x, center_y)
                found[1] = math.atan2(
                    -center_x * cosine - center_y * sine, center_y * cosine - center_x * sine
                )
    found[0] += view.noise * deviate(seed, DEVICES, event, 0)
    found[1] += view.bearing_noise * deviate(seed, DEVICES, event, 2)
