"""From a model of z3 to what people can read and the interpreter can run: frames, answers, memory."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

import z3

from colony.ir.frame import Reading
from colony.ir.program import Sensor
from colony.ir.types import Array, Bool, Enum, ScalarValue, element_type
from colony.ir.types import Scalar as ScalarType
from colony.verify.reference.boundary import clamp
from colony.verify.symbolic.system import Number, PythonInput, Scalar, SensorInput, Term
from colony.verify.symbolic.unrolling import Unrolling

_DIGITS = 30  # of an algebraic number, more than a float has


@dataclass(frozen=True, slots=True, kw_only=True)
class ConcreteFrame:
    """One frame of a witness.

    `readings` are in base units, as `Interpreter.step_in_base_units` takes them; a sensor that is missing, or
    on which nothing depends, is absent (`free` names the latter). `python` is what modules in Python
    answered: the fields, or None for no command. `cells` is memory before the frame, by the names of cells.
    """

    t_ns: int
    readings: Mapping[str, Reading]
    python: Mapping[str, tuple[ScalarValue, ...] | None]
    cells: Mapping[str, ScalarValue | int]
    free: frozenset[str] = frozenset()


def frames(model: z3.ModelRef, unrolling: Unrolling, count: int) -> tuple[ConcreteFrame, ...]:
    """The first `count` frames of a model of `unrolling`.

    Numbers are the floats nearest to the model's reals, within the sensor's range; times are exact.
    """
    return tuple(_frame(model, unrolling, i) for i in range(count))


def _frame(model: z3.ModelRef, unrolling: Unrolling, i: int) -> ConcreteFrame:
    system, met = unrolling.system, unrolling.cone.visited
    sensors = {s.name: s for s in system.program.robot.sensors}
    readings: dict[str, Reading] = {}
    free = set()
    for name, given in system.sensors.items():
        if not _depends(given, met):
            free.add(name)
        elif _truth(model, unrolling.at(i, given.present)):
            readings[name] = _reading(model, unrolling, i, sensors[name], given)
    python = {
        n: _answer(model, unrolling, i, p) for n, p in system.python.items() if p.answers.get_id() in met
    }
    cells = {c.name: _plain(_evaluated(model, unrolling.at(i, c.old))) for c in unrolling.cone.cells}
    return ConcreteFrame(
        t_ns=_time(model, unrolling, i),
        readings=readings,
        python=python,
        cells=cells,
        free=frozenset(free),
    )


def _time(model: z3.ModelRef, unrolling: Unrolling, i: int) -> int:
    """The time of frame i; frames follow each other by the frame period where nothing depends on time."""
    system = unrolling.system
    if system.now.get_id() not in unrolling.cone.visited:
        return i * system.program.robot.frame_ns
    return int(_rational(_evaluated(model, unrolling.at(i, system.now))))


def _depends(given: SensorInput, met: frozenset[int]) -> bool:
    """Whether anything depends on a sensor."""
    terms = [given.present]
    for x in given.elements:
        terms += [x.infinite] if isinstance(x, Number) else [x]
    values = [x.value for x in given.elements if isinstance(x, Number)]
    return any(term.get_id() in met for term in (*terms, *values) if not z3.is_false(term))


def _reading(model: z3.ModelRef, unrolling: Unrolling, i: int, sensor: Sensor, given: SensorInput) -> Reading:
    of = element_type(sensor.type)
    values = [_sensed(value_in(model, unrolling, i, x), of, sensor) for x in given.elements]
    return tuple(values) if isinstance(sensor.type, Array) else values[0]


def _sensed(x: ScalarValue, of: ScalarType, sensor: Sensor) -> ScalarValue:
    """A value that the sensor can have: what nothing depends on may be anything in a model."""
    if isinstance(of, Enum):
        members = [v for _, v in of.members]
        return x if x in members else members[0]
    return x if isinstance(of, Bool) else clamp(x, sensor.low, sensor.high)


def _answer(
    model: z3.ModelRef, unrolling: Unrolling, i: int, given: PythonInput
) -> tuple[ScalarValue, ...] | None:
    if not _truth(model, unrolling.at(i, given.answers)):
        return None
    return tuple(value_in(model, unrolling, i, x) for x in given.fields)


# --- values --------------------------------------------------------------------------------------


def value_in(model: z3.ModelRef, unrolling: Unrolling, i: int, x: Scalar) -> ScalarValue:
    """What a scalar of the system is in frame i of a model, as the nearest float."""
    if not isinstance(x, Number):
        return _truth(model, unrolling.at(i, x))
    if _truth(model, unrolling.at(i, x.nan)):
        return math.nan
    value = _rational(_evaluated(model, unrolling.at(i, x.value)))
    if _truth(model, unrolling.at(i, x.infinite)):
        return math.inf if value > 0 else -math.inf
    return _nearest(value)


def values_in(
    model: z3.ModelRef, unrolling: Unrolling, i: int, x: Term
) -> ScalarValue | tuple[ScalarValue, ...]:
    """The same of any term; a tuple of an array."""
    if isinstance(x, tuple):
        return tuple(value_in(model, unrolling, i, element) for element in x)
    return value_in(model, unrolling, i, x)


def _evaluated(model: z3.ModelRef, term: z3.ExprRef) -> z3.ExprRef:
    return model.eval(term, model_completion=True)


def _truth(model: z3.ModelRef, term: z3.BoolRef) -> bool:
    return bool(z3.is_true(_evaluated(model, term)))


def _plain(value: z3.ExprRef) -> ScalarValue | int:
    if z3.is_bool(value):
        return bool(z3.is_true(value))
    rational = _rational(value)
    return int(rational) if z3.is_int(value) else _nearest(rational)


def _rational(value: z3.ExprRef) -> Fraction:
    """A numeral of a model; an algebraic one to more digits than a float has."""
    if isinstance(value, z3.AlgebraicNumRef):
        value = value.approx(_DIGITS)
    if isinstance(value, z3.IntNumRef):
        return Fraction(value.as_long())
    assert isinstance(value, z3.RatNumRef), f"{value} is not a number"
    return Fraction(value.numerator_as_long(), value.denominator_as_long())


def _nearest(value: Fraction) -> float:
    """The nearest finite float."""
    try:
        return float(value)
    except OverflowError:
        return math.copysign(_GREATEST, value)


_GREATEST = math.nextafter(math.inf, 0.0)
