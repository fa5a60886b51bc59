"""The body of a robot: what its interface, in the language, has no word for.

Values are in base units (mm, s, deg and Hz), whatever unit the text has.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

from colony.body.devices import (
    DEVICES,
    BaseSpec,
    CameraSpec,
    CeilingCameraSpec,
    Device,
    MountPose,
    OmnidirectionalBase,
    Proximity,
)
from colony.body.devices.common import MAX_WHEELS, POSE
from colony.body.kinds import (
    NAME,
    NOT_NEGATIVE,
    POSITIVE,
    AllowedRange,
    FixedArray,
    FreeKeys,
    Interval,
    Many,
    Measure,
    NamedTables,
    OneOf,
    TableKind,
    TextKind,
    WordKind,
    entry,
)
from colony.body.ros2 import Ros2Node, Ros2Topic
from colony.ir.servers import RSERVER
from colony.text.units import ANGLE, LENGTH, NUMBER, TIME

_LENGTH = Measure(LENGTH, "400 mm", POSITIVE)
_PLACE = Measure(LENGTH, "-250 mm")
_SPEED = LENGTH.over(TIME)
_TURN = ANGLE.over(TIME)
_RATE = Measure(TIME.power(-1), "10 Hz", AllowedRange(low=0.0, high=10_000.0, is_open=True))
_DURATION = Measure(TIME, "50 ms", NOT_NEGATIVE)
_SHARE = Measure(NUMBER, "1 percent", AllowedRange(low=0.0, high=1.0))
_SPREAD = Measure(LENGTH, "3 mm", NOT_NEGATIVE)


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotTable:
    """The table `[robot]`."""

    name: str = entry("name", TextKind(NAME, "a name"), "the name of the robot, as in its interface")
    frame_s: float | None = entry(
        "frame",
        Measure(TIME, "50 ms", POSITIVE),
        "the frame period, which the interface has as well [default: that one]",
        default=None,
    )


class Corner(NamedTuple):
    """A corner of a footprint: x ahead of the robot's center, y to the left of it, in mm."""

    x_mm: float
    y_mm: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Circle:
    """A round footprint around the robot's center."""

    radius_mm: float = entry("radius", _LENGTH, "the radius")


@dataclass(frozen=True, slots=True, kw_only=True)
class Polygon:
    """A footprint with straight sides."""

    corners: tuple[Corner, ...] = entry(
        "corners",
        Many(FixedArray((_PLACE, _PLACE), Corner), 3, 100),
        "the corners, counterclockwise: x ahead of the center, y to the left of it",
    )


Footprint = Circle | Polygon


class Rolling(NamedTuple):
    """What a wheel rolls: the parts of the way ahead and to the left, and mm in a radian of turn."""

    ahead: float
    left: float
    turn_mm: float


def rolling_at(wheel: MountPose) -> Rolling:
    """Return what an omni wheel rolls, which slides freely across the direction in which it rolls."""
    angle = math.radians(wheel.bearing_deg)
    ahead, left = math.cos(angle), math.sin(angle)
    return Rolling(ahead, left, wheel.x_mm * left - wheel.y_mm * ahead)


