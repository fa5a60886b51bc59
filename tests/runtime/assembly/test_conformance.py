"""The runtime in virtual time decides as the client list and as the reference interpreter, on every frame."""

from __future__ import annotations

import random
from collections.abc import Iterable

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from colony.compile.pipeline import compile_program
from colony.execute.executor import ProgramExecutor
from colony.ir.frame import Decision, Frame, Outcome
from colony.ir.program import Program
from colony.runtime.protocol.messages import Message, Wake
from colony.verify.reference.interpreter import Interpreter
from colony.verify.testing.strategies import traces
from tests.drawn.strategies import networks, programs
from tests.kit.trace import play

QUIET = (HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.filter_too_much)


def check(program: Program, trace: tuple[Frame, ...], order_seed: int, isolate: bool) -> None:
    interpreter = Interpreter(program)
    by_list = ProgramExecutor(compile_program(program).compiled)
    played = play(program, trace, isolate=isolate, order_seed=order_seed)
    assert len(played.log.frames) == len(trace)
    for frame, log in zip(trace, played.log.frames, strict=True):
        expected = interpreter.step(frame)
        assert repr(by_list.step(frame)) == repr(expected)
        decided = {name: (v.by, v.values, v.fault) for name, v in log.verdicts.items()}
        due = _in_order(expected, decided)
        assert repr(decided) == repr({d.actuator: (d.by, d.values, d.fault) for d in due})
        assert log.disagreements == ()
        assert repr(log.expected) == repr(expected)
        assert not any(v.violation or v.notes for v in log.verdicts.values())


def _in_order(expected: Outcome, decided: Iterable[str]) -> list[Decision]:
    by_name = {d.actuator: d for d in expected.decisions}
    return [by_name[name] for name in decided]


@settings(suppress_health_check=QUIET)
@given(st.data(), st.integers(0, 5), st.booleans())
def test_networks(data: st.DataObject, order_seed: int, isolate: bool) -> None:
    program = data.draw(networks())
    check(program, data.draw(traces(program)), order_seed, isolate)


@settings(suppress_health_check=QUIET)
@given(st.data(), st.integers(0, 5), st.booleans())
def test_programs(data: st.DataObject, order_seed: int, isolate: bool) -> None:
    program = data.draw(programs())
    check(program, data.draw(traces(program)), order_seed, isolate)


@settings(suppress_health_check=QUIET)
@given(st.data(), st.booleans())
def test_the_order_of_messages_changes_nothing(data: st.DataObject, isolate: bool) -> None:
    program = data.draw(programs())
    trace = data.draw(traces(program))
    one, other = (play(program, trace, isolate=isolate, order_seed=seed) for seed in (1, 2))
    assert repr(one.decisions()) == repr(other.decisions()) or _same(one.decisions(), other.decisions())
    assert repr(sorted(one.performed, key=repr)) == repr(sorted(other.performed, key=repr))


def _same(one: list[tuple[Decision, ...]], other: list[tuple[Decision, ...]]) -> bool:
    """Equal frame by frame, whatever the order of actuators in it."""
    return [sorted(map(repr, frame)) for frame in one] == [sorted(map(repr, frame)) for frame in other]


@settings(suppress_health_check=QUIET)
@given(st.data(), st.integers(0, 100), st.booleans())
def test_when_messages_are_lost_it_decides_the_same_or_idles(
    data: st.DataObject, fault_seed: int, isolate: bool
) -> None:
    program = data.draw(networks())
    trace = data.draw(traces(program))
    chance = random.Random(fault_seed)

    def link(sender: str, receiver: str, message: Message) -> int | None:
        if isinstance(message, Wake) or "Observer" in (sender, receiver):
            return 0
        return None if chance.random() < 0.1 else chance.choice((0, 0, 0, 3, 60_000_000))

    played = play(program, trace, isolate=isolate, order_seed=fault_seed, link=link)
    assert [log.tick.k for log in played.log.frames] == list(range(len(played.log.frames)))
    interpreter = Interpreter(program)
    for log in played.log.frames:
        expected = {d.actuator: d for d in interpreter.step(log.frame).decisions}
        for name, verdict in log.verdicts.items():
            if verdict.by is not None:
                assert (verdict.by, verdict.values) == (expected[name].by, expected[name].values)
        assert log.disagreements == ()
