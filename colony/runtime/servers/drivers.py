"""Driver interfaces between the servers and the devices of a robot, simulated or real.

Drivers do not block. They return the newest reading with the time at which it was taken, or None if there is
none yet; a slow device is read in the background. Times are those of the robot's Clock. The mechanism that
stops the robot if its control program fails is in the device, below the driver.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

from colony.ir.servers import ServerSpec
from colony.ir.types import ScalarValue, Value
from colony.runtime.protocol.images import Shot
from colony.runtime.protocol.messages import Sample

MAX_PROBLEM_LENGTH = 200
"""Maximum length of the problem of a driver, in characters; the rest is cut off."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BaseState:
    """One consistent snapshot of a base, taken at `t_ns`.

    Dead reckoning gives the position in mm (x east, y north) and the heading in degrees (0 north,
    counterclockwise, in [0, 360)). Speeds are measured, in mm/s and deg/s; `sideways_speed` is positive to
    the left, and `wheel_speed` is the mean magnitude of the wheels' speeds.
    """

    t_ns: int
    x: float
    y: float
    heading: float
    front_bumper: bool
    rear_bumper: bool
    speed: float
    turn_rate: float
    wheel_speed: float
    sideways_speed: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class BaseLimits:
    """The limits of a base, in either direction: mm/s, deg/s, mm/s^2 and deg/s^2.

    The sideways ones are 0 for a base that cannot drive sideways.
    """

    velocity: float
    turn: float
    acceleration: float
    turn_acceleration: float
    sideways: float = 0.0
    sideways_acceleration: float = 0.0


class BaseDriver(Protocol):
    """A base (thesis section 4.6.3)."""

    @property
    def limits(self) -> BaseLimits:
        """The constant limits of the base; commands beyond them are refused."""
        ...

    @property
    def register_bits(self) -> int | None:
        """The number of bits of the signed x and y registers, which overflow; None if they never do."""
        ...

    def drive(self, velocity: float, turn: float) -> None:
        """Drive at `velocity` mm/s, turning `turn` deg/s counterclockwise, until the next command."""
        ...

    def stop(self) -> None:
        """Stop immediately. Never raises, and may be called at any time, repeatedly."""
        ...

    def state(self) -> BaseState | None:
        """Return the newest snapshot, or None."""
        ...


class OmnidirectionalDriver(BaseDriver, Protocol):
    """A base that drives sideways, too: the limit of its sideways speed is above 0."""

    def drive(self, velocity: float, turn: float, sideways: float = 0.0) -> None:
        """Drive as a `BaseDriver` does, and at `sideways` mm/s to the left."""
        ...


class ProximityDriver(Protocol):
    """A ring of sonars, and one of infrared detectors (thesis section 4.6.2)."""

    @property
    def count(self) -> int:
        """The number of sonars, and of infrared detectors."""
        ...

    def sonar(self) -> Sample | None:
        """Return the ranges in mm, or None."""
        ...

    def infrared(self) -> Sample | None:
        """Return bools, True for a detector that sees something, or None."""
        ...


class CameraDriver(Protocol):
    """A camera (thesis section 4.6.4)."""

    def grab(self) -> Shot | None:
        """Return the newest image; None if there is none yet."""
        ...


@dataclass(frozen=True, slots=True)
class Reading:
    """A measurement and its age: the nanoseconds since the device took it, at least 0.

    In an array an element is None if it is invalid, and infinite if there was no echo.
    """

    value: Value | tuple[ScalarValue | None, ...]
    age_ns: int


class OverheardCommand(NamedTuple):
    """A command of another controller: its parameters by name, in the driver's units, and its age."""

    values: Mapping[str, ScalarValue]
    age_ns: int


class ListeningDriver(Protocol):
    """A driver that commands nothing, and hears what another controller commands."""

    def overheard(self) -> Mapping[str, OverheardCommand | None]:
        """Return the command in force for each commanded topic, or None."""
        ...


def problems_of(driver: object) -> tuple[str, ...]:
    """Return what a driver says that it suffers from: its property `problem`, a text, which it may lack.

    A driver whose device works has the problem None.
    """
    try:
        problem = getattr(driver, "problem", None)
        return (problem[:MAX_PROBLEM_LENGTH],) if isinstance(problem, str) and problem else ()
    except Exception:  # a property of a user's class
        return ()


def is_opening(driver: object) -> bool:
    """Return True if a driver says, by its property `is_opening`, that its device is not ready yet.

    A device that is being opened has not failed: its driver has no `problem`.
    """
    try:
        return getattr(driver, "is_opening", False) is True
    except Exception:  # a property of a user's class
        return False


def unreached_of(driver: object) -> tuple[str, ...]:
    """Return why the last stop, or `safe`, has not reached the device of a driver; nothing if it has.

    A driver whose stop takes a while after the method has returned has a property `unreached`: the reason, or
    None once the stop has reached the device.
    """
    try:
        why = getattr(driver, "unreached", None)
    except Exception as problem:  # a property of a user's class
        why = f"`unreached` failed: {type(problem).__name__}"
    return (str(why)[:MAX_PROBLEM_LENGTH],) if why else ()


class DeviceDriver(Protocol):
    """A device with fields and commands of any kind, in the units that the robot's interface declares.

    A driver may be a class of a user. Whatever it raises is reported, and counts as no value or as a command
    that was not sent. A driver may have the properties `problem` (`problems_of`), `is_opening`,
    `unreached` (`unreached_of`) and `commands`: the names of its commands, if it knows them.
    """

    def fields(self) -> Mapping[str, Reading | None]:
        """Return the newest reading of each field; None, or nothing, for one that has no value."""
        ...

    def command(self, name: str, values: Mapping[str, ScalarValue]) -> None:
        """Carry out a command, with its parameters by name, once in each frame that decides for one."""
        ...

    def safe(self) -> None:
        """Make the device safe.

        Called when its server starts and ends; and at an emergency stop or when the Clock is silent, if the
        actuator has no idle command.
        """
        ...

    def close(self) -> None:
        """Release the device."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Drivers:
    """The devices of one robot.

    Attributes:
        servers: what its servers offer, including those that every robot has.
        base: the base; None for a robot without one.
        proximity: the ring of sonars, if it has one.
        cameras: its cameras, by the names of their servers.
        devices: its other devices, by the names of their servers.
    """

    servers: tuple[ServerSpec, ...]
    base: BaseDriver | None = None
    proximity: ProximityDriver | None = None
    cameras: Mapping[str, CameraDriver] = field(default_factory=dict)
    devices: Mapping[str, DeviceDriver] = field(default_factory=dict)
