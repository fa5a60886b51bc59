"""The inputs of a frame: time, sensors, and the answers of modules in Python."""

from __future__ import annotations

from fractions import Fraction
from typing import assert_never, cast

import z3

from colony.ir.program import Actuator, Program, PythonModule, Robot, Sensor, gaps_ns
from colony.ir.types import Array, Bool, Enum, Quantity, element_type
from colony.ir.types import Scalar as ScalarType
from colony.verify.reference.boundary import default_of
from colony.verify.symbolic.bounding import within
from colony.verify.symbolic.builder import SymbolicValues, SystemBuilder
from colony.verify.symbolic.expressions import constant_term
from colony.verify.symbolic.logic import FALSE, TRUE, all_of, any_of, choice, implied, integer, negation
from colony.verify.symbolic.memory import enumerator
from colony.verify.symbolic.numbers import select
from colony.verify.symbolic.system import (
    UNBOUNDED,
    ExtendedReal,
    Inexact,
    NumberBounds,
    PythonInput,
    Reason,
    Scalar,
    SensorInput,
)


def begin(robot: Robot, builder: SystemBuilder) -> SymbolicValues:
    """Begin the encoding of a frame with its time: 0 in the first frame, then increasing as the robot says.

    Only in the first frame, in which all memory is initial, `restarted` may be true.
    """
    now, restarted = z3.Int("now"), z3.Bool("restarted")
    begun_name, last_name = builder.name("begun"), builder.name("last")
    begun = cast(z3.BoolRef, builder.open_cell(begun_name, z3.BoolSort(), FALSE))
    last = cast(z3.ArithRef, builder.open_cell(last_name, z3.IntSort(), integer(0)))
    builder.close_cell(begun_name, TRUE)
    builder.close_cell(last_name, now)
    shortest, longest = gaps_ns(robot)
    later = [cast(z3.BoolRef, now >= last + integer(shortest))]
    later += [] if longest is None else [cast(z3.BoolRef, now <= last + integer(longest))]
    builder.assume(now, choice(begun, all_of(later), cast(z3.BoolRef, now == 0)))
    builder.assume(restarted, implied(restarted, negation(begun)))
    builder.invariant(last, cast(z3.BoolRef, last >= 0))
    builder.invariant(last, z3.Or(begun, last == 0))
    return SymbolicValues(now=now, begun=begun, last=last, restarted=restarted)


# --- sensors -------------------------------------------------------------------------------------


def sense(program: Program, builder: SystemBuilder, frame_values: SymbolicValues) -> dict[str, SensorInput]:
    """Encode every sensor: in range and of its type if present, else its default or missing."""
    inputs = {}
    for sensor in program.robot.sensors:
        present = z3.Bool(f"{sensor.name}?")
        inputs[sensor.name] = sensor_input = SensorInput(present=present, elements=_elements(sensor, builder))
        default = default_of(sensor)
        frame_values.present[sensor.name] = present
        frame_values.missing[sensor.name] = negation(present) if default is None else FALSE
        values = sensor_input.elements
        if default is not None:
            defaults = default if isinstance(default, tuple) else (default,)
            values = tuple(
                select(present, x, constant_term(d))
                for x, d in zip(sensor_input.elements, defaults, strict=True)
            )
        frame_values.sensors[sensor.name] = values if isinstance(sensor.type, Array) else values[0]
    return inputs


def _elements(sensor: Sensor, builder: SystemBuilder) -> tuple[Scalar, ...]:
    type_ = element_type(sensor.type)
    size = sensor.type.size if isinstance(sensor.type, Array) else 0
    names = [f"{sensor.name}[{i}]" for i in range(size)] if size else [sensor.name]
    return tuple(_reading(name, type_, sensor, builder) for name in names)


def _reading(name: str, type_: ScalarType, sensor: Sensor, builder: SystemBuilder) -> Scalar:
    """Return a reading of a type: never NaN, and infinite only if the range allows it.

    What was sent is finite.
    """
    low, high = sensor.low, sensor.high
    match type_:
        case Bool():
            return z3.Bool(name)
        case Enum():
            return enumerator_input(name, type_, builder)
        case Quantity():
            value = z3.Real(name)
            bounds = bounds_of(low, high)
            if sensor.sent is not None or (low is not None and high is not None):
                return finite_input(name, bounds, builder)
            infinite = z3.Bool(f"{name}.infinite")
            number = ExtendedReal(value, FALSE, infinite, bounds)
            builder.assume(value, within(number, bounds))
            builder.assume(value, implied(infinite, _beyond(value, low, high)))
            return number
        case _:
            assert_never(type_)


def finite_input(name: str, bounds: NumberBounds, builder: SystemBuilder) -> ExtendedReal:
    """Return a free input that is a finite number within bounds."""
    number = ExtendedReal(z3.Real(name), FALSE, FALSE, bounds)
    builder.assume(number.value, within(number, bounds))
    return number


def bounds_of(low: float | None, high: float | None) -> NumberBounds:
    """Return the bounds of a range."""
    return NumberBounds(None if low is None else Fraction(low), None if high is None else Fraction(high))


def _beyond(value: z3.ArithRef, low: float | None, high: float | None) -> z3.BoolRef:
    """Return the condition that an infinite reading is on an unbounded side of the range."""
    up = (cast(z3.BoolRef, value == 1),) if high is None else ()
    down = (cast(z3.BoolRef, value == -1),) if low is None else ()
    return any_of((*up, *down))


def enumerator_input(name: str, type_: Enum, builder: SystemBuilder) -> ExtendedReal:
    """Return a free input that is one of the members of an enum."""
    value = z3.Real(name)
    member = enumerator(value, type_)
    builder.assume(value, any_of(condition for _, condition in member.cases))
    return member


# --- modules in Python ---------------------------------------------------------------------------


def python_answers(module: PythonModule, actuator: Actuator | None, builder: SystemBuilder) -> PythonInput:
    """Return an arbitrary answer of `step`: nothing, or fields of their types, including NaN, or none."""
    answers = z3.Bool(f"{module.name}.answers")
    blind = z3.Bool(f"{module.name}.blind") if module.failsafe else FALSE
    fields = actuator.fields if actuator else ()
    values = tuple(_answer(f"{module.name}.{f.name}", f.type, builder) for f in fields)
    text = f"`{module.name}` is written in Python: it may answer anything"
    reason = Reason(Inexact.PYTHON, module.span, text)
    builder.mark_inexact(answers, reason)
    if module.failsafe:
        builder.mark_inexact(blind, reason)
    for x in values:
        for term in (x.value, x.nan, x.infinite) if isinstance(x, ExtendedReal) else (x,):
            builder.mark_inexact(term, reason)
    return PythonInput(answers=answers, blind=blind, fields=values)


def _answer(name: str, type_: ScalarType, builder: SystemBuilder) -> Scalar:
    match type_:
        case Bool():
            return z3.Bool(name)
        case Enum():
            return enumerator_input(name, type_, builder)
        case Quantity():
            value, nan, infinite = z3.Real(name), z3.Bool(f"{name}.nan"), z3.Bool(f"{name}.infinite")
            builder.assume(value, implied(infinite, z3.Or(value == 1, value == -1)))
            return ExtendedReal(value, nan, infinite, UNBOUNDED)
        case _:
            assert_never(type_)
