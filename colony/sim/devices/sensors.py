"""Simulated sensors that are no rangers: battery, bumper, buttons, compass, inertial unit and others."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from colony.body import devices
from colony.body.devices import Button
from colony.body.kinds import Amount
from colony.ir.bearings import TURN, sweep
from colony.ir.types import ScalarValue, Value
from colony.nav.maps.stickrep.model import Pose
from colony.sim.chance import DEVICES, deviate, draw_deviates
from colony.sim.compiled import Floats, Floats2, compiled, inlined
from colony.sim.devices.device import SimulatedSensor
from colony.sim.mechanism import Action
from colony.sim.physics import Physics
from colony.sim.world.world import STILL

# --- battery ------------------------------------------------------------------------------------------
#
# The charge of a battery, which standing and driving use up and a charger fills.


class Battery(SimulatedSensor):
    """The battery of robot number `robot`. Stateful: holds the energy that is left, counted step by step.

    Power for driving is proportional to the distance. The chargers are the docks of the world or, if it has
    none, where the robot is now; a battery that is empty stops nothing.
    """

    fields = ("level", "charging")

    def __init__(self, battery: devices.BatterySpec, world: Physics, robot: int) -> None:
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


# --- bumper -------------------------------------------------------------------------------------------
#
# Bumpers by sectors of the hull.


class Bumper(SimulatedSensor):
    """The bumper of robot number `robot`, which walls, other robots and people press."""

    def __init__(self, bumper: devices.BumperSpec, world: Physics, robot: int) -> None:
        self.fields = (bumper.field,)
        self._sectors = [(first, float(sweep(first, last))) for first, last in bumper.sectors]
        self._free = (False,) * len(self._sectors)
        self._world = world
        self._robot = robot

    def measure(self, field: str) -> tuple[bool, ...]:
        """Return whether something touches the hull within each sector; its ends are in it."""
        touched = self._world.contact_bearings(self._robot)
        if not touched:
            return self._free
        return tuple(
            any((bearing - first) % TURN <= width for bearing in touched) for first, width in self._sectors
        )


# --- button -------------------------------------------------------------------------------------------
#
# Buttons that nobody presses: what presses them is given.


class Buttons(SimulatedSensor):
    """The buttons of a panel, all released."""

    def __init__(self, button: Button) -> None:
        self.fields = button.names

    def measure(self, field: str) -> bool:
        """Return False: the button is released."""
        return False


# --- cliff --------------------------------------------------------------------------------------------
#
# Sensors that look down: whether each is above a hole in the floor.


class Cliff(SimulatedSensor):
    """The sensors of robot number `robot` that look down."""

    def __init__(self, cliff: devices.CliffSpec, world: Physics, robot: int) -> None:
        self.fields = (cliff.field,)
        self._places = cliff.places
        self._solid = (False,) * len(cliff.places)
        self._world = world
        self._robot = robot

    def measure(self, field: str) -> tuple[bool, ...]:
        """Return whether the ground is missing at each place."""
        holes = self._world.holes
        if not holes:
            return self._solid
        x, y, heading = self._world.true_pose(self._robot)
        sine, cosine = math.sin(math.radians(heading)), math.cos(math.radians(heading))
        found = []
        for u, v in self._places:
            at_x, at_y = x - u * sine - v * cosine, y + u * cosine - v * sine
            found.append(any(is_inside(hole, at_x, at_y) for hole in holes))
        return tuple(found)


def is_inside(polygon: Floats2, x: float, y: float) -> bool:
    """Return True if a point is inside a polygon, (n, 2); a point on a side may be either.

    A ray from a point inside crosses the sides an odd number of times.
    """
    crossings = 0
    corners = polygon.tolist()
    for (ax, ay), (bx, by) in zip(corners, corners[1:] + corners[:1], strict=True):
        if (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * (bx - ax):
            crossings += 1
    return crossings % 2 == 1


# --- compass ------------------------------------------------------------------------------------------
#
# Compasses.


class Compass(SimulatedSensor):
    """The compass of robot number `robot`, which the building disturbs (`World.compass`)."""

    fields = ("heading",)

    def __init__(self, compass: devices.CompassSpec, world: Physics, robot: int, *, seed: int) -> None:
        self._offset_deg, self._noise_deg = compass.offset_deg, compass.noise_deg
        self._world = world
        self._robot = robot
        self._seed = seed
        self._number = np.empty(1)

    def measure(self, field: str) -> float:
        """Return the heading, in [0, 360)."""
        draw_deviates(self._seed, DEVICES, self._world.elapsed_ns, self._number)
        error_deg = self._offset_deg + self._noise_deg * float(self._number[0])
        return (self._world.compass(self._robot) + error_deg) % TURN


# --- dock sensor --------------------------------------------------------------------------------------
#
# Sensors of docks: the nearest dock that is in view and not hidden by a wall.


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


class DockSensor(SimulatedSensor):
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

    def __init__(self, sensor: devices.DockSensorSpec, world: Physics, robot: int, *, seed: int) -> None:
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


# --- encoders -----------------------------------------------------------------------------------------
#
# Encoders of wheels: what the wheels report, which the world's dead reckoning is made of.


class Encoders(SimulatedSensor):
    """The encoders of the wheels of robot number `robot`, which are at 0 now."""

    fields = ("travel",)

    def __init__(self, encoders: devices.EncodersSpec, world: Physics, robot: int) -> None:
        self._resolution_mm = encoders.resolution_mm
        self._world, self._robot = world, robot
        self._begin = world.travel(robot)

    def measure(self, field: str) -> tuple[float, ...]:
        """Return how far each wheel has rolled by its own report, in whole ticks."""
        rolled = zip(self._world.travel(self._robot), self._begin, strict=True)
        return tuple(self._in_ticks(now - begin) for now, begin in rolled)

    def _in_ticks(self, travel_mm: float) -> float:
        if self._resolution_mm == 0.0:
            return travel_mm
        return math.floor(travel_mm / self._resolution_mm) * self._resolution_mm


# --- imu ----------------------------------------------------------------------------------------------
#
# Inertial units: what turns and accelerates, with biases that drift.

_BIASES_EVENT = -1  # the event in which biases are drawn; the others are times
_TURN, _AHEAD, _ASIDE = range(3)


class Imu(SimulatedSensor):
    """The inertial unit of robot number `robot`. Stateful: its biases and its heading, step by step.

    The acceleration ahead is the mean over the last step, and the heading that of the last step plus the turn
    that is measured in this one. Nothing notices that a robot is placed elsewhere.
    """

    fields = ("turn_rate", "acceleration", "sideways_acceleration", "heading")

    def __init__(self, imu: devices.ImuSpec, world: Physics, robot: int, *, seed: int) -> None:
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


# --- value --------------------------------------------------------------------------------------------
#
# Values that a body describes: constants, noise, and what is painted over the map.


class PaintedValues(SimulatedSensor):
    """The described values where robot number `robot` is."""

    def __init__(self, described: devices.ValuesSpec, world: Physics, robot: int, *, seed: int) -> None:
        self.fields = tuple(described.values)
        self._values = described.values
        self._world = world
        self._robot = robot
        self._seed = seed
        self._numbers = np.empty(len(self.fields))

    def measure(self, field: str) -> ScalarValue:
        """Return the value of a field at the robot's center."""
        described = self._values[field]
        x, y, _ = self._world.true_pose(self._robot)
        value = _plain(described, described.amount)
        for x0, y0, x1, y1, amount in described.rectangles:
            if min(x0, x1) <= x <= max(x0, x1) and min(y0, y1) <= y <= max(y0, y1):
                value = _plain(described, amount)
        around = value
        for circle in described.circles:
            away = math.hypot(x - circle.x_mm, y - circle.y_mm) / circle.radius_mm
            if away <= 1.0:
                value = _plain(described, circle.amount)
                if described.edge == "fading":
                    value += away * (around - value)
        if described.noise is not None:
            draw_deviates(self._seed, DEVICES, self._world.elapsed_ns, self._numbers)
            value += _plain(described, described.noise) * float(self._numbers[self.fields.index(field)])
        return value


def _plain(described: devices.ValueField, amount: Amount) -> ScalarValue:
    """Return an amount as a reading: a member of an enum as its number."""
    value = amount.value
    return float(described.members.index(value)) if isinstance(value, str) else value


# --- unsimulated --------------------------------------------------------------------------------------
#
# Devices that exist in hardware alone: the simulator knows nothing of what they measure or do.


class Unsimulated(SimulatedSensor):
    """A device whose fields have no values but those that are given; its commands do nothing."""

    fields = ()

    def measure(self, field: str) -> None:
        """Return None: there is nothing to measure."""

    def action(self, name: str, values: Mapping[str, ScalarValue]) -> Action:
        """Return what does nothing: any command is taken."""
        return self.safe
