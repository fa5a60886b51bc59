"""The frames of a `test` block, as frames that any executor takes."""

from __future__ import annotations

from colony.ir.frame import Frame, Reading
from colony.ir.program import Example, Given, Program, Sensor
from colony.ir.types import Array, ScalarValue


def frames_of(program: Program, example: Example) -> tuple[Frame, ...]:
    """What an example gives in each of its frames, in declared units.

    An element that is set in an array that is missing is left out, as is what the example expects.
    """
    sensors = {s.name: s for s in program.robot.sensors}
    readings: dict[str, Reading] = {}
    frames = []
    for step in example.steps:
        for given in step.given:
            sensor = sensors[given.sensor]
            readings[sensor.name] = _given(sensor, given, readings.get(sensor.name))
        frames += [Frame(t_ns, dict(readings)) for t_ns in step.times_ns]
    return tuple(frames)


def _given(sensor: Sensor, given: Given, before: Reading) -> Reading:
    value = given.value
    if isinstance(value, tuple):
        return tuple(_declared(sensor, x) for x in value)
    if value is None:
        return None
    scalar = _declared(sensor, value)
    if given.index is not None:
        if not isinstance(before, tuple):
            return before
        return (*before[: given.index], scalar, *before[given.index + 1 :])
    return (scalar,) * sensor.type.size if isinstance(sensor.type, Array) else scalar


def _declared(sensor: Sensor, value: ScalarValue) -> ScalarValue:
    return value if isinstance(value, bool) else value / sensor.factor
