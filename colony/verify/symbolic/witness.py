"""The snapshots of a z3 model: its readings and answers as the interpreter takes them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from fractions import Fraction

import z3

from colony.ir.frame import Given
from colony.ir.program import Sensor
from colony.ir.types import Array, Bool, Enum, ScalarValue, Value, element_type
from colony.ir.types import Scalar as ScalarType
from colony.verify.reference.boundary import clamp
from colony.verify.snapshot import Snapshot
from colony.verify.symbolic.logic import is_false
from colony.verify.symbolic.system import DisturbanceInputs, Number, Scalar, SensorInput
from colony.verify.symbolic.unrolling import Unrolling

_DIGITS = 30  # of approximations of algebraic numbers; more than a float has


def snapshots(
    model: z3.ModelRef, unrolling: Unrolling, count: int, late: DisturbanceInputs | None = None
) -> tuple[Snapshot, ...]:
    """Return the first `count` frames of a model of `unrolling`, with what is late in them.

    Numbers are the floats nearest to the model's reals, within the sensor's range; times are exact. A sensor
    is missing if nothing depends on it.
    """
    frames = (_snapshot(model, unrolling, i) for i in range(count))
    if late is None:
        return tuple(frames)
    return tuple(_with_late(frame, model, unrolling, i, late) for i, frame in enumerate(frames))


def _with_late(
    snapshot: Snapshot, model: z3.ModelRef, unrolling: Unrolling, i: int, late: DisturbanceInputs
) -> Snapshot:
    """Return a frame with the actuators that are idle and the modules that are lost in it."""

    def holding(conditions: Mapping[str, z3.BoolRef]) -> list[str]:
        visited = unrolling.cone.visited
        return [
            name
            for name, condition in conditions.items()
            if condition.get_id() in visited and _truth(model, unrolling.at(i, condition))
        ]

    given = {actuator: Given() for actuator in holding(late.idle)}
    return snapshot._replace(given=given, lost=frozenset(holding(late.lost)))


def _snapshot(model: z3.ModelRef, unrolling: Unrolling, i: int) -> Snapshot:
    system, visited = unrolling.system, unrolling.cone.visited
    sensors = {s.name: s for s in system.program.robot.sensors}
    readings: dict[str, Value | None] = {
        name: _reading(model, unrolling, i, sensors[name], sensor_input)
        for name, sensor_input in system.sensors.items()
        if _is_used(sensor_input, visited) and _truth(model, unrolling.at(i, sensor_input.present))
    }
    for name, sensor_input in system.sensors.items():
        if name not in readings and sensors[name].sent is not None and _is_used(sensor_input, visited):
            readings[name] = None  # without it, it would be what the program itself sent
    answers: dict[str, tuple[ScalarValue, ...] | None] = {}
    for name, python_input in system.python.items():
        if python_input.blind.get_id() in visited and _truth(model, unrolling.at(i, python_input.blind)):
            answers[name] = None
        elif python_input.answers.get_id() in visited and _truth(
            model, unrolling.at(i, python_input.answers)
        ):
            answers[name] = tuple(value_in(model, unrolling, i, x) for x in python_input.fields)
    restarted = system.restarted.get_id() in visited and _truth(model, unrolling.at(i, system.restarted))
    return Snapshot(_time_ns(model, unrolling, i), readings, answers, restarted)


def _time_ns(model: z3.ModelRef, unrolling: Unrolling, i: int) -> int:
    """Return the time of frame i; frames are one period apart if nothing depends on time."""
    system = unrolling.system
    if system.now.get_id() not in unrolling.cone.visited:
        return i * system.program.robot.frame_ns
    return int(_rational(_evaluated(model, unrolling.at(i, system.now))))


def _is_used(sensor_input: SensorInput, visited: frozenset[int]) -> bool:
    """Return True if any formula in the cone depends on the sensor."""
    terms = [sensor_input.present]
    for x in sensor_input.elements:
        terms += [x.infinite] if isinstance(x, Number) else [x]
    values = [x.value for x in sensor_input.elements if isinstance(x, Number)]
    return any(term.get_id() in visited for term in (*terms, *values) if not z3.is_false(term))


def _reading(
    model: z3.ModelRef, unrolling: Unrolling, i: int, sensor: Sensor, sensor_input: SensorInput
) -> Value:
    type_ = element_type(sensor.type)
    known: dict[int, tuple[z3.ExprRef, float]] = {}
    values = [
        _valid_value(value_in(model, unrolling, i, x, known), type_, sensor) for x in sensor_input.elements
    ]
    return tuple(values) if isinstance(sensor.type, Array) else values[0]


def _valid_value(x: ScalarValue, type_: ScalarType, sensor: Sensor) -> ScalarValue:
    """Return a value that the sensor can have: a model is arbitrary where nothing depends on it."""
    if isinstance(type_, Enum):
        members = [v for _, v in type_.members]
        return x if x in members else members[0]
    return x if isinstance(type_, Bool) else clamp(x, sensor.low, sensor.high)


# --- values --------------------------------------------------------------------------------------


def value_in(
    model: z3.ModelRef,
    unrolling: Unrolling,
    i: int,
    x: Scalar,
    known: dict[int, tuple[z3.ExprRef, float]] | None = None,
) -> ScalarValue:
    """Return the value of a scalar of the system in frame i of a model, as the nearest float.

    `known` keeps numerals and their floats by id: most of the elements of an array are equal.
    """
    if not isinstance(x, Number):
        return _truth(model, unrolling.at(i, x))
    if not is_false(x.nan) and _truth(model, unrolling.at(i, x.nan)):
        return math.nan
    numeral = _evaluated(model, unrolling.at(i, x.value))
    if not is_false(x.infinite) and _truth(model, unrolling.at(i, x.infinite)):
        return math.inf if _rational(numeral) > 0 else -math.inf
    known = {} if known is None else known
    key = numeral.get_id()
    if key not in known:
        known[key] = numeral, _nearest_float(_rational(numeral))
    return known[key][1]


def _evaluated(model: z3.ModelRef, term: z3.ExprRef) -> z3.ExprRef:
    return model.eval(term, model_completion=True)


def _truth(model: z3.ModelRef, term: z3.BoolRef) -> bool:
    return bool(z3.is_true(_evaluated(model, term)))


def _rational(value: z3.ExprRef) -> Fraction:
    """Return a numeral of a model; an algebraic number is rounded, to more digits than a float has."""
    if isinstance(value, z3.AlgebraicNumRef):
        value = value.approx(_DIGITS)
    if isinstance(value, z3.IntNumRef):
        return Fraction(value.as_long())
    assert isinstance(value, z3.RatNumRef), f"{value} is not a number"
    return Fraction(value.numerator_as_long(), value.denominator_as_long())


def _nearest_float(value: Fraction) -> float:
    """Return the nearest finite float."""
    try:
        return float(value)
    except OverflowError:
        return _MAX_FLOAT if value > 0 else -_MAX_FLOAT


_MAX_FLOAT = math.nextafter(math.inf, 0.0)
