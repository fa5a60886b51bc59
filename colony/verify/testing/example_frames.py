"""Conversion of a `test` block to frames for any executor."""

from __future__ import annotations

from collections.abc import Iterator

from colony.ir.frame import Frame, Reading
from colony.ir.program import Example, Given, Program, Sensor
from colony.ir.types import Array, Value
from colony.verify.snapshot import Snapshot


def snapshots_of(program: Program, example: Example) -> tuple[Snapshot, ...]:
    """Return the snapshots of an example, one per frame.

    Assignments to elements of a missing array are left out, as are the expectations.
    """
    return tuple(
        Snapshot(t_ns, {name: value for name, value in given.items() if value is not None})
        for t_ns, given in _given(program, example)
    )


def frames_of(program: Program, example: Example) -> tuple[Frame, ...]:
    """Return the same frames in declared units."""
    factors = {s.name: s.factor for s in program.robot.sensors}
    return tuple(
        Frame(t_ns, {name: _declared(value, factors[name]) for name, value in given.items()})
        for t_ns, given in _given(program, example)
    )


def _given(program: Program, example: Example) -> Iterator[tuple[int, dict[str, Value | None]]]:
    sensors = {s.name: s for s in program.robot.sensors}
    readings: dict[str, Value | None] = {}
    for step in example.steps:
        for given in step.given:
            readings[given.sensor] = assigned(sensors[given.sensor], given, readings.get(given.sensor))
        yield from ((t_ns, dict(readings)) for t_ns in step.times_ns)


def assigned(sensor: Sensor, given: Given, before: Value | None) -> Value | None:
    """Return a sensor's value after an assignment; setting an element of a missing array has no effect."""
    value = given.value
    if isinstance(value, tuple) or value is None:
        return value
    if given.index is None:
        return (value,) * sensor.type.size if isinstance(sensor.type, Array) else value
    if not isinstance(before, tuple):
        return before
    return (*before[: given.index], value, *before[given.index + 1 :])


def _declared(value: Value | None, factor: float) -> Reading:
    if isinstance(value, tuple):
        return tuple(x if isinstance(x, bool) else x / factor for x in value)
    return value if value is None or isinstance(value, bool) else value / factor
