"""A robot that runs no program, watched: what is heard of it, and what is known."""

from __future__ import annotations

import json
from collections.abc import Iterable
from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any

import pytest

from colony.dsl.descriptions import RobotChoice
from colony.dsl.load import load_text
from colony.ir.frame import Frame
from colony.ir.program import Program
from colony.runs.described import described_program, described_robot
from colony.runtime.frames.clock import Clock
from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.kit.errors import ServerNotFoundError
from colony.runtime.protocol.deployment import LIMITS_RUN
from colony.runtime.protocol.interface import Interface, interface_of
from colony.runtime.protocol.messages import Effect, Message, Sample, Tick
from colony.runtime.servers.pserver import PServer
from colony.runtime.servers.rserver import RServer
from colony.runtime.transport.virtual import VirtualTransport
from colony.watch.joined_run import IdleRobot, IdleSink, idle_observer, idle_robot
from colony.watch.joining import Listener
from colony.watch.sources import LiveSource
from colony.watch.store import SnapshotStore
from colony.watch.trail import RunTrail
from tests.kit.node_stage import MS, S
from tests.runtime.assembly.resident_stage import SERVERS, Robot, description
from tests.runtime.scripted import Script

ROME = described_program(RobotChoice(text="rome", origin="the test"))

IDLE = IdleRobot(LIMITS_RUN, interface_of(ROME.robot), frozenset(SERVERS))

WANDER = """
language 1
import robot
module cruise { when true do drive(velocity = 100 mm/s, turn = 0) }
network { drive = cruise }
"""


def test_a_program_without_a_leader_is_none() -> None:
    session: Any = SimpleNamespace()
    answers = iter((SimpleNamespace(run="20260101-120000-1", servers=()), Interface()))
    connection = SimpleNamespace(do=lambda call: next(answers))
    session.connect = lambda server, name: nullcontext(connection)
    with pytest.raises(ServerNotFoundError, match="has lost its leader"):
        idle_robot(session)


class Kept:
    """A sink that keeps the frames, and a node that notes what the listener would send. Mutable."""

    def __init__(self, program: Program, idle: IdleRobot) -> None:
        self.frames: list[RunFrame] = []
        observer = idle_observer(program, idle, described_robot(program.robot).servers, self)
        self._listener = Listener(observer)
        self.address, self.listens = self._listener.address, self._listener.listens
        self.sent: list[Effect] = []

    def take(self, log: RunFrame) -> None:
        self.frames.append(log)

    def close(self) -> None:
        pass

    def start(self, now_ns: int) -> Iterable[Effect]:
        return self._noted(self._listener.start(now_ns))

    def handle(self, message: Message, now_ns: int) -> Iterable[Effect]:
        return self._noted(self._listener.handle(message, now_ns))

    def _noted(self, effects: Iterable[Effect]) -> Iterable[Effect]:
        self.sent += (found := list(effects))
        return found


def near(t_ns: int) -> Sample:
    return Sample((1000.0,) * 24, t_ns)


def test_the_robot_is_heard_before_a_program_and_after_it() -> None:
    script = Script(sonar_at=near)
    one = Robot(script.drivers, script.clock, velocity=300.0, limits=description())
    kept = Kept(ROME, IDLE)
    one.transport.add(kept)
    one.transport.at(2 * S, lambda: one.program(WANDER, seconds=2))
    one.run(7 * S)
    times = [log.tick.t_ns for log in kept.frames]
    assert times == sorted(times)
    assert not [t for t in times if 2500 * MS < t < 3800 * MS], "the program has other watchers"
    before, after = ([log for log in kept.frames if low < log.tick.t_ns < low + S] for low in (S, 5 * S))
    for log in (*before, *after):
        assert log.frame.readings["sonar"] == (1000.0,) * 24
        assert log.verdicts["drive"].outside is not None, "the joystick drives"
        assert log.verdicts["drive"].values == (300.0, 0.0)
    assert len(before) > 15
    assert len(after) > 15
    assert kept.sent == []


def test_a_robot_without_limits_is_heard_as_well() -> None:
    script = Script(sonar_at=near)
    transport = VirtualTransport(script.clock, seed=1)
    kept = Kept(ROME, IdleRobot("", Interface(), frozenset(("RServer", "PServer"))))
    for node in (
        Clock(servers=("RServer", "PServer")),
        RServer(script.drivers.base),
        PServer(script.drivers.proximity),
    ):
        transport.add(node)
    transport.add(kept)
    transport.run_until(4 * S)
    assert len(kept.frames) > 15
    assert kept.frames[-1].frame.readings["sonar"] == (1000.0,) * 24
    assert kept.frames[-1].verdicts == {}


@pytest.mark.parametrize("has_memory", [False, True])
def test_memory_of_a_description_is_unknown_until_an_epoch_begins(has_memory: bool) -> None:
    text = "robot one { frame 100 ms sensor bump : bool from RServer.bumper }\n"
    text += "state hits : number = 0\nnext hits = hits + 1\n" if has_memory else ""
    program, store = load_text(text), SnapshotStore(())
    source = LiveSource(program, store, RunTrail(program))
    sink = IdleSink(source, program)
    for k, (start, skipped) in enumerate([(0, 0), (6, 0), (6, 0), (6, 3)], 5):
        tick = Tick(k=k, t_ns=k * 100 * MS, start=start)
        frame = Frame(tick.t_ns, {"bump": False})
        unknown = start == 0 or skipped > 0
        sink.take(RunFrame(tick=tick, frame=frame, verdicts={}, skipped=skipped, memory_unknown=unknown))
    source.close()
    known = [json.loads(store.read(i))["is_known"] for i in range(4)]
    store.close()
    assert known == [not has_memory, True, True, not has_memory]
