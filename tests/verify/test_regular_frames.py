"""`frame PERIOD jitter TIME`: proofs rely on it, and runs whose frames do not keep to it break a contract."""

from __future__ import annotations

import pytest
from hypothesis import given, settings

from colony.compile.pipeline import compile_program
from colony.dsl.load import load_text
from colony.dsl.parse import parse
from colony.dsl.printer import print_file
from colony.ir.frame import Frame
from colony.ir.program import is_regular
from colony.text.source import Source
from colony.verify.contracts.prove import prove_contracts
from colony.verify.contracts.report import verdict
from colony.verify.contracts.results import Refuted
from colony.verify.testing.agreement import EXECUTORS, disagreement
from colony.verify.testing.examples import run_examples
from colony.verify.testing.strategies import traces

MS = 1_000_000
TEXT = """
robot r {
  frame 50 ms JITTER
  sensor request : bool default false from DServer.Request
  actuator out { v : number } to DServer.Out idle out(v = 0)
}
state total = 0
next total = total + 1
machine m {
  start idle
  idle -> work when request
  work -> done when elapsed(m == m.work) >= 1 s
  done -> idle when not request
}
module work { when m == m.work do out(v = total) }
network { out = work }
contract done_in_time: not sustained(m == m.work, 1.2 s)
contract counted: total == round(total)
test "later" { at 0 s given request = true expect not (work is active)  at 7 s expect work is active }
"""
REGULAR = load_text(TEXT.replace("JITTER", "jitter 10 ms"))


def verdicts(jitter: str) -> list[str]:
    return [verdict(r) for r in prove_contracts(load_text(TEXT.replace("JITTER", jitter)))]


def test_an_answer_within_a_time_is_proved_of_regular_frames_alone() -> None:
    assert verdicts("jitter 10 ms") == ["proved", "proved"]
    assert verdicts("jitter 49 ms") == ["proved", "proved"]
    assert verdicts("")[0] == "REFUTED"


def test_runs_that_refute_are_regular() -> None:
    text = TEXT.replace("JITTER", "jitter 10 ms").replace("1.2 s", "1 s")
    found = prove_contracts(load_text(text))[0]
    assert isinstance(found, Refuted)
    assert is_regular(REGULAR.robot, [s.t_ns for s in found.trace.snapshots])


@pytest.mark.parametrize(
    ("gap_ms", "breaks"), [(50, False), (40, False), (60, False), (39.9, True), (60.1, True), (500, True)]
)
def test_a_frame_that_comes_too_soon_or_too_late_breaks_a_contract(gap_ms: float, breaks: bool) -> None:
    times_ns = [7 * MS, 57 * MS, 57 * MS + round(gap_ms * MS)]
    trace = tuple(Frame(t_ns, {}) for t_ns in times_ns)
    assert disagreement(REGULAR, trace) is None
    executor = EXECUTORS["generated Python"](compile_program(REGULAR))
    breaches = [executor.step(frame).breaches for frame in trace]
    assert breaches == [(), (), ("frames.regular",) if breaks else ()]


def test_tests_take_any_times() -> None:
    [result] = run_examples(REGULAR)
    assert result.passed


@settings(max_examples=20, deadline=None)
@given(traces(REGULAR))
def test_drawn_frames_are_regular(trace: tuple[Frame, ...]) -> None:
    assert is_regular(REGULAR.robot, [frame.t_ns for frame in trace])


def test_it_is_printed_as_it_is_read() -> None:
    text = "robot r {\n  frame 50 ms jitter 10 ms\n}\n"
    assert text in print_file(parse(Source("r.colony", text)).file)
