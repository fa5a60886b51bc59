"""Drawn frames in which actuators are given something else than the network decided."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple, assert_never

from colony.ir.frame import NOTHING_GIVEN, Frame, Given, Outcome
from colony.ir.program import Actuator, ActuatorField, Program, modules_that_can_be_lost
from colony.ir.types import Bool, Enum, Quantity, ScalarValue
from colony.verify.reference.interpreter import Interpreter
from colony.verify.testing.frames import Choices

_LARGE = 1000.0
"""Maximum distance from its finite bound of a drawn field whose other bound is infinite."""


class DisturbedFrame(NamedTuple):
    """A frame, what actuators were given in it, the clients lost in it, and the interpreter's outcome."""

    frame: Frame
    given: dict[str, Given]
    lost: frozenset[str]
    outcome: Outcome


def disturbed_run(
    choices: Choices, program: Program, trace: tuple[Frame, ...], *, operators: bool
) -> Iterator[DisturbedFrame]:
    """Yield the frames of a run of the interpreter in which clients are late or lost.

    With `operators`, commands from outside the network are drawn as well, within the bounds of their frame.
    Modules in Python are called.
    """
    undisturbed, interpreter = Interpreter(program), Interpreter(program)
    can_be_lost = modules_that_can_be_lost(program)
    sent = {sensor.name: sensor.sent for sensor in program.robot.sensors if sensor.sent is not None}
    last: dict[str, ScalarValue] = {}
    for frame in trace:
        # bounds depend on what actuators were given before, not on what they are given in this frame
        undisturbed.step(frame._replace(readings={**last, **frame.readings}))
        given = {
            a.name: _given(choices, a, undisturbed, operators=operators)
            for a in program.robot.actuators
            if choices.one_in(2)
        }
        lost = frozenset(m for m in can_be_lost if choices.one_in(4))
        outcome = interpreter.step(frame, lost, given=given or NOTHING_GIVEN)
        for name, (actuator, index) in sent.items():
            values = outcome.commands[actuator].values
            if values is not None:
                last[name] = values[index]
        yield DisturbedFrame(frame, given, lost, outcome)


def _given(choices: Choices, actuator: Actuator, interpreter: Interpreter, *, operators: bool) -> Given:
    bounds = interpreter.bounds(actuator)
    if not operators or bounds is None or choices.one_in(3):
        return Given()
    fields = zip(actuator.fields, bounds, strict=True)
    return Given(tuple(_value(choices, field, *between) for field, between in fields))


def _value(choices: Choices, field: ActuatorField, low: float, high: float) -> ScalarValue:
    match field.type:
        case Bool():
            return choices.one_in(2)
        case Enum(members=members):
            return choices.pick(members)[1]
        case Quantity():
            least = low if math.isfinite(low) else min(high, 0.0) - _LARGE
            most = high if math.isfinite(high) else max(low, 0.0) + _LARGE
            inside = least + (most - least) * choices.up_to(64) / 64
            return choices.pick((least, most, min(max(0.0, least), most), min(max(inside, least), most)))
        case _:
            assert_never(field.type)
