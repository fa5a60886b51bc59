"""What the devices of a body have in common: kinds of values, poses and places, and sensors."""

from __future__ import annotations

from typing import NamedTuple

from colony.body.kinds import (
    ANY,
    NAME,
    NOT_NEGATIVE,
    POSITIVE,
    AllowedRange,
    FixedArray,
    Measure,
    TextKind,
    Whole,
)
from colony.ir.servers import CommandSpec
from colony.ir.types import MAX_ELEMENTS
from colony.text.units import ANGLE, LENGTH, NUMBER
from colony.text.units import POWER as POWER_UNITS

# Kinds of values, with an example of each.
SIZE = Measure(LENGTH, "400 mm", POSITIVE)
RANGE = Measure(LENGTH, "10 m", POSITIVE)
POSITION = Measure(LENGTH, "120 mm", ANY)
SPREAD = Measure(LENGTH, "3 mm", NOT_NEGATIVE)
DIRECTION = Measure(ANGLE, "-180 deg", AllowedRange(low=-360.0, high=360.0))
STEP = Measure(ANGLE, "15 deg", AllowedRange(low=-360.0, high=360.0))
FRACTION = Measure(NUMBER, "0.3 percent", AllowedRange(low=0.0, high=1.0))
HALF_BEAM = Measure(ANGLE, "12 deg", AllowedRange(low=0.0, high=89.0))
COUNT = Whole(1, MAX_ELEMENTS)
MAX_WHEELS = 8
"""Maximum number of driven wheels."""
POWER = Measure(POWER_UNITS, "40 W", NOT_NEGATIVE)
FIELD_NAME = TextKind(NAME, "a name")


class MountPose(NamedTuple):
    """The pose of a device on the robot, in mm and degrees."""

    x_mm: float
    y_mm: float
    bearing_deg: float


CENTER = MountPose(0.0, 0.0, 0.0)

POSE = FixedArray((POSITION, POSITION, DIRECTION), MountPose)
POSE_MEANING = "x ahead of the robot's center, y to the left of it, and the direction in which it looks"


class MountPoint(NamedTuple):
    """A place on the robot, in mm: x ahead of its center, y to the left of it."""

    x_mm: float
    y_mm: float


class SensorSpec:
    """A device that takes no commands."""

    __slots__ = ()

    @property
    def commands(self) -> tuple[CommandSpec, ...]:
        """The commands that it takes: none."""
        return ()
