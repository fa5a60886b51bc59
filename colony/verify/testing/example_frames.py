"""Conversion of a `test` block to frames for any executor."""

from __future__ import annotations

from collections.abc import Iterator

from colony.ir.frame import Frame, Reading
from colony.ir.program import Example, Given, Program, Sensor
from colony.ir.types import Array, Value
from colony.verify.snapshot import Snapshot, present_readings


def snapshots_of(program: Program, example: Example) -> tuple[Snapshot, ...]:
    """Return the snapshots of an example, one per frame.

    Assignments to elements of a missing array are left out, as are readings that are too old, and the
    expectations.
    """
    return tuple(
        Snapshot(t_ns, present_readings(program, given), restarted=restarted)
        for t_ns, given, restarted in _given(program, example)
    )


def frames_of(program: Program, example: Example) -> tuple[Frame, ...]:
    """Return the same frames in declared units."""
    factors = {s.name: s.factor for s in program.robot.sensors}
    return tuple(
        Frame(
            t_ns,
            {name: _declared(value, factors[name]) for name, value in given.items()},
            restarted=restarted,
        )
        for t_ns, given, restarted in _given(program, example)
    )


def _given(program: Program, example: Example) -> Iterator[tuple[int, dict[str, Value | None], bool]]:
    readings = GivenReadings(program)
    for step in example.steps:
        for given in step.given:
            readings.give(given, step.times_ns[0])
        for i, t_ns in enumerate(step.times_ns):
            yield t_ns, readings.at(t_ns), step.restarted and i == 0


class GivenReadings:
    """The readings that an example gives. Stateful: remembers the last one of each sensor, and its age."""

    def __init__(self, program: Program) -> None:
        self._sensors = {s.name: s for s in program.robot.sensors}
        self._values: dict[str, Value | None] = {}
        self._taken_ns: dict[str, int] = {}  # only of sensors whose reading ages

    def give(self, given: Given, t_ns: int) -> bool:
        """Apply an assignment of the step that begins at `t_ns`; False for an element of a missing array.

        An element that is given without an age leaves the age of its array as it is.
        """
        name = given.sensor
        before = self.value_at(name, t_ns)
        if given.index is not None and before is None:
            return False
        self._values[name] = assigned(self._sensors[name], given, before)
        if given.age_ns is not None:
            self._taken_ns[name] = t_ns - given.age_ns
        elif given.index is None:
            self._taken_ns.pop(name, None)
        return True

    def at(self, t_ns: int) -> dict[str, Value | None]:
        """Return the readings in a frame at `t_ns`; None for one that is missing, or too old."""
        return {name: self.value_at(name, t_ns) for name in self._values}

    def value_at(self, name: str, t_ns: int) -> Value | None:
        """Return the reading of a sensor at `t_ns`; None if it is missing, or too old."""
        return None if self.age_if_old(name, t_ns) is not None else self._values.get(name)

    def age_if_old(self, name: str, t_ns: int) -> int | None:
        """Return the age of a reading in nanoseconds if its sensor's `within` makes it too old at `t_ns`."""
        within_ns, taken_ns = self._sensors[name].within_ns, self._taken_ns.get(name)
        if within_ns is None or taken_ns is None or t_ns - taken_ns <= within_ns:
            return None
        return t_ns - taken_ns


def assigned(sensor: Sensor, given: Given, before: Value | None) -> Value | None:
    """Return a sensor's value after an assignment; an element is set in the array `before`."""
    value = given.value
    if isinstance(value, tuple) or value is None:
        return value
    if given.index is None:
        return (value,) * sensor.type.size if isinstance(sensor.type, Array) else value
    assert isinstance(before, tuple)
    return (*before[: given.index], value, *before[given.index + 1 :])


def _declared(value: Value | None, factor: float) -> Reading:
    if isinstance(value, tuple):
        return tuple(x if isinstance(x, bool) else x / factor for x in value)
    return value if value is None or isinstance(value, bool) else value / factor
