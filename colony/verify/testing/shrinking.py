"""Minimization of a run that shows a finding: few frames, simple readings, regular times.

Delta debugging (Zeller and Hildebrandt, 2002) over frames, then over the readings of one sensor after
another, then over times, until nothing can be simplified further. Every step is checked, so that the result
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
"""Maximum number of frames to compute for shrinking a trace; then the best trace so far is returned."""

Step = TypeVar("Step", Frame, Snapshot)

Shows = Callable[[tuple[Step, ...]], int | None]
"""A function that returns the index of the first frame that shows the finding, or None."""


class Simpler(Protocol):
    """The readings that count as simpler than those of a sensor, simplest first."""

    def in_all(self, sensor: Sensor, readings: Sequence[Reading]) -> Iterable[Reading]:
        """Return simpler readings for all frames; `readings` are those of each frame."""

    def in_one(self, sensor: Sensor, reading: Reading, before: Reading) -> Iterable[Reading]:
        """Return simpler readings for one frame; `before` is the reading of the frame before.

        All of them must be strictly simpler than `reading`, or shrinking would not terminate.
        """


def shrink_trace(
    program: Program, trace: Sequence[Frame], shows: Shows[Frame], frame_budget: int = MAX_SHRINK_FRAMES
) -> tuple[Frame, ...]:
    """Return the smallest trace found whose last frame shows the same finding as `trace`.

    Frames keep their order. `trace` itself must show the finding.
    """
    shrinker = Shrinker(program.robot, tuple(trace), shows, _PlainReadings(), frame_budget)
    shrinker.run()
    return shrinker.trace


class Shrinker(Generic[Step]):
    """A stepwise minimizer of a run. Stateful: holds the best run so far, and the remaining frame budget."""

    def __init__(
        self,
        robot: Robot,
        trace: tuple[Step, ...],
        shows: Shows[Step],
        simpler: Simpler,
        frame_budget: int,
    ) -> None:
        self._robot = robot
        self._shows: Shows[Step] = shows
        self._simpler = simpler
        self._frames_left = frame_budget
        self.trace: tuple[Step, ...] = trace
        self.take(trace)

    def run(self) -> None:
        """Shrink until nothing can be simplified further, or the frame budget is spent."""
        before: tuple[Step, ...] = ()
        while repr(before) != repr(self.trace) and self._frames_left > 0:
            before = self.trace
            self._fewer_frames()
            self._simpler_readings()
            self._regular_times()

    def take(self, candidate: tuple[Step, ...]) -> bool:
        """Adopt a candidate if it shows the finding, and cut it after that frame; return True if it does."""
        if not candidate or len(candidate) > self._frames_left:
            return False
        self._frames_left -= len(candidate)
        index = self._shows(candidate)
        if index is not None:
            self.trace = candidate[: index + 1]
        return index is not None

    def _fewer_frames(self) -> None:
        """Leave out halves of the trace, then quarters, ..., then single frames, each time from the end."""
        size = max(1, len(self.trace) // 2)
        while size:
            end = len(self.trace)
            while end > 0:
                self.take(self.trace[: max(0, end - size)] + self.trace[end:])
                end = min(end - size, len(self.trace))
            size //= 2

    # --- times -----------------------------------------------------------------------------------

    def _regular_times(self) -> None:
        """Start at 0, with one frame period between frames, or as few periods as possible."""
        period, first = self._robot.frame_ns, self.trace[0].t_ns
        if first:
            self.take(tuple(f._replace(t_ns=f.t_ns - first) for f in self.trace))
        regular = tuple(f._replace(t_ns=i * period) for i, f in enumerate(self.trace))
        if repr(regular) == repr(self.trace) or self.take(regular):
            return
        for i in range(1, len(self.trace)):
            if i < len(self.trace):
                self._reduce_gap(i)

    def _reduce_gap(self, i: int) -> None:
        """Reduce the time before frame `i` to as few whole periods as possible, by bisection."""
        period, gap = self._robot.frame_ns, self._gap(i)
        if gap == period or self._try_gap(i, period):
            return
        for grain in (period, 1_000_000, 1_000):
            if any(self._try_gap(i, new_gap) for new_gap in (-(-gap // grain) * grain, gap // grain * grain)):
                break
        low, high = 1, self._gap(i) // period if i < len(self.trace) else 0
        while high - low > 1:
            center = (low + high) // 2
            if self._try_gap(i, center * period):
                high = center
            else:
                low = center

    def _gap(self, i: int) -> int:
        return self.trace[i].t_ns - self.trace[i - 1].t_ns

    def _try_gap(self, i: int, new_gap: int) -> bool:
        """Try another time between frame `i` and the frame before it; later frames are shifted, too."""
        if i >= len(self.trace) or new_gap <= 0:
            return False
        change = new_gap - self._gap(i)
        if not change:
            return True
        shifted = tuple(f._replace(t_ns=f.t_ns + change) for f in self.trace[i:])
        return self.take(self.trace[:i] + shifted)

    # --- readings --------------------------------------------------------------------------------

    def _simpler_readings(self) -> None:
        """Simplify each sensor, first in all frames at once, then in one frame after another."""
        for sensor in self._robot.sensors:
            for candidate in self._simpler.in_all(sensor, [self._reading(sensor, f) for f in self.trace]):
                changed = self._with(sensor, range(len(self.trace)), candidate)
                if repr(changed) == repr(self.trace) or self.take(changed):
                    break
            i = 0
            while i < len(self.trace):
                before = self._reading(sensor, self.trace[i - 1]) if i else None
                candidates = self._simpler.in_one(sensor, self._reading(sensor, self.trace[i]), before)
                if not any(self._set(sensor, i, candidate) for candidate in candidates):
                    i += 1

    def _set(self, sensor: Sensor, i: int, reading: Reading) -> bool:
        """Try another reading in frame `i` and the equal ones after it, or in frame `i` alone."""
        end, same = i + 1, repr(self._reading(sensor, self.trace[i]))
        while end < len(self.trace) and repr(self._reading(sensor, self.trace[end])) == same:
            end += 1
        return any(self.take(self._with(sensor, range(i, n), reading)) for n in dict.fromkeys((end, i + 1)))

    def _reading(self, sensor: Sensor, frame: Step) -> Reading:
        return frame.readings.get(sensor.name)

    def _with(self, sensor: Sensor, frames: range, reading: Reading) -> tuple[Step, ...]:
        return tuple(
            with_reading(f, sensor.name, reading) if i in frames else f for i, f in enumerate(self.trace)
        )


def with_reading(frame: Step, sensor: str, reading: Reading) -> Step:
    """Return a frame with another reading of a sensor; None makes the sensor missing."""
    readings: dict[str, Any] = {**frame.readings, sensor: reading}
    if reading is None and isinstance(frame, Snapshot):
        del readings[sensor]  # a snapshot has no entries for missing sensors
    return frame._replace(readings=readings)


class _PlainReadings:
    """Plainer readings in declared units: false, the first enumerator, 0, and rounder numbers."""

    def in_all(self, sensor: Sensor, readings: Sequence[Reading]) -> Iterator[Reading]:
        """Yield a plain reading, then the first and the last reading."""
        yield from (plain_reading(sensor), readings[0], readings[-1])

    def in_one(self, sensor: Sensor, reading: Reading, before: Reading) -> Iterator[Reading]:
        """Yield plainer readings; an invalid reading may also become missing."""
        plain = plain_reading(sensor)
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
    """Yield the array with halves, quarters, ... of it made plain; then with rounded elements."""
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


def plain_reading(sensor: Sensor) -> Reading:
    """Return a plain reading, in declared units: false, the first enumerator, or the number nearest to 0."""
    plain = _plain_scalar(sensor)
    return (plain,) * sensor.type.size if isinstance(sensor.type, Array) else plain


def _plain_scalar(sensor: Sensor) -> ScalarValue:
    """Return false, the first enumerator, or the number in range that is nearest to 0; in declared units."""
    of, low, high = element_type(sensor.type), sensor.low, sensor.high
    if isinstance(of, Quantity) and low is not None and low > 0:
        return low / sensor.factor
    if isinstance(of, Quantity) and high is not None and high < 0:
        return high / sensor.factor
    return any_value(of)
