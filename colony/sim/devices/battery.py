"""The charge of a battery, which standing and driving use up and a charger fills."""

from __future__ import annotations

import math

from colony.body import devices
from colony.nav.maps.stickrep.model import Pose
from colony.sim.devices.device import Sensor
from colony.sim.physics import Physics


class Battery(Sensor):
    """The battery of robot number `robot`. Stateful: holds the energy that is left, counted step by step.

    Power for driving is proportional to the distance. The chargers are the docks of the world or, if it has
    none, where the robot is now; a battery that is empty stops nothing.
    """

    fields = ("level", "charging")

    def __init__(self, battery: devices.Battery, world: Physics, robot: int) -> None:
        self._capacity_j, self._standing_w = battery.capacity_j, battery.standing_w
        self._charger_w, self._reach_mm = battery.charger_w, battery.reach_mm
        self._reach_angle_deg = battery.reach_angle_deg
        self._world = world
        self._robot = robot
        self._energy_j = battery.capacity_j * battery.start
        self._driving_j_mm = battery.driving_w / world.configs[robot].max_velocity_mm_s
        self._start = world.true_pose(robot)
        self._elapsed_ns = world.elapsed_ns
        self._distance_mm = world.distance(robot)
        self._is_charging = self._is_at_charger()
        world.on_step(self._use)

    def measure(self, field: str) -> float | bool:
        """Return the level, or whether the battery is being charged."""
        return self._is_charging if field == "charging" else self._energy_j / self._capacity_j

    def _use(self) -> None:
        """Count the energy of the step that has just ended."""
        elapsed_ns, distance_mm = self._world.elapsed_ns, self._world.distance(self._robot)
        seconds, driven_mm = (elapsed_ns - self._elapsed_ns) / 1e9, distance_mm - self._distance_mm
        self._elapsed_ns, self._distance_mm = elapsed_ns, distance_mm
        self._is_charging = driven_mm == 0.0 and self._is_at_charger()
        power_w = self._charger_w - self._standing_w if self._is_charging else -self._standing_w
        energy_j = self._energy_j + power_w * seconds - self._driving_j_mm * driven_mm
        self._energy_j = min(max(energy_j, 0.0), self._capacity_j)

    def _is_at_charger(self) -> bool:
        """Return True if the robot stands where a charger reaches it."""
        if self._charger_w <= 0.0 or any(self._world.speed(self._robot)):
            return False
        pose = self._world.true_pose(self._robot)
        return any(self._reaches(charger, pose) for charger in self._world.docks or (self._start,))

    def _reaches(self, charger: Pose, pose: Pose) -> bool:
        """Return True if a charger reaches a robot at `pose`."""
        apart_mm = math.hypot(pose.x_mm - charger.x_mm, pose.y_mm - charger.y_mm)
        turned_deg = abs((pose.heading_deg - charger.heading_deg + 180.0) % 360.0 - 180.0)
        return apart_mm <= self._reach_mm and turned_deg <= self._reach_angle_deg
