"""Limits of a program hold for connections from outside: joystick, motions, locks, whatever happens to it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from colony.analysis.audit import audit
from colony.dsl.load import load_text
from colony.ir.program import Program
from colony.runtime.assembly.virtual import VirtualSession
from colony.runtime.kit.errors import CallRefusedError
from colony.runtime.kit.script import Script as Generator
from colony.runtime.kit.script import do, sleep
from colony.runtime.kit.script_node import ScriptNode
from colony.runtime.library import robot
from colony.runtime.library.ask import CallRequest
from colony.runtime.protocol.messages import Sample
from tests.analysis.test_audit import changed
from tests.kit.node_stage import MS, S
from tests.runtime.scripted import FAR, Log, Script, session

TEXT = """
robot r {
  frame 50 ms
  sensor sonar[24] : mm range 0 .. 10000 from PServer.sonar within 300 ms
  sensor bumper : bool from RServer.front_bumper within 300 ms
  actuator drive { velocity : mm/s range -600 .. 600, turn : deg/s range -90 .. 90 }
           to RServer.drive idle drive(velocity = 0, turn = 0)
}
module cruise { when sonar[0] > 4 m do drive(velocity = 100 mm/s, turn = 0) }
network { drive = cruise }
limit drive.velocity <= sonar[0] / 10 s
limit drive.velocity <= 0 mm/s when bumper
limit drive.turn >= -30 deg/s when recently(bumper, 1 s)
contract slow: fresh(sonar) implies drive.velocity <= sonar[0] / 10 s
contract never_rams: bumper implies drive.velocity <= 0 mm/s
"""
PROGRAM = load_text(TEXT)


def ranges(ahead: float) -> Callable[[int], Sample]:
    return lambda t: Sample((ahead, *FAR[1:]), t)


class Run:
    """A run of the program in which a script drives; `refusals` are the codes of its calls."""

    def __init__(
        self,
        *calls: tuple[float, CallRequest[Any]],
        script: Script | None = None,
        program: Program = PROGRAM,
        prepare: Callable[[VirtualSession], None] = lambda one: None,
        isolate: bool = False,
    ) -> None:
        self.devices, self.log, self.refusals = script or Script(), Log(), list[tuple[str, str]]()
        self.program = program
        node = ScriptNode("joystick", self._drive(calls), ("RServer",), priority=50, delay_ns=1)
        run = session(program, self.devices, self.log, nodes=(node,), isolate=isolate)
        prepare(run)
        assert run.run(4 * S)
        assert node.problem is None
        assert not [log.disagreements for log in self.log.frames if log.disagreements]

    def _drive(self, calls: tuple[tuple[float, CallRequest[Any]], ...]) -> Generator:
        for pause_s, call in calls:
            yield from sleep(pause_s)
            try:
                yield from do("RServer", call)
            except CallRefusedError as refused:
                self.refusals.append((refused.code, str(refused)))

    @property
    def verdicts(self) -> list[Any]:
        return [log.verdicts["drive"] for log in self.log.frames if "drive" in log.verdicts]

    def sent_outside(self) -> list[tuple[float, float]]:
        return [v.values for v in self.verdicts if v.outside is not None]

    def report(self) -> Any:
        return audit(self.program, self.log.frames)


def joystick(
    velocity: float, turn: float = 0.0, seconds: float = 3.0
) -> Iterator[tuple[float, CallRequest[Any]]]:
    for _ in range(round(seconds / 0.3)):
        yield 0.3, robot.drive(velocity, turn, lease=0.5)


@pytest.mark.parametrize("isolate", [False, True])
def test_a_joystick_is_held_to_the_limits_of_each_frame(isolate: bool) -> None:
    run = Run(*joystick(500.0), script=Script(sonar_at=ranges(2000.0)), isolate=isolate)
    sent = run.sent_outside()
    assert len(sent) > 50
    assert {velocity for velocity, _ in sent} == {200.0}
    assert run.report().agrees
    assert not any(log.breaches for log in run.log.frames)


def test_a_connection_that_ignores_limits_is_recorded_as_such() -> None:
    calls = ((0.1, robot.ignore_limits()), *joystick(500.0, seconds=1.2), (0.0, robot.ignore_limits(False)))
    run = Run(*calls, *joystick(500.0, seconds=1.2), script=Script(sonar_at=ranges(1000.0)))
    kinds = {(v.values[0], v.unlimited) for v in run.verdicts if v.outside is not None}
    assert kinds == {(500.0, True), (100.0, False)}
    report = run.report()
    assert report.agrees
    assert [c.contract for c in report.contracts] == ["slow"]
    assert any("slow" in log.breaches for log in run.log.frames)


@pytest.mark.parametrize("process", ["clients", "drive/.bounds"])
def test_without_the_client_of_bounds_the_base_stands(process: str) -> None:
    isolate = process != "clients"

    def prepare(one: VirtualSession) -> None:
        one.transport.at(1 * S, lambda: one.kill(process))
        one.transport.at(2 * S, lambda: one.restart(process))

    run = Run(
        *joystick(500.0),
        script=Script(sonar_at=ranges(2000.0)),
        prepare=prepare,
        isolate=isolate,
    )
    outside = [(log.frame.t_ns, log.verdicts["drive"]) for log in run.log.frames]
    dead = [v for t, v in outside if 1050 * MS <= t < 2 * S and v.outside is not None]
    assert {(v.values, v.fault) for v in dead} == {((0.0, 0.0), "limits unknown")}
    assert {v.values for t, v in outside if t > 2500 * MS and v.outside is not None} == {(200.0, 0.0)}
    assert run.report().agrees


def test_a_missing_reading_holds_whoever_drives_at_the_idle_value() -> None:
    blind = Script(sonar_at=lambda t: ranges(2000.0)(t) if t < 1 * S else None)
    run = Run(*joystick(500.0), script=blind)
    assert {velocity for velocity, _ in run.sent_outside()} == {200.0, 0.0}
    assert run.report().agrees


def test_limits_that_contradict_leave_the_base_idle() -> None:
    program = load_text(TEXT + "limit drive.velocity >= 150 mm/s\n")
    run = Run(*joystick(500.0), program=program, script=Script(sonar_at=ranges(1000.0)))
    outside = [v for v in run.verdicts if v.outside is not None]
    assert {(v.values, v.fault) for v in outside} == {((0.0, 0.0), "limits contradict")}
    assert run.report().agrees


def test_contracts_see_what_was_sent_from_outside() -> None:
    said = TEXT.replace("contract slow", "contract nobody: not (drive is commanded)\ncontract slow")
    program = load_text(said + "contract own: drive is idle or drive by cruise\n")
    run = Run(*joystick(80.0, seconds=0.9), program=program, script=Script(sonar_at=ranges(1000.0)))
    for log in run.log.frames:
        outside = log.verdicts["drive"].outside is not None
        assert log.breaches == (("nobody", "own") if outside else ())
    assert run.report().agrees


def test_contracts_see_that_the_base_is_idle_when_a_client_is_late() -> None:
    program = load_text(TEXT + "contract goes: drive by cruise\n")

    def prepare(one: VirtualSession) -> None:
        one.transport.at(1 * S, lambda: one.kill("clients"))
        one.transport.at(2 * S, lambda: one.restart("clients"))

    run = Run(program=program, prepare=prepare)
    broken = [log.frame.t_ns for log in run.log.frames if log.breaches]
    missed = [
        log.frame.t_ns
        for log in run.log.frames
        if {"late", "lost"} & {fate for _, fate in log.verdicts["drive"].fates}
    ]
    assert broken == missed
    assert 15 <= len(missed) <= 25
    assert run.report().agrees


def test_the_audit_finds_a_command_from_outside_that_the_limits_forbid() -> None:
    run = Run(*joystick(500.0), script=Script(sonar_at=ranges(2000.0)))
    at = next(i for i, log in enumerate(run.log.frames) if log.verdicts["drive"].outside is not None)
    forbidden = changed(run.log.frames, at, values=(200.5, 0.0))
    first = audit(PROGRAM, forbidden).first
    assert first is not None
    start = "a command from outside is beyond the limits"
    assert first.message == f"{start}: found velocity = 200.5 mm/s; allowed: at most 200 mm/s"
    said = audit(PROGRAM, changed(run.log.frames, at, values=(200.5, 0.0), unlimited=True)).first
    assert said.message == "broken contracts: recorded none; in the interpreter slow"
