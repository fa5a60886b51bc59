"""The conditions on which an answer rests, each with the values that decided it.

A condition is data: `text.py` makes sentences of it. Times are in nanoseconds, on
the clock of the frames; None where the run does not show it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Absence = Literal["no reading", "too old", "from the future", "faulty", "server down"]
"""The reason why a sensor is missing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """A comparison of two numbers: `condition` as written, the values of both sides, and the distance.

    `left` and `right` are values with their units. `gap` is the distance between them, None where it is not
    finite or says nothing, as for enumerators. `detail` names the inputs that decided: `at [15 deg]`.
    """

    condition: str
    left: str
    right: str
    gap: str | None = None
    detail: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class SimpleCondition:
    """A condition without parts: `condition` as written, with the values of what it reads as `detail`."""

    condition: str
    detail: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class ConstantCondition:
    """A condition that is always the same."""

    condition: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Remembered:
    """A state, or what a memory function remembers.

    `condition` is the state or call as written, `value` what is remembered, and `since_ns` when it was set.
    """

    condition: str
    value: str
    since_ns: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Past:
    """The part of a `recently` or `sustained` before this frame.

    For `recently`, `at_ns` is the last time before the frame at which the argument was true. For `sustained`
    it is the time since which the argument is true. None: never, or not. `elapsed_ns` is the time between
    that and the frame.
    """

    function: Literal["recently", "sustained"]
    condition: str
    duration_ns: int
    at_ns: int | None
    elapsed_ns: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Present:
    """A sensor that has a value, or, if the condition does not hold, is missing since `since_ns`.

    `why` is the reason; `within_ns` is the greatest age of a reading. `since_ns` is None if the sensor has
    not had a value since the run, or what is known of it, began.
    """

    sensor: str
    server: str
    why: Absence | None = None
    since_ns: int | None = None
    within_ns: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class UnknownCondition:
    """A condition that cannot be evaluated, because the sensors `missing`, or other values, are missing."""

    condition: str
    missing: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class TimeConstant:
    """A suppressor or inhibitor that still dominates: `dominant` was last active at `at_ns`."""

    dominant: str
    window_ns: int
    at_ns: int | None
    elapsed_ns: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Answered:
    """The answer of a module in Python: it commands, does not, failed (`error`), or has no answer."""

    module: str
    error: bool = False
    blind: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Heard:
    """The request of a client, which its server heard in time; else its `fate`: late, lost or refused."""

    module: str
    fate: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Undisturbed:
    """The network alone decides; else a connection from outside commands, or a stop or lock holds.

    `outside` is that connection, `hold` is "stopped" or "locked".
    """

    actuator: str
    outside: str | None = None
    hold: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Sendable:
    """The command of a module, which can be sent; else the `fault` for which the idle command is sent."""

    actuator: str
    module: str
    fault: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Unwired:
    """The wiring lets no command of `module`, or of any module, through to the actuator."""

    actuator: str
    module: str | None = None


Cause = (
    Comparison
    | SimpleCondition
    | ConstantCondition
    | Remembered
    | Past
    | Present
    | UnknownCondition
    | TimeConstant
    | Answered
    | Heard
    | Undisturbed
    | Sendable
    | Unwired
)

Subject = Literal["module", "predicate", "let", "wire", "winner", "dominated", "memory", "condition"]
"""The kind of thing that a group of conditions is about."""
