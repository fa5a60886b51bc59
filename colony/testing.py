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

from collections.abc import Iterator, Sequence

from colony.ir.frame import Frame, Outcome
from colony.ir.program import Program
from colony.verify.testing.agreement import Disagreement as Disagreement
from colony.verify.testing.agreement import disagreement as disagreement
from colony.verify.testing.agreement import reference
from colony.verify.testing.strategies import frames as frames
from colony.verify.testing.strategies import programs as programs
from colony.verify.testing.strategies import traces as traces

__all__ = ["Disagreement", "check", "disagreement", "frames", "programs", "traces"]


def check(program: Program, trace: Sequence[Frame]) -> Iterator[tuple[Frame, Outcome]]:
    """Yield each frame of a trace with what the reference interpreter decides in it, after all other
    executors have been held to the same.

    Raises:
        AssertionError: the client list or the generated Python decides something else, which is a mistake of
            colony; or a contract of the program is broken.
    """
    outcomes = reference(program, trace)
    found = disagreement(program, trace, expected=outcomes)
    assert found is None, str(found)
    for frame, outcome in zip(trace, outcomes, strict=True):
        broken = ", ".join(outcome.breaches)
        assert not broken, f"broken at {frame.t_ns / 1e9:g} s: {broken}"
        yield frame, outcome
