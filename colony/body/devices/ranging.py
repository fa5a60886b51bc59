"""Descriptions of rangers and of cameras."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from colony.body.devices.common import (
    CENTER,
    COUNT,
    DIRECTION,
    FIELD_NAME,
    FRACTION,
    HALF_BEAM,
    POSE,
    POSE_MEANING,
    RANGE,
    SIZE,
    SPREAD,
    STEP,
    MountPose,
    SensorSpec,
)
from colony.body.kinds import POSITIVE, AllowedRange, FixedArray, Many, Measure, TableKind, Whole, entry
from colony.ir.bearings import Bearings, listed_bearings, uniform
from colony.ir.servers import FieldSpec
from colony.ir.types import BOOL, DISTANCE, MAX_ELEMENTS, Array
from colony.text.units import ANGLE, LENGTH

# --- cameras -------------------------------------------------------------------------------------------
#
# Cameras.


_HEIGHT = Measure(LENGTH, "1.2 m", POSITIVE)
_VIEW = Measure(ANGLE, "60 deg", AllowedRange(low=1.0, high=179.0))


class Size(NamedTuple):
    """The size of an image, in pixels."""

    columns: int
    rows: int


_SIZE = FixedArray((Whole(4, 4000), Whole(4, 4000)), Size)


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraSpec(SensorSpec):
    """A level camera: its optical axis is parallel to the floor."""

    pose: MountPose = entry("pose", POSE, POSE_MEANING, default=CENTER)
    height_mm: float = entry("height", _HEIGHT, "height of the lens above the floor")
    view_deg: float = entry("view", _VIEW, "horizontal angle of view")
    size: Size = entry("size", _SIZE, "columns and rows of the image")

    @property
    def fields(self) -> tuple[FieldSpec, ...]:
        """The fields that it measures: none; images are asked for."""
        return ()


@dataclass(frozen=True, slots=True, kw_only=True)
class CeilingCameraSpec(SensorSpec):
    """A camera that looks straight up, with the columns of its image along the direction of travel."""

    below_ceiling_mm: float = entry("below_ceiling", _HEIGHT, "distance of the lens from the ceiling")
    along_deg: float = entry("along", _VIEW, "angle of view along the direction of travel")
    across_deg: float = entry("across", _VIEW, "angle of view across it")
    size: Size = entry("size", _SIZE, "columns and rows of the image")

    @property
    def fields(self) -> tuple[FieldSpec, ...]:
        """The fields that it measures: none; images are asked for."""
        return ()


# --- lidar --------------------------------------------------------------------------------------------
#
# Laser scanners.


@dataclass(frozen=True, slots=True, kw_only=True)
class LidarSpec(SensorSpec):
    """A laser scanner."""

    pose: MountPose = entry("pose", POSE, POSE_MEANING, default=CENTER)
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


# --- range finder -------------------------------------------------------------------------------------
#
# Single range finders: infrared, time of flight, ultrasonic.


@dataclass(frozen=True, slots=True, kw_only=True)
class RangeFinder(SensorSpec):
    """One or several single range finders, each of which looks along a ray or into a cone."""

    field: str = entry("field", FIELD_NAME, "the field that has the ranges [default: range]", default="range")
    poses: tuple[MountPose, ...] = entry("poses", Many(POSE, 1, MAX_ELEMENTS), f"of each one: {POSE_MEANING}")
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


# --- proximity ----------------------------------------------------------------------------------------
#
# Rings of sonars and infrared detectors.

_STRAIGHT_WITHIN_DEG = 1e-6
"""The angle within which an element looks straight ahead: a text has finitely many decimals."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Sonar:
    """The sonars of a ring."""

    range_mm: float = entry("range", RANGE, "the reading without an echo")
    nearest_mm: float = entry("nearest", SPREAD, "the smallest reading", default=0.0)
    half_beam_deg: float = entry(
        "half_beam",
        HALF_BEAM,
        "half the opening angle of a transducer's cone",
    )
    critical_deg: float = entry(
        "critical",
        Measure(ANGLE, "30 deg", AllowedRange(low=0.0, high=90.0)),
        "the angle to the normal beyond which a wall reflects the sound away",
    )
    noise_mm: float = entry("noise", SPREAD, "standard deviation of an echo", default=0.0)
    noise_fraction: float = entry(
        "noise_fraction", FRACTION, "what is added to it, as a fraction of the range", default=0.0
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Infrared:
    """The infrared detectors of a ring."""

    range_mm: float = entry("range", RANGE, "the distance up to which a detector sees something")
    wired: tuple[int, ...] | None = entry(
        "wired",
        Many(Whole(0, MAX_ELEMENTS - 1), 0, MAX_ELEMENTS),
        "the elements that have a detector; the others never see anything [default: all]",
        default=None,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Proximity(SensorSpec):
    """A ring of sonars and infrared detectors around the robot's center, one of each along each bearing."""

    count: int = entry("count", COUNT, "the number of sonars, and of infrared detectors")
    bearing_deg: float = entry("bearing", DIRECTION, "the direction of element 0")
    step_deg: float | None = entry(
        "step", STEP, "the angle from each element to the next [default: 360 deg / count]", default=None
    )
    ring_mm: float = entry("ring", SIZE, "distance of the transducers from the center; ranges begin there")
    sonar: Sonar = entry("sonar", TableKind(Sonar), "the sonars")
    infrared: Infrared = entry("infrared", TableKind(Infrared), "the infrared detectors")

    @property
    def fields(self) -> tuple[FieldSpec, ...]:
        """The fields that it measures."""
        return (
            FieldSpec(
                "sonar",
                Array(DISTANCE, self.count),
                "the range of each ultrasonic sensor",
                no_echo=self.sonar.range_mm,
            ),
            FieldSpec(
                "infrared", Array(BOOL, self.count), "true for each infrared detector that sees something"
            ),
        )

    def bearings(self) -> Bearings | None:
        """Return the bearings of the elements, None if they take more than a turn."""
        return uniform(self.bearing_deg, self.step_deg, self.count)

    @property
    def ahead(self) -> int:
        """The element that looks straight ahead, in a ring that closes counterclockwise.

        Raises:
            ValueError: it is no such ring, or no element looks straight ahead.
        """
        bearings = self.bearings()
        is_ring = bearings is not None and bearings.closes and (bearings.step or 0.0) > 0.0
        angles = bearings.angles if bearings is not None and is_ring else ()
        ahead = next((i for i, angle in enumerate(angles) if abs(angle) <= _STRAIGHT_WITHIN_DEG), None)
        if ahead is None:
            raise ValueError(
                f"the ring of {self.count} elements from {self.bearing_deg:g} deg; expected one that closes "
                "counterclockwise and has an element that looks straight ahead"
            )
        return ahead
