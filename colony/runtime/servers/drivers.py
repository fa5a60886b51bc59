"""Driver interfaces between the servers and the devices of a robot, simulated or real.

Drivers do not block. They return the newest reading with the time at which it was taken, or None if there is
none yet; a slow device is read in the background. Times are those of the robot's Clock. The mechanism that
stops the robot if its control program fails is in the device, below the driver.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

from colony.runtime.protocol.images import Shot
from colony.runtime.protocol.messages import Sample


@dataclass(frozen=True, slots=True, kw_only=True)
class BaseState:
    """One consistent snapshot of a base, taken at `t_ns`.

    Dead reckoning gives the position in mm (x east, y north) and the heading in degrees (0 north,
    counterclockwise, in [0, 360)). Speeds are measured, in mm/s and deg/s; `wheel_speed` is the mean
    magnitude of both wheels' speeds.
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


@dataclass(frozen=True, slots=True, kw_only=True)
class BaseLimits:
    """The limits of a base, in either direction: mm/s, deg/s, mm/s^2 and deg/s^2."""

    velocity: float
    turn: float
    acceleration: float
    turn_acceleration: float


class BaseDriver(Protocol):
    """A base with two driven wheels (thesis section 4.6.3)."""

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


class ProximityDriver(Protocol):
    """Rings of 24 sonars and 24 infrared detectors (thesis section 4.6.2)."""

    def sonar(self) -> Sample | None:
        """Return 24 ranges in mm, or None."""
        ...

    def infrared(self) -> Sample | None:
        """Return 24 bools, True for a detector that sees something, or None."""
        ...


class CameraDriver(Protocol):
    """A camera (thesis section 4.6.4)."""

    def grab(self) -> Shot | None:
        """Return the newest image; None if there is none yet."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Drivers:
    """The devices of one robot; the keys of `cameras` are the names of their servers."""

    base: BaseDriver
    proximity: ProximityDriver
    cameras: Mapping[str, CameraDriver] = field(default_factory=dict)
