"""Descriptions of sensors that are no rangers: battery, bumper, buttons, compass and others."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal, NamedTuple

from colony.body.devices.common import (
    CENTER,
    FIELD_NAME,
    FRACTION,
    MAX_WHEELS,
    POSE,
    POSE_MEANING,
    POSITION,
    POWER,
    RANGE,
    SIZE,
    SPREAD,
    MountPoint,
    MountPose,
    SensorSpec,
)
from colony.body.kinds import (
    NOT_NEGATIVE,
    POSITIVE,
    AllowedRange,
    Amount,
    AnyAmount,
    FixedArray,
    Interval,
    Many,
    Measure,
    NamedTables,
    TableKind,
    Whole,
    WordKind,
    entry,
)
from colony.ir.servers import FieldSpec
from colony.ir.types import (
    BOOL,
    DEGREES,
    DIMENSIONLESS,
    DISTANCE,
    MAX_ELEMENTS,
    Array,
    Enum,
    Quantity,
    Scalar,
    in_unit,
)
from colony.text.units import ANGLE, LENGTH, TIME, Unit
from colony.text.units import POWER as POWER_UNITS

# --- battery ------------------------------------------------------------------------------------------
#
# Batteries.


@dataclass(frozen=True, slots=True, kw_only=True)
class BatterySpec(SensorSpec):
    """A battery, which is charged at a dock of the map or, if the map has none, where the run began."""

    capacity_j: float = entry(
        "capacity", Measure(POWER_UNITS.times(TIME), "500 Wh", POSITIVE), "energy of the full battery"
    )
    start: float = entry(
        "start", FRACTION, "the part that is left when a run begins [default: all]", default=1.0
    )
    standing_w: float = entry("standing", POWER, "power that the robot always takes")
    driving_w: float = entry(
        "driving", POWER, "power that it takes besides at its highest speed; less if it is slower"
    )
    charger_w: float = entry("charger", POWER, "power of the charger [default: none]", default=0.0)
    reach_mm: float = entry(
        "reach", SPREAD, "distance from the charger up to which it charges [default: 200 mm]", default=200.0
    )
    reach_angle_deg: float = entry(
        "reach_angle",
        Measure(ANGLE, "10 deg", AllowedRange(low=0.0, high=180.0)),
        "angle between the headings of robot and charger up to which it charges [default: any]",
        default=180.0,
    )

    @property
    def fields(self) -> tuple[FieldSpec, ...]:
        """The fields that it measures."""
        return (
            FieldSpec("level", DIMENSIONLESS, "the charge that is left, 0 to 1"),
            FieldSpec("charging", BOOL, "true while the charger charges it"),
        )


# --- bumper -------------------------------------------------------------------------------------------
#
# Bumpers by sectors of the hull.


@dataclass(frozen=True, slots=True, kw_only=True)
class BumperSpec(SensorSpec):
    """A bumper that feels in which sectors of the hull something touches the robot."""

    field: str = entry("field", FIELD_NAME, "the field that has them [default: bumper]", default="bumper")
    sectors: tuple[tuple[float, float], ...] = entry(
        "sectors",
        Many(Interval(ANGLE, "-60 deg .. -20 deg"), 1, MAX_ELEMENTS),
        "the bearings of each sector, counterclockwise from the first to the second",
    )

    @property
    def fields(self) -> tuple[FieldSpec, ...]:
        """The fields that it measures."""
        return (
            FieldSpec(
                self.field, Array(BOOL, len(self.sectors)), "true for each sector that something touches"
            ),
        )


# --- button -------------------------------------------------------------------------------------------
#
# Buttons and switches.


@dataclass(frozen=True, slots=True, kw_only=True)
class Button(SensorSpec):
    """Buttons and switches, which `--set` and scenarios press; otherwise they are released."""

    names: tuple[str, ...] = entry("fields", Many(FIELD_NAME, 1, 100), "the fields, one for each button")

    @property
    def fields(self) -> tuple[FieldSpec, ...]:
        """The fields that it measures."""
        return tuple(FieldSpec(name, BOOL, "true while it is pressed") for name in self.names)


# --- cliff --------------------------------------------------------------------------------------------
#
# Sensors that look down.


@dataclass(frozen=True, slots=True, kw_only=True)
class CliffSpec(SensorSpec):
    """Sensors that look down, and see where the ground is missing."""

    field: str = entry("field", FIELD_NAME, "the field that has them [default: cliff]", default="cliff")
    places: tuple[MountPoint, ...] = entry(
        "places",
        Many(FixedArray((POSITION, POSITION), MountPoint), 1, MAX_ELEMENTS),
        "where each sensor looks: x ahead of the robot's center, y to the left of it",
    )

    @property
    def fields(self) -> tuple[FieldSpec, ...]:
        """The fields that it measures."""
        return (FieldSpec(self.field, Array(BOOL, len(self.places)), "true where the ground is missing"),)

    def directions(self) -> tuple[float | None, ...]:
        """Return where each place lies from the robot's center, in degrees; None for one at the center."""
        return tuple(math.degrees(math.atan2(y, x)) if x or y else None for x, y in self.places)


