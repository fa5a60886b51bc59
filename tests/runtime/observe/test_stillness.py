"""A robot at rest while a program runs says why, once for each cause."""

from __future__ import annotations

from typing import Any

import pytest

from colony.compile.pipeline import compile_program
from colony.dsl.load import load_text
from colony.ir.frame import Frame
from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.observe.stillness import STILL_NS, Stillness
from colony.runtime.protocol.messages import Fate, Tick, Verdict
from tests.kit.node_stage import MS

TEXT = """language 1
robot r {
  sensor   near : mm   from PServer.near  within 300 ms
  sensor   far  : mm   from PServer.far
  sensor   gain : number default 1 from DServer.Gain
  actuator drive { velocity : mm/s, turn : deg/s } to RServer.drive idle drive(velocity = 0, turn = 0)
  actuator lamp { level : number } to DServer.Lamp idle hold
}
module a { when near * gain < 1 m do drive(velocity = 100 mm/s, turn = 0) }
module b { when far < 1 m do drive(velocity = 0, turn = 0) }
network { drive = a suppresses b }
"""
READ = {"near": 5.0, "far": 5.0}


class Watched:
    """A stillness, and what it reports. Mutable: the frame that comes next."""

    def __init__(self, text: str = TEXT) -> None:
        self.lines: list[str] = []
        self.stillness = Stillness(compile_program(load_text(text)).compiled, self.lines.append)
        self._k = 0

    def rest(self, ns: int = STILL_NS, **more: Any) -> list[str]:
        """Let frames pass in which nothing moves, and return all lines so far."""
        for _ in range(ns // (50 * MS) + 1):
            self.frame(**more)
        return self.lines

    def frame(
        self,
        values: tuple[float, float] | None = (0.0, 0.0),
        readings: dict[str, float | None] = READ,  # type: ignore[assignment]
        down: tuple[str, ...] = (),
        fates: dict[str, Fate] | None = None,
        heard: bool = True,
        **more: Any,
    ) -> None:
        """Take a frame."""
        t_ns = self._k * 50 * MS
        found = tuple((fates or {"a": "inactive", "b": "inactive"}).items())
        fields = {"by": None, **more}
        verdict = Verdict(k=self._k, t_ns=t_ns, actuator="drive", values=values, fates=found, **fields)
        tick = Tick(k=self._k, t_ns=t_ns, down=down)
        verdicts = {"drive": verdict} if heard else {}
        self.stillness.take(RunFrame(tick=tick, frame=Frame(t_ns, readings), verdicts=verdicts))
        self._k += 1


NOBODY = "no module commands `drive` (`colony explain` of a recording says why)"


@pytest.mark.parametrize(
    ("case", "cause"),
    [
        ({}, NOBODY),
        ({"heard": False}, "RServer has sent no verdict for `drive`"),
        ({"hold": "stopped"}, "the EMERGENCY STOP is on (`colony stop --release` ends it)"),
        ({"hold": "locked", "outside": "ada/1"}, "ada/1 has locked `drive`"),
        ({"hold": "locked"}, "a connection has locked `drive`"),
        ({"outside": "ada/1"}, "ada/1 commands `drive` from outside the network"),
        ({"fault": "limits contradict"}, "the limits contradict each other"),
        (
            {"by": "a", "fault": "missing", "readings": {"far": 5.0}},
            "the command that won, or one of its limits, reads a missing value; "
            "`near` (PServer.near) never had a value",
        ),
        ({"fates": {"a": "inhibited", "b": "inactive"}}, "`a` is inhibited"),
        ({"by": "b", "fates": {"a": "inactive", "b": "won"}}, "`b` commands it to stand"),
        ({"fates": {"a": "late", "b": "late"}}, "`a` and `b` are late"),
        ({"fates": {"a": "lost", "b": "inactive"}}, "`a` is lost"),
        (
            {"fates": {"a": "silent", "b": "silent"}, "readings": {}},
            "`near` (PServer.near) and `far` (PServer.far) never had a value",
        ),
        (
            {"fates": {"a": "silent", "b": "inactive"}, "readings": {"far": 1.0}, "down": ("PServer",)},
            "`near` (PServer is down) never had a value",
        ),
    ],
)
def test_the_cause_is_named_once(case: dict[str, Any], cause: str) -> None:
    watched = Watched()
    assert watched.rest(STILL_NS - 100 * MS, **case) == []
    assert watched.rest(**case) == [f"nothing moves: {cause}"]
    assert watched.stillness.cause == cause
    watched.frame(values=(0.0, 5.0), readings=case.get("readings", READ))
    assert watched.stillness.cause == ""
    assert watched.rest(2 * STILL_NS, **case) == [f"nothing moves: {cause}"]


def test_a_sensor_that_had_a_value_is_missing() -> None:
    watched = Watched()
    watched.frame()
    assert watched.stillness.unread == ()
    fates: dict[str, Fate] = {"a": "silent", "b": "inactive"}
    assert watched.rest(fates=fates, readings={"near": None, "far": 5.0}) == [
        "nothing moves: `near` (PServer.near) is missing"
    ]


def test_sensors_without_a_value_are_listed_but_for_those_with_a_default() -> None:
    watched = Watched()
    watched.frame(readings={"far": 1.0, "near": None})
    assert watched.stillness.unread == ("near",)


def test_what_an_actuator_was_given_is_no_sensor_that_lacks_a_value() -> None:
    reading = TEXT.replace("when far < 1 m", "when far < 1 m and last.lamp.level > 0")
    lamp = "module c { when true do lamp(level = 1) }\nnetwork { lamp = c }\n"
    watched = Watched(reading.replace("network {", "network { ") + lamp)
    assert watched.stillness.unread == ("far", "near")


def test_another_cause_is_another_line() -> None:
    watched = Watched()
    watched.rest()
    assert watched.rest(hold="stopped")[1:] == [
        "nothing moves: the EMERGENCY STOP is on (`colony stop --release` ends it)"
    ]


def test_a_limit_may_hold_it() -> None:
    watched = Watched(TEXT + "limit drive.velocity <= near / 1 s\n")
    fates: dict[str, Fate] = {"a": "won", "b": "suppressed"}
    assert watched.rest(by="a", fates=fates) == [
        "nothing moves: `a` commands it to stand, or a limit holds it at 0"
    ]


def test_a_program_that_moves_nothing_is_never_still() -> None:
    lamp = TEXT.replace("mm/s", "mm").replace("deg/s", "deg")
    assert Watched(lamp).rest(3 * STILL_NS) == []
