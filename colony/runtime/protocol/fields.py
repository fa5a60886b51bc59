"""Interfaces of a robot's servers: fields for sensors and commands for actuators.

Fields of hardware are in base units (mm, s, deg), and are converted to the unit that a program declares: a
sensor in meters `from PServer.sonar` gets meters. Headings, and the numbers of sonars and infrared detectors,
increase counterclockwise; number 12 faces forward. DServer's variables are in the units in which they were
set.
"""

from __future__ import annotations

from dataclasses import dataclass

from colony.ir.types import BOOL, DEGREES, DIMENSIONLESS, DISTANCE, Array, Quantity, Scalar, Type
from colony.text.units import ANGLE, LENGTH, TIME

PROXIMITY_SENSORS = 24
SPEED = Quantity(LENGTH.over(TIME))
TURN_RATE = Quantity(ANGLE.over(TIME))


@dataclass(frozen=True, slots=True)
class FieldSpec:
    """A field of a server's frames; `type` is in base units.

    `has_age` is True if the server says when its value was measured, or measures it for each frame.
    """

    name: str
    type: Type
    meaning: str
    has_age: bool = True


@dataclass(frozen=True, slots=True)
class ParameterSpec:
    """A parameter of a command, in base units; it is 0 if an actuator does not declare it.

    `low` and `high` are the bounds within which the server carries it out, None for none.
    """

    name: str
    type: Scalar
    meaning: str
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True, slots=True)
class CommandSpec:
    """A command of a server, by name, with its parameters in the order in which the server takes them."""

    name: str
    parameters: tuple[ParameterSpec, ...]


@dataclass(frozen=True, slots=True)
class ServerSpec:
    """A server by name. With `accepts_any_name`, it has fields and commands of any name."""

    name: str
    fields: tuple[FieldSpec, ...] = ()
    commands: tuple[CommandSpec, ...] = ()
    accepts_any_name: bool = False


PSERVER = ServerSpec(
    "PServer",
    fields=(
        FieldSpec("sonar", Array(DISTANCE, PROXIMITY_SENSORS), "range of each ultrasonic sensor"),
        FieldSpec(
            "infrared", Array(BOOL, PROXIMITY_SENSORS), "whether each infrared detector sees something"
        ),
    ),
)
"""Interface of the proximity subsystem (thesis section 4.6.2)."""

RSERVER = ServerSpec(
    "RServer",
    fields=(
        FieldSpec("bumper", BOOL, "whether a bumper touches something"),
        FieldSpec("front_bumper", BOOL, "whether the front bumper touches something"),
        FieldSpec("rear_bumper", BOOL, "whether the rear bumper touches something"),
        FieldSpec("x", DISTANCE, "position by dead reckoning, increasing to the east"),
        FieldSpec("y", DISTANCE, "position by dead reckoning, increasing to the north"),
        FieldSpec("heading", DEGREES, "heading by dead reckoning, 0 north, 90 west, in [0, 360)"),
        FieldSpec("speed", SPEED, "measured forward speed, negative backward"),
        FieldSpec("turn_rate", TURN_RATE, "measured turning speed, positive counterclockwise"),
        FieldSpec("wheel_speed", SPEED, "mean of the magnitudes of both wheels' speeds"),
        FieldSpec("speed_setting", SPEED, "the forward speed commanded last"),
        FieldSpec("turn_setting", TURN_RATE, "the turning speed commanded last"),
    ),
    commands=(
        CommandSpec(
            "drive",
            (
                ParameterSpec("velocity", SPEED, "forward speed"),
                ParameterSpec("turn", TURN_RATE, "turning speed, positive counterclockwise"),
            ),
        ),
    ),
)
"""Interface of the base (thesis section 4.6.3, Table 4.1)."""

DSERVER = ServerSpec("DServer", accepts_any_name=True)
"""Interface to the variables that processes share (thesis section 4.6.1); `to DServer.X` sets variable X."""

RUNTIME = ServerSpec(
    "Runtime",
    fields=(FieldSpec("random", DIMENSIONLESS, "uniform in [0, 1), new each frame, from the run's seed"),),
)
"""Interface that every robot has in addition to its hardware."""

SERVERS = (PSERVER, RSERVER, DSERVER, RUNTIME)
