"""What a server needs of the device below it. A simulated robot and a real one look the same from here.

Drivers answer at once: they give the newest reading that they have, with the time at which it was taken, or
None where there was none yet; a slow device is read in the background. Times are those of the robot's Clock.
What must stop a robot whose control program is gone sits below the driver, in the device.
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

    Position in mm (x east, y north) and heading in degrees (0 north, counterclockwise, in [0, 360)) by dead
    reckoning; measured speeds in mm/s and deg/s. `wheel_speed` is the mean magnitude of both wheels' speeds.
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
    """The most that a base does, in either direction: mm/s, deg/s, mm/s^2 and deg/s^2."""

    velocity: float
    turn: float
    acceleration: float
    turn_acceleration: float


class BaseDriver(Protocol):
    """A base with two driven wheels (thesis section 4.6.3)."""

    @property
    def limits(self) -> BaseLimits:
        """What commands are refused beyond; they do not change."""
        ...

    @property
    def register_bits(self) -> int | None:
        """How many bits the signed registers of x and y have, which overflow; None: they never do."""
        ...

    def drive(self, velocity: float, turn: float) -> None:
        """Go at `velocity` mm/s, turning `turn` deg/s counterclockwise, until told otherwise."""
        ...

    def stop(self) -> None:
        """Stand still, at once. Never raises, and may be called at any time and again."""
        ...

    def state(self) -> BaseState | None:
        """The newest snapshot, or None."""
        ...


class ProximityDriver(Protocol):
    """Rings of 24 sonars and 24 infrared detectors (thesis section 4.6.2)."""

    def sonar(self) -> Sample | None:
        """24 ranges in mm."""
        ...

    def infrared(self) -> Sample | None:
        """24 bools: whether the detector sees something."""
        ...


class CameraDriver(Protocol):
    """A camera (thesis section 4.6.4)."""

    def grab(self) -> Shot | None:
        """Take the newest image; None where there is none yet."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Drivers:
    """The devices of one robot; `cameras` by the names of their servers."""

    base: BaseDriver
    proximity: ProximityDriver
    cameras: Mapping[str, CameraDriver] = field(default_factory=dict)
