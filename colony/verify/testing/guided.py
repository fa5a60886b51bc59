"""Traces for one program, drawn with regard to earlier ones.

Most of what a behavior can do needs several conditions at once, one after the other: traces that know nothing
of each other rarely meet them. So the first way to every pattern of activity is kept, and later traces go on
from there: they begin with such a way, rather with one to a rare pattern, and change few readings a frame.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass

from colony.ir.frame import Frame, Reading
from colony.ir.program import Program
from colony.verify.testing.drawing import Choices
from colony.verify.testing.frames import draw_trace, gaps_of, sensors_read, thresholds_of
from colony.verify.testing.readings import draw_reading

LONGEST = 48
"""Number of frames of a way; a trace that continues from it may have a few more."""

_FEW = 4


@dataclass(frozen=False, slots=True)
class _Place:
    """The shortest way to a pattern that is known, and in how many frames the pattern was met."""

    way: tuple[Frame, ...]
    met: int = 1


class Guide:
    """A drawer of a program's traces that learns from them. Mutable: the places that it knows.

    Args:
        max_frames: of a trace, unless it goes on from a longer way.
    """

    def __init__(self, program: Program, max_frames: int) -> None:
        self._program = program
        self._max_frames = max_frames
        self._thresholds = thresholds_of(program)
        self._gaps = gaps_of(program)
        read = sensors_read(program)
        self._sensors = tuple(s for s in program.robot.sensors if s.name in read)
        self._places: dict[Hashable, _Place] = {}

    def draw(self, choices: Choices) -> tuple[Frame, ...]:
        """Draw a trace: a new one, or one that goes on from a known place."""
        if not self._places or choices.rarely(3):
            return draw_trace(choices, self._program, self._max_frames)
        frames = list(self._place(choices).way)
        for _ in range(choices.between(1, max(_FEW, self._max_frames - len(frames)))):
            last = frames[-1]
            frames.append(Frame(last.t_ns + choices.one(self._gaps), self._next(choices, last)))
        return tuple(frames)

    def learn(self, trace: Sequence[Frame], patterns: Sequence[Hashable]) -> None:
        """Learn what every frame of a trace did, as a pattern; ways beyond `LONGEST` frames are not kept."""
        for i, pattern in enumerate(patterns[:LONGEST]):
            known = self._places.get(pattern)
            if known is None:
                self._places[pattern] = _Place(tuple(trace[: i + 1]))
                continue
            known.met += 1
            if i + 1 < len(known.way):
                known.way = tuple(trace[: i + 1])

    def _place(self, choices: Choices) -> _Place:
        """Return the least visited of three random places."""
        places = [*self._places.values()]
        return min((choices.one(places) for _ in range(3)), key=lambda place: place.met)

    def _next(self, choices: Choices, last: Frame) -> dict[str, Reading]:
        """Return the readings of a frame, with a few changed, or some as they were elsewhere."""
        readings = dict(last.readings)
        if not self._sensors or choices.rarely(4):
            return readings
        elsewhere = self._place(choices).way[-1].readings if choices.rarely(3) else None
        for _ in range(choices.between(1, 3)):
            sensor = choices.one(self._sensors)
            if elsewhere is not None:
                readings[sensor.name] = elsewhere.get(sensor.name)
            else:
                readings[sensor.name] = draw_reading(choices, sensor, self._thresholds)
        return readings
