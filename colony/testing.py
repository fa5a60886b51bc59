"""Property tests of behaviors, for pytest and hypothesis.

from hypothesis import given, settings
import colony
from colony.testing import check, traces

program = colony.load("patrol.colony")

@settings(deadline=None)
@given(traces(program))
def test_it_never_rams(trace):
    for frame, outcome in check(program, trace):
        if frame.readings["bumper"]:
            assert outcome.commands["drive"].values[0] <= 0
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache
from typing import cast

from colony.compile.backends.python.generate import generate, load
from colony.compile.pipeline import Compilation, compile_program
from colony.execute.checked import checked_trace
from colony.execute.intake import converted
from colony.extras import naming_missing_extras
from colony.ir.frame import Frame, Outcome, Reading
from colony.ir.program import Program, Sensor, assumptions, expect_program
from colony.text.wording import time_text
from colony.verify.reference.boundary import sense
from colony.verify.testing import agreement
from colony.verify.testing.agreement import Disagreement as Disagreement

with naming_missing_extras():
    from colony.verify.testing.strategies import frames as frames
    from colony.verify.testing.strategies import traces as traces

__all__ = ["Disagreement", "check", "disagreement", "frames", "traces"]


def disagreement(program: Program, trace: Iterable[Frame]) -> Disagreement | None:
    """Return the first frame in which an executor differs from the reference interpreter."""
    expect_program(program)
    return agreement.disagreement(program, checked_trace(trace, program.robot.sensors))


def check(program: Program, trace: Iterable[Frame]) -> Iterator[tuple[Frame, Outcome]]:
    """Yield each frame of a trace as the program saw it, with the decision of the reference interpreter.

    In these frames every sensor has a reading, in its declared unit: None if it is missing or was faulty, and
    within its range. All other executors are compared with the interpreter first.

    Raises:
        AssertionError: an executor differs from the reference interpreter, which is a bug in colony; or a
            contract of the program is broken.
        TypeError, ValueError: the trace is invalid: it has no frames, or its times do not increase.
    """
    expect_program(program)
    frames = checked_trace(trace, program.robot.sensors)
    outcomes = agreement.reference(program, frames)
    compilation, executors = _prepared(program)
    difference = agreement.disagreement(program, frames, executors, outcomes, compilation)
    assert difference is None, str(difference)
    assumed = {a.name for a in assumptions(program)}
    for frame, outcome in zip(frames, outcomes, strict=True):
        broken = ", ".join(name for name in outcome.breaches if name not in assumed)
        assert not broken, f"broken at {time_text(frame.t_ns)}: {broken}"
        yield _as_seen(program, frame), outcome


@lru_cache(maxsize=8)
def _prepared(program: Program) -> tuple[Compilation, Mapping[str, agreement.Factory]]:
    """Compile a program, and generate its Python, once for all traces."""
    compilation = compile_program(program)
    source = generate(compilation.compiled)
    return compilation, {**agreement.EXECUTORS, "generated Python": lambda _: load(source)}


def _as_seen(program: Program, frame: Frame) -> Frame:
    """Return a frame with a reading of each sensor, as the program saw it."""
    sensors = [s for s in program.robot.sensors if s.sent is None or s.name in frame.readings]
    return frame._replace(readings={s.name: _reading_seen(s, frame.readings.get(s.name)) for s in sensors})


def _reading_seen(sensor: Sensor, reading: Reading) -> Reading:
    value, record = sense(sensor, reading, sensor.factor)
    if value is not None and record is None:
        return reading
    return cast(Reading, converted(value, lambda x: x / sensor.factor))
