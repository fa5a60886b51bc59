"""The monitor tells when a verdict is not what the client list decides, and excuses idling for the late."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import pytest

from colony.execute.executor import ProgramExecutor
from colony.ir.frame import Answer, Decision, Frame, Outcome
from colony.runtime.observe.observer import Monitor
from colony.runtime.protocol.messages import Verdict
from tests.programs import compilation, robot

EXPECTED = Decision("drive", "avoid", (80.0, 30.0))


class Always:
    restarts = 0

    def step(self, frame: Frame, answers: Mapping[str, Answer]) -> Outcome:
        return Outcome((EXPECTED,))

    def advance(self, frame: Frame, answers: Mapping[str, Answer], missing: Collection[str]) -> bool:
        return frame.t_ns >= 3

    @property
    def memory(self) -> None:
        return None

    def restart(self) -> None:
        self.restarts += 1


def verdict(**changes: object) -> Verdict:
    fields: dict[str, object] = {
        "k": 0,
        "t_ns": 0,
        "actuator": "drive",
        "by": "avoid",
        "values": (80.0, 30.0),
        "fates": (("avoid", "won"), ("cruise", "silent")),
    }
    return Verdict(**(fields | changes))  # type: ignore[arg-type]


IDLE = {"by": None, "values": (0.0, 0.0)}
OUTSIDE = {"by": None, "values": (5.0, 0.0), "outside": "ada/1"}

CASES = [
    ({}, False),
    ({"values": (80.0, 31.0)}, True),
    ({"by": "cruise"}, True),
    ({"fault": "not finite"}, True),
    ({**IDLE, "fates": (("avoid", "silent"), ("cruise", "silent"))}, True),
    ({**IDLE, "fates": (("avoid", "late"), ("cruise", "silent"))}, False),
    ({**IDLE, "fates": (("avoid", "lost"), ("cruise", "silent"))}, False),
    ({**IDLE, "fates": (("avoid", "refused"), ("cruise", "silent"))}, False),
    ({"by": "cruise", "values": (300.0, 0.0), "fates": (("avoid", "late"), ("cruise", "won"))}, True),
    ({"violation": True, "fates": (("avoid", "won"), ("cruise", "overruled"))}, True),
    ({**OUTSIDE, "fates": (("avoid", "overridden"), ("cruise", "silent"))}, False),
    ({**OUTSIDE, "fates": (("avoid", "silent"), ("cruise", "overridden"))}, True),
    ({**OUTSIDE, "fates": (("avoid", "overridden"), ("cruise", "silent"), ("bob/2", "overridden"))}, False),
    ({**OUTSIDE, "fates": (("avoid", "late"), ("cruise", "silent"), ("bob/2", "overridden"))}, False),
    ({**OUTSIDE, "by": "avoid"}, True),
    ({**IDLE, "hold": "stopped", "fates": (("avoid", "stopped"), ("cruise", "silent"))}, False),
    ({**IDLE, "hold": "locked", "fates": (("avoid", "locked out"), ("cruise", "silent"))}, False),
    ({**IDLE, "hold": "locked", "fates": (("avoid", "silent"), ("cruise", "locked out"))}, True),
]


@pytest.mark.parametrize(("changes", "wrong"), CASES)
def test_disagreements(changes: dict[str, object], wrong: bool) -> None:
    found = Monitor(Always()).check(Frame(0, {}), {"drive": verdict(**changes)}).disagreements
    assert bool(found) is wrong
    if wrong:
        assert "the client list gives avoid (80.0, 30.0)" in found[0]


def test_a_late_client_breaks_a_contract_but_none_in_time() -> None:
    text = f"{robot()}module m {{ when true do out(v = 1) }}  network {{ out = m }}\n"
    compiled = compilation(f"{text}contract c: out by m  contract d in time: out by m").compiled
    monitor = Monitor(ProgramExecutor(compiled), actuators=compiled.robot.actuators)
    for t_ns, (fate, broken) in enumerate((("late", ("c",)), ("lost", ("c",)), ("silent", ()))):
        idle = verdict(actuator="out", **IDLE, fates=(("m", fate),))
        assert monitor.check(Frame(t_ns, {}), {"out": idle}).expected.breaches == broken


def test_an_actuator_without_a_verdict_is_not_compared() -> None:
    assert Monitor(Always()).check(Frame(0, {}), {}).disagreements == ()


def test_memory_begins_anew_where_that_is_said() -> None:
    executor = Always()
    monitor = Monitor(executor)
    monitor.restart()
    monitor.check(Frame(0, {}), {})
    assert executor.restarts == 0
    monitor.restart()
    monitor.check(Frame(1, {}), {})
    assert executor.restarts == 1


def test_after_a_frame_that_was_missed_nothing_is_compared_until_memory_begins_anew() -> None:
    monitor = Monitor(Always())
    wrong = {"drive": verdict(by="cruise")}
    monitor.lose_memory()
    assert monitor.check(Frame(0, {}), wrong) == (Outcome(()), ())
    monitor.restart()
    assert monitor.check(Frame(1, {}), wrong).disagreements


def test_from_where_a_module_in_python_told_no_answer_nothing_is_compared_until_memory_is_known() -> None:
    monitor = Monitor(Always(), modules=("p", "q"))
    wrong = {"drive": verdict(by="cruise")}
    both = {"p": Answer(), "q": Answer((1.0,))}
    assert monitor.check(Frame(0, {}), wrong, answers=both).disagreements
    assert monitor.check(Frame(1, {}), wrong, answers={"p": Answer()}) == (Outcome(()), ())
    assert monitor.check(Frame(2, {}), wrong, answers=both) == (Outcome(()), ())
    assert monitor.keyframe().memory is None
    assert monitor.check(Frame(3, {}), wrong, answers=both) == (Outcome(()), ()), "known after this frame"
    assert monitor.check(Frame(4, {}), wrong, answers=both).disagreements
    assert monitor.check(Frame(1, {}), wrong) == (Outcome(()), ())
    monitor.restart()
    assert monitor.check(Frame(2, {}), wrong, answers=both).disagreements


def test_with_degrade_lesser_ones_may_command_from_when_one_is_lost() -> None:
    lost = {"drive": verdict(by="cruise", fates=(("avoid", "silent"), ("cruise", "won")))}
    after = {"drive": verdict(by="cruise", fates=(("avoid", "silent"), ("cruise", "won")))}
    for degrading in ((), ("drive",)):
        monitor = Monitor(Always(), degrading)
        assert bool(monitor.check(Frame(0, {}), lost, ("other/client",)).disagreements) is not bool(degrading)
        assert bool(monitor.check(Frame(1, {}), after).disagreements) is not bool(degrading)
        monitor.restart()
        assert monitor.check(Frame(2, {}), after).disagreements
