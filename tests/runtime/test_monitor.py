"""The monitor tells when a verdict is not what the client list decides, and excuses idling for the late."""

from __future__ import annotations

import pytest

from colony.ir.frame import Decision, Frame, Outcome
from colony.runtime.messages import Verdict
from colony.runtime.monitor import Monitor

EXPECTED = Decision("drive", "avoid", (80.0, 30.0))


class Always:
    def step(self, frame: Frame) -> Outcome:
        return Outcome((EXPECTED,))


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
]


@pytest.mark.parametrize(("changes", "wrong"), CASES)
def test_disagreements(changes: dict[str, object], wrong: bool) -> None:
    found = Monitor(Always()).check(Frame(0, {}), {"drive": verdict(**changes)}).disagreements
    assert bool(found) is wrong
    if wrong:
        assert "by the client list it is avoid (80.0, 30.0)" in found[0]


def test_an_actuator_without_a_verdict_is_not_compared() -> None:
    assert Monitor(Always()).check(Frame(0, {}), {}).disagreements == ()