# --- compass ------------------------------------------------------------------------------------------
#
# Compasses.


@dataclass(frozen=True, slots=True, kw_only=True)
class CompassSpec(SensorSpec):
    """A compass, which iron in the building disturbs."""

    noise_deg: float = entry(
        "noise", Measure(ANGLE, "1 deg", NOT_NEGATIVE), "standard deviation of a reading", default=0.0
    )
    offset_deg: float = entry(
        "offset",
        Measure(ANGLE, "2 deg", AllowedRange(low=-360.0, high=360.0)),
        "what is added to each reading, as by a compass that is mounted askew",
        default=0.0,
    )

    @property
    def fields(self) -> tuple[FieldSpec, ...]:
        """The fields that it measures."""
        return (FieldSpec("heading", DEGREES, "the heading, 0 north, 90 west, in [0, 360)"),)


# --- dock sensor --------------------------------------------------------------------------------------
#
# Sensors of charging docks.


@dataclass(frozen=True, slots=True, kw_only=True)
class DockSensorSpec(SensorSpec):
    """A sensor that sees the nearest dock of the map, if no wall hides it."""

    pose: MountPose = entry("pose", POSE, POSE_MEANING, default=CENTER)
    range_mm: float = entry("range", RANGE, "the distance up to which it sees a dock")
    view_deg: float = entry(
        "view",
        Measure(ANGLE, "60 deg", AllowedRange(low=1.0, high=360.0)),
        "angle of view [default: all around]",
        default=360.0,
    )
    noise_mm: float = entry("noise", SPREAD, "standard deviation of the distance", default=0.0)
    bearing_noise_deg: float = entry(
        "bearing_noise",
        Measure(ANGLE, "1 deg", NOT_NEGATIVE),
        "standard deviation of the bearing",
        default=0.0,
    )

    @property
    def fields(self) -> tuple[FieldSpec, ...]:
        """The fields that it measures."""
        return (
            FieldSpec("dock_seen", BOOL, "true while it sees a dock"),
            FieldSpec(
                "dock_distance", DISTANCE, "the distance from the robot's center to the dock that it sees"
            ),
            FieldSpec(
                "dock_bearing", Quantity(ANGLE), "the bearing of that dock, counterclockwise from ahead"
            ),
        )

    @property
    def farthest_mm(self) -> float:
        """The largest distance that it reads."""
        return self.range_mm + math.hypot(self.pose.x_mm, self.pose.y_mm)


# --- encoders -----------------------------------------------------------------------------------------
#
# Encoders of wheels.


@dataclass(frozen=True, slots=True, kw_only=True)
class EncodersSpec(SensorSpec):
    """Encoders of the driven wheels, which dead reckoning is made of."""

    wheels: int = entry("wheels", Whole(2, MAX_WHEELS), "the number of driven wheels [default: 2]", default=2)
    resolution_mm: float = entry(
        "resolution",
        SPREAD,
        "how far a wheel rolls from tick to tick [default: no ticks]",
        default=0.0,
    )

    @property
    def fields(self) -> tuple[FieldSpec, ...]:
        """The fields that it measures."""
        travel = "the distance that each wheel has rolled, negative backward"
        return (FieldSpec("travel", Array(DISTANCE, self.wheels), travel),)


# --- imu ----------------------------------------------------------------------------------------------
#
# Inertial units: gyroscope and accelerometers.

_TURN = ANGLE.over(TIME)
_ACCELERATION = LENGTH.over(TIME).over(TIME)
_TURN_SPREAD = Measure(_TURN, "0.1 deg/s", NOT_NEGATIVE)
_ACCELERATION_SPREAD = Measure(_ACCELERATION, "50 mm/s^2", NOT_NEGATIVE)
_BIAS_MEANING = "standard deviation of its bias, which is drawn once per robot"
_DRIFT_MEANING = "standard deviation of the change of its bias in a minute; it grows as the root of time"


