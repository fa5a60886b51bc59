"""The simulated devices of a robot, as its body describes them.

A pose is that of the device on the robot: x ahead of the center, y to the left of it, and the direction in
which it looks, counterclockwise from ahead. Bearings are those of the interface, which stand there, too;
`colony robot check` compares both.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from colony.body.kinds import (
    ANY,
    NAME,
    NOT_NEGATIVE,
    POSITIVE,
    Bounds,
    Many,
    Measure,
    Row,
    Table,
    Text,
    Whole,
    entry,
)
from colony.ir.bearings import Bearings, uniform
from colony.text.units import ANGLE, LENGTH, NUMBER

MAX_ELEMENTS = 4096
"""Maximum number of elements of an array that a device measures."""

_STRAIGHT_WITHIN_DEG = 1e-6
"""The angle within which an element looks straight ahead: a text has finitely many decimals."""

_LENGTH = Measure(LENGTH, "400 mm", POSITIVE)
_RANGE = Measure(LENGTH, "10 m", POSITIVE)
_HEIGHT = Measure(LENGTH, "1.2 m", POSITIVE)
_PLACE = Measure(LENGTH, "120 mm", ANY)
_SPREAD = Measure(LENGTH, "3 mm", NOT_NEGATIVE)
_DIRECTION = Measure(ANGLE, "-180 deg", Bounds(low=-360.0, high=360.0))
_STEP = Measure(ANGLE, "15 deg", Bounds(low=-360.0, high=360.0))
_VIEW = Measure(ANGLE, "60 deg", Bounds(low=1.0, high=179.0))
_FRACTION = Measure(NUMBER, "0.3 percent", Bounds(low=0.0, high=1.0))
_COUNT = Whole(1, MAX_ELEMENTS)


class Pose(NamedTuple):
    """The pose of a device on the robot, in mm and degrees."""

    x_mm: float
    y_mm: float
    bearing_deg: float


CENTER = Pose(0.0, 0.0, 0.0)

_POSE = Row((_PLACE, _PLACE, _DIRECTION), Pose)
_POSE_MEANING = "x ahead of the robot's center, y to the left of it, and the direction in which it looks"


class Size(NamedTuple):
    """The size of an image, in pixels."""

    columns: int
    rows: int


_SIZE = Row((Whole(4, 4000), Whole(4, 4000)), Size)


@dataclass(frozen=True, slots=True, kw_only=True)
class Base:
    """The base: drive, dead reckoning and bumpers, as `[body]` describes them."""

    fields: ClassVar[tuple[str, ...]] = (
        "bumper",
        "front_bumper",
        "rear_bumper",
        "x",
        "y",
        "heading",
        "speed",
        "turn_rate",
        "wheel_speed",
        "speed_setting",
        "turn_setting",
    )
    commands: ClassVar[tuple[str, ...]] = ("drive",)


@dataclass(frozen=True, slots=True, kw_only=True)
class Sonar:
    """The sonars of a ring."""

    range_mm: float = entry("range", _RANGE, "the reading without an echo")
    nearest_mm: float = entry("nearest", _SPREAD, "the smallest reading", default=0.0)
    half_beam_deg: float = entry(
        "half_beam",
        Measure(ANGLE, "12 deg", Bounds(low=0.0, high=89.0)),
        "half the opening angle of a transducer's cone",
    )
    critical_deg: float = entry(
        "critical",
        Measure(ANGLE, "30 deg", Bounds(low=0.0, high=90.0)),
        "the angle to the normal beyond which a wall reflects the sound away",
    )
    noise_mm: float = entry("noise", _SPREAD, "standard deviation of an echo", default=0.0)
    noise_fraction: float = entry(
        "noise_fraction", _FRACTION, "what is added to it, as a fraction of the range", default=0.0
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Infrared:
    """The infrared detectors of a ring."""

    range_mm: float = entry("range", _RANGE, "the distance up to which a detector sees something")
    wired: tuple[int, ...] | None = entry(
        "wired",
        Many(Whole(0, MAX_ELEMENTS - 1), 0, MAX_ELEMENTS),
        "the elements that have a detector; the others never see anything [default: all]",
        default=None,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Proximity:
    """A ring of sonars and infrared detectors around the robot's center, one of each along each bearing."""

    fields: ClassVar[tuple[str, ...]] = ("sonar", "infrared")
    commands: ClassVar[tuple[str, ...]] = ()

    count: int = entry("count", _COUNT, "the number of sonars, and of infrared detectors")
    bearing_deg: float = entry("bearing", _DIRECTION, "the direction of element 0")
    step_deg: float | None = entry(
        "step", _STEP, "the angle from each element to the next [default: 360 deg / count]", default=None
    )
    ring_mm: float = entry("ring", _LENGTH, "distance of the transducers from the center; ranges begin there")
    sonar: Sonar = entry("sonar", Table(Sonar), "the sonars")
    infrared: Infrared = entry("infrared", Table(Infrared), "the infrared detectors")

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


