"""Property tests of behaviors, for pytest and hypothesis.

from hypothesis import given
import colony
from colony.testing import check, traces

program = colony.load("patrol.colony")

@given(traces(program))
def test_it_never_rams(trace):
    for frame, outcome in check(program, trace):
        if frame.readings.get("bumper"):
            assert outcome.commands["drive"].values[0] <= 0
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from colony.execute.checked import checked_trace
from colony.extras import naming_missing_extras
from colony.ir.frame import Frame, Outcome
from colony.ir.program import Program, expect_program
from colony.text.wording import time_text
from colony.verify.testing import agreement
from colony.verify.testing.agreement import Disagreement as Disagreement

with naming_missing_extras():
    from colony.verify.testing.strategies import frames as frames
    from colony.verify.testing.strategies import programs as programs
    from colony.verify.testing.strategies import traces as traces

__all__ = ["Disagreement", "check", "disagreement", "frames", "programs", "traces"]


def disagreement(program: Program, trace: Iterable[Frame]) -> Disagreement | None:
    """Return the first frame in which an executor differs from the reference interpreter."""
    expect_program(program)
    return agreement.disagreement(program, checked_trace(trace, program.robot.sensors))


def check(program: Program, trace: Iterable[Frame]) -> Iterator[tuple[Frame, Outcome]]:
    """Yield each frame of a trace with the decision of the reference interpreter.

    All other executors are compared with it first.

    Raises:
        AssertionError: an executor differs from the reference interpreter, which is a bug in colony; or a
            contract of the program is broken.
        TypeError, ValueError: the trace is invalid: it has no frames, or its times do not increase.
    """
    expect_program(program)
    frames = checked_trace(trace, program.robot.sensors)
    outcomes = agreement.reference(program, frames)
    difference = agreement.disagreement(program, frames, expected=outcomes)
    assert difference is None, str(difference)
    for frame, outcome in zip(frames, outcomes, strict=True):
        broken = ", ".join(outcome.breaches)
        assert not broken, f"broken at {time_text(frame.t_ns)}: {broken}"
        yield frame, outcome
