"""What the servers of a robot offer: fields for sensors and commands for actuators.

Fields of hardware are in base units (mm, s, deg), and are converted to the unit that a program declares: a
sensor in meters `from PServer.sonar` gets meters. DServer's variables are in the units in which they were
set. The servers of a robot follow from its body (`colony.body.servers`).
"""

from __future__ import annotations

from dataclasses import dataclass

from colony.ir.types import BOOL, DEGREES, DIMENSIONLESS, DISTANCE, Quantity, Scalar, Type
from colony.text.units import ANGLE, LENGTH, TIME

SPEED = Quantity(LENGTH.over(TIME))
TURN_RATE = Quantity(ANGLE.over(TIME))


@dataclass(frozen=True, slots=True)
class FieldSpec:
    """A field of a server's frames; `type` is in base units.

    Attributes:
        name: its name.
        type: its type.
        meaning: what it is, for users.
        has_age: True if the server says when its value was measured, or measures it for each frame.
        no_echo: what an element without an echo reads; None if a device gives none such.
        hold: True if an invalid element keeps its last value and time; otherwise the array is missing.
        blocked: the elements that the robot's own body blocks, which read `no_echo`.
        factor: the unit of the numbers that a driver gives, in base units; servers send base units.
        is_read: False if the interface has no sensor that reads it: a driver need not give it.
        declared: the unit that the interface declares, which is that of a bare number; "" for base units.
    """

    name: str
    type: Type
    meaning: str
    has_age: bool = True
    no_echo: float | None = None
    hold: bool = False
    blocked: tuple[int, ...] = ()
    factor: float = 1.0
    is_read: bool = True
    declared: str = ""


@dataclass(frozen=True, slots=True)
class ParameterSpec:
    """A parameter of a command, in base units; it is 0 if an actuator does not declare it.

    `low` and `high` are the bounds within which the server carries it out, None for none. `factor` is the
    unit of the numbers that a driver is given, in base units.
    """

    name: str
    type: Scalar
    meaning: str
    low: float | None = None
    high: float | None = None
    factor: float = 1.0


@dataclass(frozen=True, slots=True)
class CommandSpec:
    """A command of a server, by name, with its parameters in the order in which the server takes them.

    `is_bound` is False if the interface has no actuator that sends it: a driver need not have it.
    """

    name: str
    parameters: tuple[ParameterSpec, ...]
    is_bound: bool = True


@dataclass(frozen=True, slots=True)
class ServerSpec:
    """A server by name. With `accepts_any_name`, it has fields and commands of any name."""

    name: str
    fields: tuple[FieldSpec, ...] = ()
    commands: tuple[CommandSpec, ...] = ()
    accepts_any_name: bool = False


RSERVER = ServerSpec(
    "RServer",
    fields=(
        FieldSpec("bumper", BOOL, "true while a bumper touches something"),
        FieldSpec("front_bumper", BOOL, "true while the front bumper touches something"),
        FieldSpec("rear_bumper", BOOL, "true while the rear bumper touches something"),
        FieldSpec("x", DISTANCE, "the position by dead reckoning, increasing to the east"),
        FieldSpec("y", DISTANCE, "the position by dead reckoning, increasing to the north"),
        FieldSpec("heading", DEGREES, "the heading by dead reckoning, 0 north, 90 west, in [0, 360)"),
        FieldSpec("speed", SPEED, "the measured forward speed, negative backward"),
        FieldSpec("turn_rate", TURN_RATE, "the measured turning speed, positive counterclockwise"),
        FieldSpec("wheel_speed", SPEED, "the mean of the magnitudes of the wheels' speeds"),
        FieldSpec("speed_setting", SPEED, "the forward speed commanded last"),
        FieldSpec("turn_setting", TURN_RATE, "the turning speed commanded last"),
    ),
    commands=(
        CommandSpec(
            "drive",
            (
                ParameterSpec("velocity", SPEED, "the forward speed"),
                ParameterSpec("turn", TURN_RATE, "the turning speed, positive counterclockwise"),
            ),
        ),
    ),
)
"""Interface of a base with two driven wheels (thesis section 4.6.3, Table 4.1)."""

_SIDEWAYS = (
    FieldSpec("sideways_speed", SPEED, "the measured sideways speed, positive to the left"),
    FieldSpec("sideways_setting", SPEED, "the sideways speed commanded last"),
)

OMNIDIRECTIONAL_RSERVER = ServerSpec(
    RSERVER.name,
    fields=(*RSERVER.fields, *_SIDEWAYS),
    commands=(
        CommandSpec(
            RSERVER.commands[0].name,
            (
                *RSERVER.commands[0].parameters,
                ParameterSpec("sideways", SPEED, "the sideways speed, positive to the left"),
            ),
        ),
    ),
)
"""Interface of a base that also drives sideways: that of `RSERVER`, and more."""

SIDEWAYS_NAMES = frozenset({"sideways", *(field.name for field in _SIDEWAYS)})
"""The parameter and fields that only a base that drives sideways has."""

DSERVER = ServerSpec("DServer", accepts_any_name=True)
"""Interface to the variables that processes share (thesis section 4.6.1); `to DServer.X` sets variable X."""

RUNTIME = ServerSpec(
    "Runtime",
    fields=(
        FieldSpec("random", DIMENSIONLESS, "a number in [0, 1), new in each frame, from the run's seed"),
    ),
)
"""Interface to chance."""

COMMON_SERVERS = (DSERVER, RUNTIME)
"""The servers that every robot has, and no body describes."""

PROXIMITY = "PServer"
"""Name of the server of a ring of sonars (thesis section 4.6.2)."""

RESERVED_SERVER_NAMES = frozenset(
    {"Clock", "Gateway", "Leader", "Limits", "Observer", "Simulator", "Supervisor", "all", "clients"}
)
"""Names that no server of a body may have: those of other processes, and words of `colony serve`.

They are spelled out because nothing here imports the runtime; a test holds them to its constants.
"""

MAX_SERVER_NAME = 64
"""Maximum number of characters of a server's name, which is part of keys and of file names."""
