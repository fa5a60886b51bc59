"""Coverage-guided traces: later traces continue from rare situations that earlier traces reached.

Most of what a behavior can do needs several conditions in sequence, which independent random traces rarely
produce. So the shortest trace to every pattern of activity is kept as a prefix. Later traces begin with such
a prefix, more often with one to a rare pattern, and change a few readings per frame.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, assert_never

from colony.ir.frame import NOTHING_GIVEN, Frame, Outcome, OverriddenCommand, Reading
from colony.ir.program import Actuator, ActuatorField, Program, modules_that_can_be_lost
from colony.ir.types import Bool, Enum, Quantity, ScalarValue
from colony.verify.reference.interpreter import Interpreter
from colony.verify.testing.frames import (
    Choices,
    draw_reading,
    draw_trace,
    gaps_of,
    sensors_read,
    thresholds_of,
)

# --- disturbed -----------------------------------------------------------------------------------------
#
# Drawn frames in which actuators are given something else than the network decided.


_LARGE = 1000.0
"""Maximum distance from its finite bound of a drawn field whose other bound is infinite."""


class DisturbedFrame(NamedTuple):
    """A frame, what actuators were given in it, the clients lost in it, and the interpreter's outcome."""

    frame: Frame
    given: dict[str, OverriddenCommand]
    lost: frozenset[str]
    outcome: Outcome


def disturbed_run(
    choices: Choices, program: Program, trace: tuple[Frame, ...], *, operators: bool
) -> Iterator[DisturbedFrame]:
    """Yield the frames of a run of the interpreter in which clients are late or lost.

    With `operators`, commands from outside the network are drawn as well, within the bounds of their frame.
    Modules in Python are called.
    """
    undisturbed, interpreter = Interpreter(program), Interpreter(program)
    can_be_lost = modules_that_can_be_lost(program)
    for frame in trace:
        # bounds depend on what actuators were given before, not on what they are given in this frame
        undisturbed.step(frame._replace(readings={**interpreter.last, **frame.readings}))
        given = {
            a.name: _given(choices, a, undisturbed, operators=operators)
            for a in program.robot.actuators
            if choices.one_in(2)
        }
        lost = frozenset(m for m in can_be_lost if choices.one_in(4))
        outcome = interpreter.step(frame, lost, given=given or NOTHING_GIVEN)
        yield DisturbedFrame(frame, given, lost, outcome)


def _given(
    choices: Choices, actuator: Actuator, interpreter: Interpreter, *, operators: bool
) -> OverriddenCommand:
    bounds = interpreter.bounds(actuator)
    if not operators or bounds is None or choices.one_in(3):
        return OverriddenCommand()
    fields = zip(actuator.fields, bounds, strict=True)
    return OverriddenCommand(tuple(_value(choices, field, *between) for field, between in fields))


def _value(choices: Choices, field: ActuatorField, low: float, high: float) -> ScalarValue:
    match field.type:
        case Bool():
            return choices.one_in(2)
        case Enum(members=members):
            return choices.pick(members)[1]
        case Quantity():
            least = low if math.isfinite(low) else min(high, 0.0) - _LARGE
            most = high if math.isfinite(high) else max(low, 0.0) + _LARGE
            inside = least + (most - least) * choices.up_to(64) / 64
            return choices.pick((least, most, min(max(0.0, least), most), min(max(inside, least), most)))
        case _:
            assert_never(field.type)


# --- guided --------------------------------------------------------------------------------------------


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
