"""Shrinks a trace that shows something to what it takes: few frames, plain readings, regular times.

Delta debugging (Zeller and Hildebrandt, 2002) over frames, then one reading after the other, until nothing
more can go. Every step is tried: what is left does show it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import assert_never

from colony.ir.frame import Frame, Reading
from colony.ir.program import Program, Sensor
from colony.ir.types import Array, Bool, Enum, Quantity, Scalar, ScalarValue
from colony.verify.reference.boundary import sense

MOST_TRIES = 1000
"""How often a trace is tried at most; what is best so far is given then."""

Shows = Callable[[tuple[Frame, ...]], int | None]
"""The index of the frame that shows it, None if none does; the frames after it do not matter."""


def shrunk(
    program: Program, trace: Sequence[Frame], shows: Shows, most_tries: int = MOST_TRIES
) -> tuple[Frame, ...]:
    """The least trace found that `shows` what `trace` does; its last frame is the one that shows it.

    Frames keep their order. `trace` itself must show it.
    """
    shrinking = _Shrinking(program, tuple(trace), shows, most_tries)
    before: tuple[Frame, ...] = ()
    while repr(before) != repr(shrinking.trace) and shrinking.left:
        before = shrinking.trace
        shrinking.fewer_frames()
        shrinking.plainer_readings()
        shrinking.regular_times()
    return shrinking.trace


class _Shrinking:
    """Mutable: the best trace so far, and how many tries are left."""

    def __init__(self, program: Program, trace: tuple[Frame, ...], shows: Shows, left: int) -> None:
        self._sensors = program.robot.sensors
        self._frame_ns = program.robot.frame_ns
        self._shows = shows
        self.left = left
        self.trace = trace
        self._take(trace)

    def _take(self, candidate: tuple[Frame, ...]) -> bool:
        """Go on with a candidate if it shows it, up to the frame that does."""
        if not self.left or not candidate:
            return False
        self.left -= 1
        at = self._shows(candidate)
        if at is None:
            return False
        self.trace = candidate[: at + 1]
        return True

    def fewer_frames(self) -> None:
        """Leave out half of them, a quarter, ..., single ones, from the end; the last frame as well."""
        size = max(1, len(self.trace) // 2)
        while size:
            end = len(self.trace)
            while end > 0:
                self._take((*self.trace[: max(0, end - size)], *self.trace[end:]))
                end = min(end - size, len(self.trace))
            size //= 2

    def regular_times(self) -> None:
        """Begin at 0, and let each frame follow after one frame period, or after some whole ones."""
        first = self.trace[0].t_ns
        self._take(tuple(f._replace(t_ns=f.t_ns - first) for f in self.trace))
        for i in range(1, len(self.trace)):
            if i >= len(self.trace):
                return
            gap = self.trace[i].t_ns - self.trace[i - 1].t_ns
            for wanted in dict.fromkeys((self._frame_ns, -(-gap // self._frame_ns) * self._frame_ns)):
                if gap == wanted:
                    break
                moved = tuple(f._replace(t_ns=f.t_ns - gap + wanted) for f in self.trace[i:])
                if self._take((*self.trace[:i], *moved)):
                    break

    def plainer_readings(self) -> None:
        """For each sensor, in all frames at once and then one by one."""
        for sensor in self._sensors:
            self._alike(sensor)
            for i in range(len(self.trace)):
                for plain in _plainer(sensor, self._reading(sensor, i)):
                    if i >= len(self.trace) or self._take(self._with(sensor, (i,), plain)):
                        break

    def _alike(self, sensor: Sensor) -> None:
        """One plain reading in all frames, or the first one, or the last one."""
        if not self.trace:
            return
        every = range(len(self.trace))
        candidates = [_plain(sensor), self._reading(sensor, 0), self._reading(sensor, len(self.trace) - 1)]
        for candidate in candidates:
            changed = self._with(sensor, every, candidate)
            if repr(changed) == repr(self.trace) or self._take(changed):
                return

    def _reading(self, sensor: Sensor, i: int) -> Reading:
        return self.trace[i].readings.get(sensor.name) if i < len(self.trace) else None

    def _with(self, sensor: Sensor, frames: Sequence[int], reading: Reading) -> tuple[Frame, ...]:
        chosen = frozenset(frames)
        return tuple(
            f._replace(readings={**f.readings, sensor.name: reading}) if i in chosen else f
            for i, f in enumerate(self.trace)
        )


def _plainer(sensor: Sensor, reading: Reading) -> Iterator[Reading]:
    """What could stand in its place, plainest first; nothing where it is as plain as can be."""
    plain = _plain(sensor)
    if repr(reading) in (repr(plain), "None"):
        return
    yield plain
    if isinstance(reading, list | tuple) and isinstance(sensor.type, Array):
        yield from _plainer_elements(sensor, sensor.type, list(reading))
    elif isinstance(reading, float) and math.isfinite(reading) and not reading.is_integer():
        yield from (x for digits in (0, 1, 3) if (x := round(reading, digits)) != reading)
    if not _is_proper(sensor, reading):
        yield None


def _plainer_elements(sensor: Sensor, of: Array, elements: list[ScalarValue | int]) -> Iterator[Reading]:
    """Halves, quarters, ... of an array plain; then rounded."""
    plain = _plain_scalar(sensor, of.element)
    size = len(elements) // 2
    while size:
        for first in range(0, len(elements), size):
            part = elements[first : first + size]
            if any(repr(x) != repr(plain) for x in part):
                yield [*elements[:first], *([plain] * len(part)), *elements[first + size :]]
        size //= 2
    if all(isinstance(x, float) and abs(x) < 1e15 for x in elements):
        rounded: list[ScalarValue | int] = [float(round(x)) for x in elements]
        if repr(rounded) != repr(elements):
            yield rounded


def _is_proper(sensor: Sensor, reading: Reading) -> bool:
    """Whether it is a reading of the sensor; others count as missing, which is plainer."""
    return sense(sensor, reading, sensor.factor)[0] is not None


def _plain(sensor: Sensor) -> Reading:
    if isinstance(sensor.type, Array):
        return (_plain_scalar(sensor, sensor.type.element),) * sensor.type.size
    return _plain_scalar(sensor, sensor.type)


def _plain_scalar(sensor: Sensor, of: Scalar) -> ScalarValue:
    """False, the first enumerator, or what is nearest to 0 in the range; in declared units."""
    match of:
        case Bool():
            return False
        case Enum(members=members):
            return members[0][1]
        case Quantity():
            low, high = sensor.low, sensor.high
            if low is not None and low > 0:
                return low / sensor.factor
            return high / sensor.factor if high is not None and high < 0 else 0.0
        case _:
            assert_never(of)