@dataclass(frozen=True, slots=True, kw_only=True)
class Wheels:
    """What the wheels of every drive have."""

    wheel_base_mm: float | None = entry(
        "wheel_base", _LENGTH, "distance between left and right wheels, if they are described", default=None
    )
    scale_error: float = entry(
        "scale_error",
        Measure(NUMBER, "0.3 percent", AllowedRange(low=0.0, high=1.0)),
        "standard deviation of each wheel's scale, which is constant",
        default=0.0,
    )
    slip_mm: float = entry(
        "slip",
        _SPREAD,
        "standard deviation of a wheel's error over the first meter; it grows with the root of the distance",
        default=0.0,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Differential(Wheels):
    """A base that drives ahead and turns, as on two driven wheels on one axis through the robot's center."""

    @property
    def rolling(self) -> tuple[Rolling, ...]:
        """The described wheels, left and right."""
        half = None if self.wheel_base_mm is None else self.wheel_base_mm / 2.0
        return () if half is None else (Rolling(1.0, 0.0, -half), Rolling(1.0, 0.0, half))


@dataclass(frozen=True, slots=True, kw_only=True)
class Omnidirectional(Wheels):
    """A base that drives sideways, too: on four mecanum wheels, on omni wheels, or as its limits say."""

    wheel_distance_mm: float | None = entry(
        "wheel_distance",
        _LENGTH,
        "distance between the front and the rear wheels of a base on four mecanum wheels, two on each side",
        default=None,
    )
    wheels: tuple[MountPose, ...] = entry(
        "wheels",
        Many(POSE, 3, MAX_WHEELS),
        "of each omni wheel: x ahead of the robot's center, y to the left of it, and the direction in "
        "which it rolls",
        default=(),
    )

    @property
    def rolling(self) -> tuple[Rolling, ...]:
        """The described wheels; mecanum wheels from front left to rear right."""
        if self.wheel_base_mm is None or self.wheel_distance_mm is None:
            return tuple(map(rolling_at, self.wheels))
        reach = (self.wheel_base_mm + self.wheel_distance_mm) / 2.0
        signs = ((-1.0, -1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, 1.0))
        return tuple(Rolling(1.0, left, side * reach) for left, side in signs)


Drive = Differential | Omnidirectional


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """What the base can do at most, in either direction."""

    velocity_mm_s: float = entry("velocity", Measure(_SPEED, "600 mm/s", POSITIVE), "the highest speed")
    turn_deg_s: float = entry("turn", Measure(_TURN, "90 deg/s", POSITIVE), "the highest turn rate")
    acceleration_mm_s2: float = entry(
        "acceleration", Measure(_SPEED.over(TIME), "800 mm/s^2", POSITIVE), "toward a commanded speed"
    )
    turn_acceleration_deg_s2: float = entry(
        "turn_acceleration",
        Measure(_TURN.over(TIME), "240 deg/s^2", POSITIVE),
        "toward a commanded turn rate",
    )
    sideways_mm_s: float | None = entry(
        "sideways",
        Measure(_SPEED, "400 mm/s", POSITIVE),
        "the highest sideways speed, of a base that drives sideways [default: `velocity`]",
        default=None,
    )
    sideways_acceleration_mm_s2: float | None = entry(
        "sideways_acceleration",
        Measure(_SPEED.over(TIME), "800 mm/s^2", POSITIVE),
        "toward a commanded sideways speed [default: `acceleration`]",
        default=None,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Delays:
    """How late commands take effect, and readings arrive."""

    command_s: float = entry("command", _DURATION, "from a command to its effect", default=0.0)
    reading_s: float = entry("reading", _DURATION, "from a measurement to its arrival", default=0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Chassis:
    """The table `[body]`."""

    footprint: Footprint = entry(
        "footprint", OneOf("shape", (("circle", Circle), ("polygon", Polygon))), "the outline on the floor"
    )
    height_mm: float = entry(
        "height", Measure(LENGTH, "1.2 m", POSITIVE), "the height of the hull", default=1000.0
    )
    drive: Drive = entry(
        "drive",
        OneOf("kind", (("differential", Differential), ("omnidirectional", Omnidirectional))),
        "how it moves",
    )
    limits: Limits = entry("limits", TableKind(Limits), "what it can do at most, in either direction")
    delays: Delays = entry("delays", TableKind(Delays), "how late it is", default=Delays())

    @property
    def sideways_mm_s(self) -> float:
        """The highest sideways speed; 0 if the drive cannot move sideways."""
        if not isinstance(self.drive, Omnidirectional):
            return 0.0
        own = self.limits.sideways_mm_s
        return self.limits.velocity_mm_s if own is None else own

    @property
    def sideways_acceleration_mm_s2(self) -> float:
        """The acceleration toward a sideways speed; 0 if the drive cannot move sideways."""
        if not isinstance(self.drive, Omnidirectional):
            return 0.0
        own = self.limits.sideways_acceleration_mm_s2
        return self.limits.acceleration_mm_s2 if own is None else own


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldTable:
    """What the interface does not say of a field of a server."""

    rate_hz: float | None = entry(
        "rate", _RATE, "how often it is measured [default: the server's]", default=None
    )
    no_echo_mm: float | None = entry(
        "no_echo",
        Measure(LENGTH, "12 m", POSITIVE),
        "the reading of an element without an echo",
        default=None,
    )
    invalid: Literal["hold", "missing"] = entry(
        "invalid",
        WordKind(("hold", "missing")),
        "an element that is invalid keeps its last value and time, or makes the array missing",
        default="missing",
    )
    blocked: tuple[tuple[float, float], ...] = entry(
        "blocked",
        Many(Interval(ANGLE, "150 deg .. 165 deg"), 0, 100),
        "bearings that the robot's own body blocks; their elements read `no_echo`",
        default=(),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class HardwareTable:
    """The driver of the real device."""

    driver: str = entry(
        "driver",
        TextKind(rf"{NAME}(\.{NAME})*:{NAME}", "`module:Class`"),
        "the driver's class: `module:Class`",
    )
    watchdog: str | None = entry(
        "watchdog",
        TextKind(r"none|[0-9]+(\.[0-9]+)? m?s", '"none", or a time such as "2 s"'),
        "after what time the device stops by itself when its computer falls silent",
        default=None,
    )
    process: str | None = entry(
        "process",
        TextKind(NAME, "a name"),
        "the process that it shares with all drivers with this name [default: with those of its port]",
        default=None,
    )
    options: Mapping[str, str | float | bool] = entry(
        "", FreeKeys(), "what the driver is given, such as `port`", default={}
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceFaults:
    """The faults of a simulated device, which begin at random times and last for a while."""

    missing: float = entry(
        "missing", _SHARE, "the part of the time in which its fields have no value", default=0.0
    )
    frozen: float = entry(
        "frozen", _SHARE, "the part of the time in which its fields stay as they were, and age", default=0.0
    )
    lasting_s: float = entry(
        "lasting",
        Measure(TIME, "2 s", AllowedRange(low=0.001)),
        "how long a fault lasts on average; it is between half and one and a half of it [default: 1 s]",
        default=1.0,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ServerTable:
    """A table `[server.NAME]`."""

    rate_hz: float | None = entry(
        "rate", _RATE, "how often its fields are measured [default: each frame]", default=None
    )
    fields: Mapping[str, FieldTable] = entry(
        "fields", NamedTables(TableKind(FieldTable)), "its fields by name", default={}
    )
    simulated: Device | None = entry(
        "simulated", OneOf("device", DEVICES), "the device in the simulator", default=None
    )
    faults: DeviceFaults | None = entry(
        "faults", TableKind(DeviceFaults), "the faults of that device", default=None
    )
    hardware: HardwareTable | None = entry(
        "hardware", TableKind(HardwareTable), "the driver of the real device", default=None
    )

    ros2: Mapping[str, Ros2Topic] = entry(
        "ros2",
        NamedTables(TableKind(Ros2Topic)),
        "the topics of its fields and commands, in place of a driver",
        default={},
    )

    @property
    def is_real(self) -> bool:
        """True if it has a real device: with a driver, or on topics of ROS 2."""
        return self.hardware is not None or bool(self.ros2)

    def rate_of(self, field: str) -> float | None:
        """Return how often a field is measured, in Hz; None for each frame."""
        own = self.fields.get(field)
        return self.rate_hz if own is None or own.rate_hz is None else own.rate_hz

    def period_ns(self, field: str) -> int | None:
        """Return the time between two measurements of a field; None for each frame."""
        rate_hz = self.rate_of(field)
        return None if rate_hz is None else max(round(1e9 / rate_hz), 1)


@dataclass(frozen=True, slots=True, kw_only=True)
class Body:
    """The body of a robot; the keys of `servers` are the names of its servers."""

    robot: RobotTable = entry("robot", TableKind(RobotTable), "whose body it is")
    chassis: Chassis = entry("body", TableKind(Chassis), "its shape and its drive")
    ros2: Ros2Node = entry("ros2", TableKind(Ros2Node), "its node", default=Ros2Node())
    servers: Mapping[str, ServerTable] = entry(
        "server", NamedTables(TableKind(ServerTable)), "its servers by name", default={}
    )

    def device(self, server: str) -> Device | None:
        """Return the device of one of the servers; None if its driver and the interface alone describe it.

        The device is the one in the simulator. `RServer` has the base, also where it has a driver alone; what
        it measures and takes follows from the drive.
        """
        found = self.servers[server].simulated
        if isinstance(found, BaseSpec) or (found is None and server == RSERVER.name):
            return OmnidirectionalBase() if isinstance(self.chassis.drive, Omnidirectional) else BaseSpec()
        return found

    @property
    def base(self) -> ServerTable | None:
        """The table of the server that has the base; None if none has."""
        return next((s for name, s in self.servers.items() if isinstance(self.device(name), BaseSpec)), None)

    def camera(self, server: str) -> CameraSpec:
        """Return the level camera of a server.

        Raises:
            ValueError: the robot has none of this name.
        """
        found = self.servers.get(server)
        if found is None or not isinstance(found.simulated, CameraSpec):
            raise ValueError(f"`{self.robot.name}` has no level camera `{server}`")
        return found.simulated

    def ceiling_camera(self) -> CeilingCameraSpec:
        """Return the camera that looks up.

        Raises:
            ValueError: the robot has none, or several.
        """
        found = [s.simulated for s in self.servers.values() if isinstance(s.simulated, CeilingCameraSpec)]
        if len(found) != 1:
            raise ValueError(f"`{self.robot.name}` has {len(found)} cameras that look up; expected one")
        return found[0]

    def has_ring(self) -> bool:
        """Return True if the robot has a ring of sonars."""
        return any(isinstance(server.simulated, Proximity) for server in self.servers.values())

    def ring(self) -> Proximity:
        """Return the robot's ring of sonars.

        Raises:
            ValueError: it has none, or several.
        """
        rings = [s.simulated for s in self.servers.values() if isinstance(s.simulated, Proximity)]
        if len(rings) != 1:
            raise ValueError(f"`{self.robot.name}` has {len(rings)} rings of sonars; expected one")
        return rings[0]


ROOT = TableKind(Body)
"""The kind of a whole body."""


# --- footprint ----------------------------------------------------------------------------------------
#
# Measures of a robot's footprint.


def radius_mm(body: Body) -> float:
    """Return the radius of the circle around the robot's center that contains its footprint."""
    match body.chassis.footprint:
        case Circle(radius_mm=radius):
            return radius
        case Polygon(corners=corners):
            return max(math.hypot(*corner) for corner in corners)
