"""Comparison of a verdict with a decision of the reference interpreter."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence

from colony.ir.frame import Decision
from colony.ir.given import MISSED, SentCommand, is_connection
from colony.ir.program import Actuator, in_declared_units
from colony.ir.types import ScalarValue
from colony.verify.reference.interpreter import Interpreter

_COMMANDED = frozenset({"won", "overruled", "overridden", "locked out", "stopped"})
_GATED = frozenset({"suppressed", "inhibited"})
_NOT_ACTIVE = frozenset({"inactive", "silent"})


def objection(
    actuator: Actuator, verdict: SentCommand, expected: Decision, interpreter: Interpreter
) -> str | None:
    """Return a message about a wrong verdict of the network, or None if it is right.

    `expected` is the interpreter's decision; `interpreter` has decided the same frame.
    """
    if verdict.violation:
        return "two clients commanded in one frame"
    if not same_decision(verdict, expected):
        if not is_excused(verdict):
            return "the command sent is not the interpreter's"
        if not is_idle(actuator, verdict):
            return "a client was missing, and neither the interpreter's command nor the idle command was sent"
    clients = (f for f in verdict.fates if not is_connection(f[0]))
    return next(
        (text for text in (_fate_objection(*f, expected, interpreter) for f in clients) if text), None
    )


def outside_objection(actuator: Actuator, verdict: SentCommand, interpreter: Interpreter) -> str | None:
    """Return a message about a command from outside that the program does not allow, or None.

    It must be within the range, and within the limits of the frame, unless they do not hold for that client.
    If the command could not be sent, the actuator must be idle. `interpreter` has decided the same frame.
    """
    if verdict.outside is None:
        return None
    if verdict.fault is not None or verdict.values is None:
        idle = in_declared_units(actuator.idle, actuator.fields)
        if same_values(verdict.values, idle):
            return None
        return "a command from outside could not be sent, and the idle command was not sent"
    ranges = tuple((_or(f.low, -math.inf), _or(f.high, math.inf)) for f in actuator.fields)
    bounds = ranges if verdict.unlimited else interpreter.bounds(actuator)
    if bounds is None:
        return "a command from outside was sent in a frame whose limits allow none"
    for sent, value, (low, high) in zip(actuator.fields, verdict.values, bounds, strict=True):
        if not isinstance(value, bool) and not low / sent.factor <= value <= high / sent.factor:
            least, most = low / sent.factor, high / sent.factor
            allowed = f"at least {least:g}" if value < least else f"at most {most:g}"
            found = f"{sent.name} = {value:g} {sent.unit}; allowed: {allowed} {sent.unit}"
            return f"a command from outside is beyond the limits: found {found}"
    return None


def _or(bound: float | None, otherwise: float) -> float:
    return otherwise if bound is None else bound


def same_decision(verdict: SentCommand, expected: Decision) -> bool:
    """Return True if winner, values and fault are the same, values bit for bit."""
    same = (verdict.by, verdict.fault) == (expected.by, expected.fault)
    return same and same_values(verdict.values, expected.values)


def same_values(a: Sequence[ScalarValue] | None, b: Sequence[ScalarValue] | None) -> bool:
    """Return True if two commands are the same bit for bit: -0.0 is not 0.0."""
    if a is None or b is None:
        return a is b
    return len(a) == len(b) and all(map(_same_bits, a, b))


def _same_bits(a: ScalarValue, b: ScalarValue) -> bool:
    if isinstance(a, bool) or isinstance(b, bool):
        return a is b
    return struct.pack("<d", a) == struct.pack("<d", b)


def is_excused(verdict: SentCommand) -> bool:
    """Return True if a client was late, lost or refused."""
    return any(fate in MISSED for _, fate in verdict.fates)


def is_idle(actuator: Actuator, verdict: SentCommand) -> bool:
    """Return True if no client won and the idle command was sent (nothing, for `idle hold`)."""
    idle = in_declared_units(actuator.idle, actuator.fields)
    return verdict.by is None and verdict.fault is None and same_values(verdict.values, idle)


def _fate_objection(client: str, fate: str, expected: Decision, interpreter: Interpreter) -> str | None:
    """Return a message about a wrong fate of a client, or None if it is right."""
    wins = client == expected.by
    if fate in _COMMANDED and not wins:
        return f"`{client}` commanded, but in the interpreter it does not get through"
    if (fate in _GATED or fate in _NOT_ACTIVE) and wins:
        return f"`{client}` was {fate}, but in the interpreter it gets through"
    if fate in _GATED and not interpreter.is_active(client):
        return f"`{client}` was {fate}, but in the interpreter it is not active"
    if fate in _NOT_ACTIVE and interpreter.is_active(client):
        return f"`{client}` was {fate}, but in the interpreter it is active"
    if fate == "inactive" and interpreter.is_silent(client):
        return f"`{client}` was inactive, but in the interpreter it is silent: it reads something missing"
    return None
