"""Laser scanners."""

from __future__ import annotations

from dataclasses import dataclass

from colony.body.devices.common import (
    CENTER,
    COUNT,
    DIRECTION,
    FIELD_NAME,
    FRACTION,
    POSE,
    POSE_MEANING,
    RANGE,
    SPREAD,
    STEP,
    Pose,
    Sensor,
)
from colony.body.kinds import entry
from colony.ir.bearings import Bearings, uniform
from colony.ir.servers import FieldSpec
from colony.ir.types import DISTANCE, Array


@dataclass(frozen=True, slots=True, kw_only=True)
class Lidar(Sensor):
    """A laser scanner."""

    pose: Pose = entry("pose", POSE, POSE_MEANING, default=CENTER)
    field: str = entry("field", FIELD_NAME, "the field that has the ranges [default: scan]", default="scan")
    count: int = entry("count", COUNT, "the number of beams")
    bearing_deg: float = entry("bearing", DIRECTION, "the direction of element 0, seen from the robot")
    step_deg: float | None = entry(
        "step", STEP, "the angle from each beam to the next [default: 360 deg / count]", default=None
    )
    range_mm: float = entry("range", RANGE, "the longest range")
    noise_mm: float = entry("noise", SPREAD, "standard deviation of a range", default=0.0)
    dropouts: float = entry("dropouts", FRACTION, "the part of the beams that stay without echo", default=0.0)

    @property
    def fields(self) -> tuple[FieldSpec, ...]:
        """The fields that it measures."""
        ranges = Array(DISTANCE, self.count)
        return (FieldSpec(self.field, ranges, "the range of each beam", no_echo=self.range_mm),)

    def bearings(self) -> Bearings | None:
        """Return the bearings of the beams, None if they take more than a turn."""
        return uniform(self.bearing_deg, self.step_deg, self.count)
