"""Inertial units: gyroscope and accelerometers."""

from __future__ import annotations

from dataclasses import dataclass

from colony.body.devices.common import Sensor
from colony.body.kinds import NOT_NEGATIVE, Measure, Table, entry
from colony.ir.servers import FieldSpec
from colony.ir.types import DEGREES, Quantity
from colony.text.units import ANGLE, LENGTH, TIME

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
class Imu(Sensor):
    """An inertial unit at the robot's center: a gyroscope and accelerometers."""

    turn: TurnErrors = entry("turn", Table(TurnErrors), "the errors of the turn rate", default=TurnErrors())
    acceleration: AccelerationErrors = entry(
        "acceleration",
        Table(AccelerationErrors),
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
