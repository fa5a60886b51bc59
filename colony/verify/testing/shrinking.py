"""Minimization of a run that shows a finding: few frames, simple readings, regular times.

Delta debugging (Zeller and Hildebrandt, 2002) over frames, then over the readings of one sensor after the
other, then over times, until nothing can be simplified any further. Every step is checked, so the result
shows the same finding.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, Generic, Protocol, TypeVar

from colony.ir.frame import Frame, Reading
from colony.ir.program import Program, Robot, Sensor
from colony.ir.types import Array, Quantity, ScalarValue, any_value, element_type
from colony.verify.reference.boundary import sense
from colony.verify.snapshot import Snapshot

MAX_SHRINK_FRAMES = 6000
"""The largest number of frames computed to shrink a trace; then the best trace so far is returned."""

Given = TypeVar("Given", Frame, Snapshot)

Shows = Callable[[tuple[Given, ...]], int | None]
"""A function that returns the index of the first frame that shows the finding, None if no frame does."""


class Simpler(Protocol):
    """The readings that count as simpler than those of a sensor, simplest first."""

    def in_all(self, sensor: Sensor, readings: Sequence[Reading]) -> Iterable[Reading]:
        """Return simpler readings for all frames; `readings` are those of each frame."""

    def in_one(self, sensor: Sensor, reading: Reading, before: Reading) -> Iterable[Reading]:
        """Return simpler readings for one frame; `before` is the reading of the frame before.

        All of them must be strictly simpler than `reading`, or shrinking would not terminate.
        """


def shrunk(
    program: Program, trace: Sequence[Frame], shows: Shows[Frame], frame_budget: int = MAX_SHRINK_FRAMES
) -> tuple[Frame, ...]:
    """Return the smallest trace found that shows the same finding as `trace`, in its last frame.

    Frames keep their order. `trace` itself must show the finding.
    """
    shrinker = Shrinker(program.robot, tuple(trace), shows, _PlainReadings(), frame_budget)
    shrinker.run()
    return shrinker.trace


class Shrinker(Generic[Given]):
    """A stepwise minimizer of a run. Mutable: the best run so far, and the frame budget that is left."""

    def __init__(
        self,
        robot: Robot,
        trace: tuple[Given, ...],
        shows: Shows[Given],
        simpler: Simpler,
        frame_budget: int,
    ) -> None:
        self._robot = robot
        self._shows: Shows[Given] = shows
        self._simpler = simpler
        self._frames_left = frame_budget
        self.trace: tuple[Given, ...] = trace
        self.take(trace)

    def run(self) -> None:
        """Shrink until nothing more can go, or the frame budget is spent."""
        before: tuple[Given, ...] = ()
        while repr(before) != repr(self.trace) and self._frames_left > 0:
            before = self.trace
            self._fewer_frames()
            self._simpler_readings()
            self._regular_times()

    def take(self, candidate: tuple[Given, ...]) -> bool:
        """Adopt a candidate that shows the finding, cut after that frame; return True if it does."""
        if not candidate or len(candidate) > self._frames_left:
            return False
        self._frames_left -= len(candidate)
        at = self._shows(candidate)
        if at is not None:
            self.trace = candidate[: at + 1]
        return at is not None

    def _fewer_frames(self) -> None:
        """Leave out halves of the trace, quarters, ..., single frames, from the end, last one included."""
        size = max(1, len(self.trace) // 2)
        while size:
            end = len(self.trace)
            while end > 0:
                self.take(self.trace[: max(0, end - size)] + self.trace[end:])
                end = min(end - size, len(self.trace))
            size //= 2

    # --- times -----------------------------------------------------------------------------------

    def _regular_times(self) -> None:
        """Begin at 0, and let each frame follow after one frame period, or after as few as possible."""
        period, first = self._robot.frame_ns, self.trace[0].t_ns
        if first:
            self.take(tuple(f._replace(t_ns=f.t_ns - first) for f in self.trace))
        regular = tuple(f._replace(t_ns=i * period) for i, f in enumerate(self.trace))
        if repr(regular) == repr(self.trace) or self.take(regular):
            return
        for i in range(1, len(self.trace)):
            if i < len(self.trace):
                self._sooner(i)

    def _sooner(self, i: int) -> None:
        """Let frame `i` follow after as few whole periods as possible, found by bisection."""
        period, gap = self._robot.frame_ns, self._gap(i)
        if gap == period or self._moved(i, period):
            return
        for grain in (period, 1_000_000, 1_000):
            if any(self._moved(i, wanted) for wanted in (-(-gap // grain) * grain, gap // grain * grain)):
                break
        low, high = 1, self._gap(i) // period if i < len(self.trace) else 0
        while high - low > 1:
            middle = (low + high) // 2
            if self._moved(i, middle * period):
                high = middle
            else:
                low = middle

    def _gap(self, i: int) -> int:
        return self.trace[i].t_ns - self.trace[i - 1].t_ns

    def _moved(self, i: int, wanted: int) -> bool:
        """Try another time between frame `i` and the one before; those after it move along."""
        if i >= len(self.trace) or wanted <= 0:
            return False
        change = wanted - self._gap(i)
        if not change:
            return True
        moved = tuple(f._replace(t_ns=f.t_ns + change) for f in self.trace[i:])
        return self.take(self.trace[:i] + moved)

    # --- readings --------------------------------------------------------------------------------

    def _simpler_readings(self) -> None:
        """Simplify each sensor in all frames at once, and then in one after the other."""
        for sensor in self._robot.sensors:
            for candidate in self._simpler.in_all(sensor, [self._reading(sensor, f) for f in self.trace]):
                changed = self._with(sensor, range(len(self.trace)), candidate)
                if repr(changed) == repr(self.trace) or self.take(changed):
                    break
            i = 0
            while i < len(self.trace):
                before = self._reading(sensor, self.trace[i - 1]) if i else None
                here = self._simpler.in_one(sensor, self._reading(sensor, self.trace[i]), before)
                if not any(self._set(sensor, i, candidate) for candidate in here):
                    i += 1

    def _set(self, sensor: Sensor, i: int, reading: Reading) -> bool:
        """Try another reading in frame `i` and the equal ones that follow, or in frame `i` alone."""
        end, same = i + 1, repr(self._reading(sensor, self.trace[i]))
        while end < len(self.trace) and repr(self._reading(sensor, self.trace[end])) == same:
            end += 1
        return any(self.take(self._with(sensor, range(i, n), reading)) for n in dict.fromkeys((end, i + 1)))

    def _reading(self, sensor: Sensor, frame: Given) -> Reading:
        return frame.readings.get(sensor.name)

    def _with(self, sensor: Sensor, frames: range, reading: Reading) -> tuple[Given, ...]:
        return tuple(
            with_reading(f, sensor.name, reading) if i in frames else f for i, f in enumerate(self.trace)
        )


def with_reading(frame: Given, sensor: str, reading: Reading) -> Given:
    """Return a frame with another reading of a sensor; None makes it missing."""
    readings: dict[str, Any] = {**frame.readings, sensor: reading}
    if reading is None and isinstance(frame, Snapshot):
        del readings[sensor]  # a snapshot has no entries for missing sensors
    return frame._replace(readings=readings)


class _PlainReadings:
    """Plainer readings in declared units: false, the first enumerator, 0, and rounder numbers."""

    def in_all(self, sensor: Sensor, readings: Sequence[Reading]) -> Iterator[Reading]:
        """Yield a plain reading, the first and the last."""
        yield from (_plain(sensor), readings[0], readings[-1])

    def in_one(self, sensor: Sensor, reading: Reading, before: Reading) -> Iterator[Reading]:
        """Yield plainer readings; an invalid reading of the sensor may be missing as well."""
        plain = _plain(sensor)
        if repr(reading) in (repr(plain), "None"):
            return
        yield plain
        if isinstance(reading, list | tuple) and isinstance(sensor.type, Array):
            yield from _plainer_elements(_plain_scalar(sensor), list(reading))
        elif isinstance(reading, float) and math.isfinite(reading) and not reading.is_integer():
            yield from (x for digits in (0, 1, 3) if (x := round(reading, digits)) != reading)
        if sense(sensor, reading, sensor.factor)[0] is None:
            yield None


def _plainer_elements(plain: ScalarValue, elements: list[ScalarValue | int]) -> Iterator[Reading]:
    """Yield halves, quarters, ... of an array plain; then rounded."""
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


def _plain(sensor: Sensor) -> Reading:
    plain = _plain_scalar(sensor)
    return (plain,) * sensor.type.size if isinstance(sensor.type, Array) else plain


def _plain_scalar(sensor: Sensor) -> ScalarValue:
    """Return false, the first enumerator, or what is nearest to 0 in the range; in declared units."""
    of, low, high = element_type(sensor.type), sensor.low, sensor.high
    if isinstance(of, Quantity) and low is not None and low > 0:
        return low / sensor.factor
    if isinstance(of, Quantity) and high is not None and high < 0:
        return high / sensor.factor
    return any_value(of)
