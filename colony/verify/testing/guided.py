"""Coverage-guided traces: later traces continue from rare situations that earlier traces reached.

Most of what a behavior can do needs several conditions in sequence, which independent random traces rarely
produce. So the shortest trace to every pattern of activity is kept as a prefix. Later traces begin with such
a prefix, more often with one to a rare pattern, and change a few readings per frame.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass

from colony.ir.frame import Frame, Reading
from colony.ir.program import Program
from colony.verify.testing.frames import (
    Choices,
    draw_reading,
    draw_trace,
    gaps_of,
    sensors_read,
    thresholds_of,
)

MAX_PREFIX_FRAMES = 48
"""Maximum number of frames of a prefix; a trace that continues from it may have a few more."""

_MIN_EXTENSION_FRAMES = 4


@dataclass(frozen=False, slots=True)
class _KnownPattern:
    """The shortest known trace to a pattern, and the number of frames in which the pattern occurred."""

    prefix: tuple[Frame, ...]
    frames: int = 1


class Guide:
    """A generator of traces that learns from their outcomes. Stateful: remembers patterns.

    Args:
        program: the program to draw traces for.
        max_frames: maximum number of frames of a trace, unless it continues from a longer prefix.
    """

    def __init__(self, program: Program, max_frames: int) -> None:
        self._program = program
        self._max_frames = max_frames
        self._thresholds = thresholds_of(program)
        self._gaps = gaps_of(program)
        read = sensors_read(program)
        self._sensors = tuple(s for s in program.robot.sensors if s.name in read)
        self._known: dict[Hashable, _KnownPattern] = {}

    def draw(self, choices: Choices) -> tuple[Frame, ...]:
        """Draw a trace: a new one, or one that continues from a known pattern."""
        if not self._known or choices.one_in(3):
            return draw_trace(choices, self._program, self._max_frames)
        frames = list(self._pick_known(choices).prefix)
        for _ in range(choices.between(1, max(_MIN_EXTENSION_FRAMES, self._max_frames - len(frames)))):
            last = frames[-1]
            frames.append(Frame(last.t_ns + choices.pick(self._gaps), self._next(choices, last)))
        return tuple(frames)

    def learn(self, trace: Sequence[Frame], patterns: Sequence[Hashable]) -> None:
        """Learn the pattern of each frame of a trace, up to `MAX_PREFIX_FRAMES` frames."""
        for i, pattern in enumerate(patterns[:MAX_PREFIX_FRAMES]):
            known = self._known.get(pattern)
            if known is None:
                self._known[pattern] = _KnownPattern(tuple(trace[: i + 1]))
                continue
            known.frames += 1
            if i + 1 < len(known.prefix):
                known.prefix = tuple(trace[: i + 1])

    def _pick_known(self, choices: Choices) -> _KnownPattern:
        """Return the rarest of three randomly chosen patterns."""
        patterns = [*self._known.values()]
        return min((choices.pick(patterns) for _ in range(3)), key=lambda known: known.frames)

    def _next(self, choices: Choices, last: Frame) -> dict[str, Reading]:
        """Return the next frame's readings: a few change, at random or to those of another pattern."""
        readings = dict(last.readings)
        if not self._sensors or choices.one_in(4):
            return readings
        other_readings = self._pick_known(choices).prefix[-1].readings if choices.one_in(3) else None
        for _ in range(choices.between(1, 3)):
            sensor = choices.pick(self._sensors)
            if other_readings is not None:
                readings[sensor.name] = other_readings.get(sensor.name)
            else:
                readings[sensor.name] = draw_reading(choices, sensor, self._thresholds)
        return readings
