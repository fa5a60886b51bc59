"""Hypothesis strategies for frames and traces, for property tests of your own behaviors.

    from hypothesis import given
    from colony.dsl.load import load_file
    from colony.verify.reference.interpreter import Interpreter
    from colony.verify.testing.strategies import traces

    wander = load_file("wander.colony")

    @given(traces(wander))
    def test_never_rams(trace):
        interpreter = Interpreter(wander)
        for frame in trace:
            assert "never_ram" not in interpreter.step(frame).breaches

Examples shrink towards short traces and ordinary readings. They include what goes wrong in practice: missing
and faulty sensors, times a nanosecond off, NaN.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache, partial
from itertools import accumulate, pairwise, takewhile
from random import Random

from hypothesis import strategies as st

from colony.ir.frame import Frame, Reading
from colony.ir.program import Program, Sensor, assumptions, expect_program, is_regular
from colony.ir.types import ScalarValue
from colony.verify.testing.agreement import reference
from colony.verify.testing.frames import Choices, draw_frame, draw_trace, sensors_read
from colony.verify.testing.shrinking import plain_reading


def choices() -> st.SearchStrategy[Choices]:
    """Return a strategy for choices that hypothesis makes and shrinks."""
    return st.randoms(use_true_random=False, note_method_calls=False).map(Choices)


def frames(program: Program, *, t_ns: int = 0) -> st.SearchStrategy[Frame]:
    """Draw a frame of `program` at `t_ns`, in declared units.

    Its readings are near the constants of the program, invalid, or missing.
    """
    expect_program(program)
    return choices().map(lambda c: draw_frame(c, program, t_ns))


def traces(
    program: Program, *, max_frames: int = 8, as_assumed: bool = False
) -> st.SearchStrategy[tuple[Frame, ...]]:
    """Draw up to `max_frames` frames of `program`, at least one, in declared units.

    Times advance by frame periods and by durations of the program, exactly or a nanosecond off. Readings are
    at, between, and one ulp from the program's constants; they recur, are missing, or have the wrong type,
    length or range. The elements of an array are mostly equal, except for a run of others. Some traces begin
    like a test of the program. With `as_assumed`, a trace ends before the first frame that breaks an
    assumption of the program.
    """
    expect_program(program)
    if max_frames < 1:
        raise ValueError(f"max_frames: found {max_frames}; expected 1 or more")
    sensors = [s for s in program.robot.sensors if s.name in sensors_read(program)]
    varied = lru_cache(maxsize=1)(lambda seed: _varied(Choices(Random(seed)), program, max_frames))
    count = max_frames + len(_TIMES) + len(_READINGS) * len(sensors)
    kept = st.binary(min_size=count, max_size=count)  # hypothesis simplifies the parts whose byte is 0

    @st.composite  # a failing test then prints the frames, not the calls that made them
    def simplified(draw: st.DrawFn) -> tuple[Frame, ...]:
        simpler = draw(kept)
        return _simplified(program, varied(draw(st.integers(0, _MAX_SEED))), sensors, simpler)

    return simplified().map(partial(_as_assumed, program)).filter(bool) if as_assumed else simplified()


def _as_assumed(program: Program, trace: tuple[Frame, ...]) -> tuple[Frame, ...]:
    """Return the frames of a trace before the first that breaks an assumption."""
    assumed = {a.name for a in assumptions(program)}
    outcomes = reference(program, trace)
    return tuple(
        f for f, _ in takewhile(lambda x: not assumed & {*x[1].breaches}, zip(trace, outcomes, strict=True))
    )


_MAX_SEED = 2**24 - 1
"""The largest seed of a trace; of a larger range hypothesis mostly draws small numbers, again and again."""

_CANDIDATES = 5
"""Number of traces of which the one with the most different decisions is taken."""


def _varied(choices: Choices, program: Program, max_frames: int) -> tuple[Frame, ...]:
    """Return the one of a few drawn traces in which the program decides most differently."""

    def variety(trace: tuple[Frame, ...]) -> tuple[int, int]:
        """Return how often the same modules win with another command, then the number of decisions."""
        outcomes = reference(program, trace)
        winners, texts = (
            [[d.by for d in o.decisions] for o in outcomes],
            [repr(o.decisions) for o in outcomes],
        )
        steps = zip(pairwise(winners), pairwise(texts), strict=True)
        return len({texts for (a, b), texts in steps if a == b and any(a) and texts[0] != texts[1]}), len(
            {*texts}
        )

    return max(
        (draw_trace(choices, program, max_frames, mirrored=True) for _ in range(_CANDIDATES)), key=variety
    )


def _simplified(
    program: Program, trace: tuple[Frame, ...], sensors: Sequence[Sensor], kept: Iterable[int]
) -> tuple[Frame, ...]:
    """Return a trace without some frames, with simpler times and simpler readings of some sensors.

    `sensors` are those that the program reads; the readings of others are left out.
    """
    numbers = iter(kept)
    of_frames = [next(numbers) for _ in trace]
    frames = [f for f, number in zip(trace, of_frames, strict=True) if number] or [trace[-1]]
    times = [f.t_ns for f in frames]
    for simpler_times in _TIMES:
        if not next(numbers):
            times = simpler_times(times, program.robot.frame_ns)
    if not is_regular(program.robot, times):
        times = _regular(times, program.robot.frame_ns)
    readings = [dict.fromkeys(f.readings) for f in frames]
    for sensor in sensors:
        own = [f.readings.get(sensor.name) for f in frames]
        for simpler in _READINGS:
            if not next(numbers):
                own = [simpler(sensor, reading) for reading in own]
        for found, reading in zip(readings, own, strict=True):
            if sensor.name in found:
                found[sensor.name] = reading
    return tuple(f._replace(t_ns=t, readings=r) for f, t, r in zip(frames, times, readings, strict=True))


def _regular(times: list[int], period: int) -> list[int]:
    """Return times one frame period apart, from 0."""
    return [i * period for i in range(len(times))]


def _whole_periods(times: list[int], period: int) -> list[int]:
    """Return times from 0 with whole frame periods between them, at least one."""
    return [*accumulate((max(1, round((b - a) / period)) * period for a, b in pairwise(times)), initial=0)]


_TIMES = (_whole_periods, _regular)


def _rounded(sensor: Sensor, reading: Reading) -> Reading:
    """Return a reading with its numbers rounded to three digits."""
    if isinstance(reading, list | tuple):
        return tuple(_rounded_number(x) for x in reading)
    return _rounded_number(reading)  # type: ignore[arg-type]


def _rounded_number(x: ScalarValue | int) -> ScalarValue | int:
    """Return a number with three significant digits, or 0 if it is tiny."""
    return (float(f"{x:.3g}") if abs(x) > 1e-9 else 0.0) if isinstance(x, float) and math.isfinite(x) else x


_READINGS: tuple[Callable[[Sensor, Reading], Reading], ...] = (
    _rounded,
    lambda sensor, _: plain_reading(sensor),
    lambda sensor, _: None,
)
