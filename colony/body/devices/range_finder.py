"""Single range finders: infrared, time of flight, ultrasonic."""

from __future__ import annotations

from dataclasses import dataclass

from colony.body.devices.common import (
    FIELD_NAME,
    FRACTION,
    HALF_BEAM,
    POSE,
    POSE_MEANING,
    RANGE,
    SPREAD,
    Pose,
    Sensor,
)
from colony.body.kinds import Many, entry
from colony.ir.bearings import Bearings, listed_bearings
from colony.ir.servers import FieldSpec
from colony.ir.types import DISTANCE, MAX_ELEMENTS, Array


@dataclass(frozen=True, slots=True, kw_only=True)
class RangeFinder(Sensor):
    """One or several single range finders, each of which looks along a ray or into a cone."""

    field: str = entry("field", FIELD_NAME, "the field that has the ranges [default: range]", default="range")
    poses: tuple[Pose, ...] = entry("poses", Many(POSE, 1, MAX_ELEMENTS), f"of each one: {POSE_MEANING}")
    range_mm: float = entry("range", RANGE, "the longest range")
    nearest_mm: float = entry("nearest", SPREAD, "the smallest reading", default=0.0)
    half_beam_deg: float = entry(
        "half_beam",
        HALF_BEAM,
        "half the opening angle of its cone, of which it sees the nearest surface [default: one ray]",
        default=0.0,
    )
    noise_mm: float = entry("noise", SPREAD, "standard deviation of a range", default=0.0)
    noise_fraction: float = entry(
        "noise_fraction", FRACTION, "what is added to it, as a fraction of the range", default=0.0
    )
    dropouts: float = entry("dropouts", FRACTION, "the part of the readings without echo", default=0.0)

    @property
    def fields(self) -> tuple[FieldSpec, ...]:
        """The fields that it measures."""
        ranges = Array(DISTANCE, len(self.poses))
        return (FieldSpec(self.field, ranges, "the range of each range finder", no_echo=self.range_mm),)

    def bearings(self) -> Bearings:
        """Return the bearings along which they look."""
        return listed_bearings(pose.bearing_deg for pose in self.poses)
