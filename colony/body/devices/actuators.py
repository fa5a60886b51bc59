"""Descriptions of actuators: the base, joints, outputs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

from colony.body.devices.common import DIRECTION, POSITION
from colony.body.kinds import NOT_NEGATIVE, POSITIVE, Interval, Measure, NamedTables, WordKind, entry
from colony.ir.servers import (
    OMNIDIRECTIONAL_RSERVER,
    RSERVER,
    SPEED,
    TURN_RATE,
    CommandSpec,
    FieldSpec,
    ParameterSpec,
)
from colony.ir.types import BOOL, DIMENSIONLESS, DISTANCE, Enum, Quantity, Scalar
from colony.text.units import ANGLE, LENGTH, MASS, TIME

# --- base ---------------------------------------------------------------------------------------------
#
# The base of a robot.


@dataclass(frozen=True, slots=True, kw_only=True)
class BaseSpec:
    """The base: drive, dead reckoning and bumpers, as `[body]` describes them."""

    @property
    def fields(self) -> tuple[FieldSpec, ...]:
        """The fields that it measures."""
        return RSERVER.fields

    @property
    def commands(self) -> tuple[CommandSpec, ...]:
        """The commands that it takes."""
        return RSERVER.commands


@dataclass(frozen=True, slots=True, kw_only=True)
class OmnidirectionalBase(BaseSpec):
    """A base that drives sideways, too."""

    @property
    def fields(self) -> tuple[FieldSpec, ...]:
        """The fields that it measures."""
        return OMNIDIRECTIONAL_RSERVER.fields

    @property
    def commands(self) -> tuple[CommandSpec, ...]:
        """The commands that it takes."""
        return OMNIDIRECTIONAL_RSERVER.commands


# --- joint --------------------------------------------------------------------------------------------
#
# Joints: what goes to a position and stays there, or runs at a velocity.

Control = Literal["position", "velocity"]
"""The quantity by which a joint is commanded."""

_CONTROL = WordKind(("position", "velocity"))
_CONTROL_MEANING = "what it is commanded by: it goes to a position, or runs at a velocity [default: position]"
_LOAD = Measure(MASS, "20 kg", NOT_NEGATIVE)
_LOAD_MEANING = "the mass that it carries [default: none]"
_POSITIONS_MEANING = (
    "the positions that it can be sent to, by name; the command then takes an enum of these names, "
    "numbered from 0 [default: any within the range]"
)


class _Joint:
    """What joints have in common; a position is a quantity `of` some dimension."""

    __slots__ = ()
    of: ClassVar[Scalar]
    of_velocity: ClassVar[Scalar]
    ends: tuple[float, float]
    speed: float
    control: Control
    positions: Mapping[str, float]

    @property
    def fields(self) -> tuple[FieldSpec, ...]:
        """The fields that it measures."""
        state = FieldSpec("target", self._target, "the target of the last command, as it acknowledged")
        if self.control == "velocity":
            state = FieldSpec("velocity", self.of_velocity, "the velocity, 0 at an end")
        return (
            FieldSpec("position", self.of, "the position"),
            state,
            FieldSpec("moving", BOOL, "true while it is on its way"),
            FieldSpec("load", Quantity(MASS), "the mass that it carries"),
            FieldSpec("lower_end", BOOL, "true while it is at its lower end"),
            FieldSpec("upper_end", BOOL, "true while it is at its upper end"),
        )

    @property
    def commands(self) -> tuple[CommandSpec, ...]:
        """The commands that it takes."""
        if self.control == "velocity":
            meaning = "the velocity until an end, 0 to stop"
            velocity = ParameterSpec("velocity", self.of_velocity, meaning, low=-self.speed, high=self.speed)
            return (CommandSpec("run", (velocity,)),)
        low, high = (None, None) if self.positions else self.ends
        position = ParameterSpec("position", self._target, "the position to go to", low=low, high=high)
        return (CommandSpec("move", (position,)),)

    @property
    def _target(self) -> Scalar:
        """The type of a target: that of the position, or an enum of the positions."""
        if not self.positions:
            return self.of
        return Enum("position", tuple((name, float(number)) for number, name in enumerate(self.positions)))


@dataclass(frozen=True, slots=True, kw_only=True)
class JointSpec(_Joint):
    """A joint that moves along a line, such as a lift."""

    of: ClassVar[Scalar] = DISTANCE
    of_velocity: ClassVar[Scalar] = SPEED
    ends: tuple[float, float] = entry(
        "range", Interval(LENGTH, "0 mm .. 400 mm"), "its ends; it begins at the lower one"
    )
    speed: float = entry("speed", Measure(LENGTH.over(TIME), "50 mm/s", POSITIVE), "how fast it moves")
    control: Control = entry("control", _CONTROL, _CONTROL_MEANING, default="position")
    positions: Mapping[str, float] = entry("positions", NamedTables(POSITION), _POSITIONS_MEANING, default={})
    load: float = entry("load", _LOAD, _LOAD_MEANING, default=0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class RotaryJoint(_Joint):
    """A joint that turns, such as the pan of a camera."""

    of: ClassVar[Scalar] = Quantity(ANGLE)
    of_velocity: ClassVar[Scalar] = TURN_RATE
    ends: tuple[float, float] = entry(
        "range", Interval(ANGLE, "-90 deg .. 90 deg"), "its ends; it begins at the one nearest to 0"
    )
    speed: float = entry("speed", Measure(ANGLE.over(TIME), "60 deg/s", POSITIVE), "how fast it turns")
    control: Control = entry("control", _CONTROL, _CONTROL_MEANING, default="position")
    positions: Mapping[str, float] = entry(
        "positions", NamedTables(DIRECTION), _POSITIONS_MEANING, default={}
    )
    load: float = entry("load", _LOAD, _LOAD_MEANING, default=0.0)


# --- output -------------------------------------------------------------------------------------------
#
# Outputs: lamps, horns, valves.

OutputKind = Literal["on", "level"]
"""The kind of an output: it is on or off, or has a level from 0 to 1."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Output:
    """Outputs that stay as they are set, such as lamps, horns and valves."""

    outputs: Mapping[str, OutputKind] = entry(
        "outputs",
        NamedTables(WordKind(("on", "level"))),
        "the outputs by name: one that is on or off, or has a level from 0 to 1",
    )

    @property
    def fields(self) -> tuple[FieldSpec, ...]:
        """The fields that it measures."""
        return tuple(
            FieldSpec(name, BOOL, "true while it is on")
            if kind == "on"
            else FieldSpec(name, DIMENSIONLESS, "the level, 0 to 1")
            for name, kind in self.outputs.items()
        )

    @property
    def commands(self) -> tuple[CommandSpec, ...]:
        """The commands that it takes."""
        return (CommandSpec("set", tuple(_parameter(*item) for item in self.outputs.items())),)


def _parameter(name: str, kind: OutputKind) -> ParameterSpec:
    if kind == "on":
        return ParameterSpec(name, BOOL, "true to switch it on")
    return ParameterSpec(name, DIMENSIONLESS, "the level, 0 to 1", low=0.0, high=1.0)