@dataclass(frozen=True, slots=True, kw_only=True)
class TurnErrors:
    """The errors of the turn rate, in deg/s."""

    noise: float = entry("noise", _TURN_SPREAD, "standard deviation of the turn rate", default=0.0)
    bias: float = entry("bias", _TURN_SPREAD, _BIAS_MEANING, default=0.0)
    drift: float = entry("drift", _TURN_SPREAD, _DRIFT_MEANING, default=0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class AccelerationErrors:
    """The errors of both accelerations, in mm/s^2."""

    noise: float = entry("noise", _ACCELERATION_SPREAD, "standard deviation of an acceleration", default=0.0)
    bias: float = entry("bias", _ACCELERATION_SPREAD, _BIAS_MEANING, default=0.0)
    drift: float = entry("drift", _ACCELERATION_SPREAD, _DRIFT_MEANING, default=0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class ImuSpec(SensorSpec):
    """An inertial unit at the robot's center: a gyroscope and accelerometers."""

    turn: TurnErrors = entry(
        "turn", TableKind(TurnErrors), "the errors of the turn rate", default=TurnErrors()
    )
    acceleration: AccelerationErrors = entry(
        "acceleration",
        TableKind(AccelerationErrors),
        "the errors of the accelerations",
        default=AccelerationErrors(),
    )

    @property
    def fields(self) -> tuple[FieldSpec, ...]:
        """The fields that it measures."""
        acceleration = Quantity(_ACCELERATION)
        return (
            FieldSpec("turn_rate", Quantity(_TURN), "the turn rate, positive counterclockwise"),
            FieldSpec("acceleration", acceleration, "the acceleration ahead"),
            FieldSpec("sideways_acceleration", acceleration, "the acceleration to the left"),
            FieldSpec(
                "heading",
                DEGREES,
                "the heading at which the run began and the sum of all turns, 0 north, 90 west, in [0, 360)",
            ),
        )


# --- value --------------------------------------------------------------------------------------------
#
# Values of one's own: constants, noise, and what is painted over the map.

_AMOUNT = AnyAmount("20 percent")


class PaintedCircle(NamedTuple):
    """A circle of the map in which a field has another value; in mm."""

    x_mm: float
    y_mm: float
    radius_mm: float
    amount: Amount


class PaintedRectangle(NamedTuple):
    """A rectangle of the map, from one corner to the opposite one, in which a field has another value."""

    x0_mm: float
    y0_mm: float
    x1_mm: float
    y1_mm: float
    amount: Amount


@dataclass(frozen=True, slots=True, kw_only=True)
class ValueField:
    """A field of such a device."""

    amount: Amount = entry("value", _AMOUNT, "the value: a number with its unit, a bool, or one of `members`")
    members: tuple[str, ...] = entry(
        "members", Many(FIELD_NAME, 0, 100), "the members of an enum, numbered from 0", default=()
    )
    noise: Amount | None = entry("noise", _AMOUNT, "standard deviation of a reading", default=None)
    rectangles: tuple[PaintedRectangle, ...] = entry(
        "rectangles",
        Many(FixedArray((POSITION, POSITION, POSITION, POSITION, _AMOUNT), PaintedRectangle), 0, 1000),
        "rectangles of the map: x and y of two opposite corners, and the value inside; the last one counts",
        default=(),
    )
    circles: tuple[PaintedCircle, ...] = entry(
        "circles",
        Many(FixedArray((POSITION, POSITION, SIZE, _AMOUNT), PaintedCircle), 0, 1000),
        "circles of the map, over the rectangles: x, y, radius, and the value inside; the last one counts",
        default=(),
    )
    edge: Literal["sharp", "fading"] = entry(
        "edge",
        WordKind(("sharp", "fading")),
        "whether the value of a circle ends at its edge, or fades from its center to what is around it "
        "[default: sharp]",
        default="sharp",
    )

    @property
    def amounts(self) -> Iterator[tuple[str, Amount]]:
        """All values that it may have, each with its key."""
        yield "value", self.amount
        yield from (("rectangles", painted.amount) for painted in self.rectangles)
        yield from (("circles", painted.amount) for painted in self.circles)

    def type_named(self, name: str) -> Scalar:
        """Return the type of the field, which has this name."""
        match self.amount.value:
            case bool():
                return BOOL
            case str():
                return Enum(name, tuple((member, float(i)) for i, member in enumerate(self.members)))
            case _:
                return in_unit(Unit(self.amount.unit, self.amount.dimension, Fraction(1)))


@dataclass(frozen=True, slots=True, kw_only=True)
class ValuesSpec(SensorSpec):
    """Values of your own: constant, with noise, or painted over the map; scenarios change them."""

    values: Mapping[str, ValueField] = entry(
        "values", NamedTables(TableKind(ValueField)), "the fields by name"
    )

    @property
    def fields(self) -> tuple[FieldSpec, ...]:
        """The fields that it measures."""
        meaning = "the value that the body describes"
        return tuple(FieldSpec(name, value.type_named(name), meaning) for name, value in self.values.items())
