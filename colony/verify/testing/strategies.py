"""Hypothesis strategies for behaviors and traces, for property tests of your own behaviors.

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

Examples are valid by construction and shrink towards small programs, short traces and ordinary readings. They
include what goes wrong in practice: missing and faulty sensors, times a nanosecond off, NaN, wires used
twice.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache
from itertools import accumulate, pairwise
from random import Random

from hypothesis import strategies as st

from colony.ir.frame import Frame, Reading
from colony.ir.program import Program, Sensor, expect_program, is_regular
from colony.ir.types import ScalarValue
from colony.verify.testing.agreement import reference
from colony.verify.testing.drawing import Choices
from colony.verify.testing.frames import draw_frame, draw_trace, sensors_read
from colony.verify.testing.networks import draw_network
from colony.verify.testing.program_text import draw_text
from colony.verify.testing.shrinking import plain_reading


def choices() -> st.SearchStrategy[Choices]:
    """Return a strategy for choices that hypothesis makes and shrinks."""
    return st.randoms(use_true_random=False, note_method_calls=False).map(Choices)


Run = tuple[Program, tuple[Frame, ...]]
"""A program, and frames for it."""


def networks(*, max_modules: int = 6, max_wires: int = 5) -> st.SearchStrategy[Program]:
    """Draw programs that consist of a network: arbitrary wirings of modules controlled by bool sensors.

    The predicate of module `m<i>` is the bool sensor `p<i>`, and the module is silent where that is missing;
    so a trace can produce any pattern of activity. Wirings are directed acyclic graphs over one or two
    actuators, with shared wires, inhibitors of suppressors of inhibitors, and time constants. The contract
    `<name>_is_inactive` of each module and wire is broken whenever that module or wire is active.
    """
    return choices().map(lambda c: draw_network(c, max_modules, max_wires))


def texts(*, python: bool = True) -> st.SearchStrategy[str]:
    """Draw source texts of valid programs that use the whole language except imports and tests.

    With `python`, some modules are written in Python.
    """
    return choices().map(lambda c: draw_text(c, python))


def programs(*, python: bool = True) -> st.SearchStrategy[Program]:
    """Draw the programs of `texts`.

    Raises:
        DiagnosticError: the front end rejects a drawn text, which is a bug in the front end or in `texts`.
    """
    from colony.dsl.load import load_text

    return texts(python=python).map(load_text)


def frames(program: Program, *, t_ns: int = 0) -> st.SearchStrategy[Frame]:
    """Draw a frame of `program` at `t_ns`, in declared units.

    Its readings are near the constants of the program, invalid, or missing.
    """
    expect_program(program)
    return choices().map(lambda c: draw_frame(c, program, t_ns))


def traces(program: Program, *, max_frames: int = 8) -> st.SearchStrategy[tuple[Frame, ...]]:
    """Draw up to `max_frames` frames of `program`, at least one, in declared units.

    Times advance by frame periods and by durations of the program, exactly or a nanosecond off. Readings are
    at, between, and one ulp from the program's constants; they recur, are missing, or have the wrong type,
    length or range. The elements of an array are mostly equal, except for a run of others. Some traces begin
    like a test of the program.
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

    return simplified()


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


def network_runs(*, max_modules: int = 6, max_wires: int = 5, max_frames: int = 8) -> st.SearchStrategy[Run]:
    """Draw a network together with a trace, which varies more than `networks().flatmap(traces)`."""
    return choices().map(lambda c: _network_run(c, max_modules, max_wires, max_frames))


def runs(*, python: bool = True, max_frames: int = 8) -> st.SearchStrategy[Run]:
    """Draw a program together with a trace, which varies more than `programs().flatmap(traces)`."""
    return choices().map(lambda c: _run(c, python, max_frames))


def run_of_seed(seed: int, *, network: bool = False, max_frames: int = 8) -> Run:
    """Return a run that `runs` (or `network_runs`) could draw, determined by the seed, without hypothesis."""
    c = Choices(Random(seed))
    return _network_run(c, 6, 5, max_frames) if network else _run(c, True, max_frames)


def _network_run(c: Choices, max_modules: int, max_wires: int, max_frames: int) -> Run:
    program = draw_network(c, max_modules, max_wires)
    return program, draw_trace(c, program, max_frames)


def _run(c: Choices, python: bool, max_frames: int) -> Run:
    from colony.dsl.load import load_text

    program = load_text(draw_text(c, python))
    return program, draw_trace(c, program, max_frames)