@dataclass(frozen=True, slots=True, kw_only=True)
class Lidar:
    """A laser scanner."""

    commands: ClassVar[tuple[str, ...]] = ()

    pose: Pose = entry("pose", _POSE, _POSE_MEANING, default=CENTER)
    field: str = entry(
        "field", Text(NAME, "a name"), "the field that has the ranges [default: scan]", default="scan"
    )
    count: int = entry("count", _COUNT, "the number of beams")
    bearing_deg: float = entry("bearing", _DIRECTION, "the direction of element 0, seen from the robot")
    step_deg: float | None = entry(
        "step", _STEP, "the angle from each beam to the next [default: 360 deg / count]", default=None
    )
    range_mm: float = entry("range", _RANGE, "the longest range")
    noise_mm: float = entry("noise", _SPREAD, "standard deviation of a range", default=0.0)
    dropouts: float = entry(
        "dropouts", _FRACTION, "the part of the beams that stay without echo", default=0.0
    )

    @property
    def fields(self) -> tuple[str, ...]:
        """The fields that the device measures."""
        return (self.field,)

    def bearings(self) -> Bearings | None:
        """Return the bearings of the beams, None if they take more than a turn."""
        return uniform(self.bearing_deg, self.step_deg, self.count)


@dataclass(frozen=True, slots=True, kw_only=True)
class Camera:
    """A level camera: its optical axis is parallel to the floor."""

    fields: ClassVar[tuple[str, ...]] = ()
    commands: ClassVar[tuple[str, ...]] = ()

    pose: Pose = entry("pose", _POSE, _POSE_MEANING, default=CENTER)
    height_mm: float = entry("height", _HEIGHT, "height of the lens above the floor")
    view_deg: float = entry("view", _VIEW, "horizontal angle of view")
    size: Size = entry("size", _SIZE, "columns and rows of the image")


@dataclass(frozen=True, slots=True, kw_only=True)
class CeilingCamera:
    """A camera that looks straight up, with the columns of its image along the direction of travel."""

    fields: ClassVar[tuple[str, ...]] = ()
    commands: ClassVar[tuple[str, ...]] = ()

    below_ceiling_mm: float = entry("below_ceiling", _HEIGHT, "distance of the lens from the ceiling")
    along_deg: float = entry("along", _VIEW, "angle of view along the direction of travel")
    across_deg: float = entry("across", _VIEW, "angle of view across it")
    size: Size = entry("size", _SIZE, "columns and rows of the image")


Device = Base | Proximity | Lidar | Camera | CeilingCamera

DEVICES: tuple[tuple[str, type], ...] = (
    ("base", Base),
    ("proximity", Proximity),
    ("lidar", Lidar),
    ("camera", Camera),
    ("ceiling_camera", CeilingCamera),
)
"""The devices by their names in a body."""
