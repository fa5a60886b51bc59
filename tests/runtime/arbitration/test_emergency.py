"""The emergency stop of a whole robot: whoever hears it stops, and it holds until the Clock releases it."""

from __future__ import annotations

import os
import signal
from typing import Any

import msgspec
import pytest

from colony.runtime.assembly.virtual import VirtualSession
from colony.runtime.kit.emergency import StopButton, StopReport
from colony.runtime.kit.errors import CallRefusedError
from colony.runtime.library import clock as clock_library
from colony.runtime.library import data, emergency
from colony.runtime.library.ask import CallRequest
from colony.runtime.library.clock import deploy
from colony.runtime.protocol import topics
from colony.runtime.protocol.messages import ServerFrame, Stopped, Tick
from tests.cli.machine import MAP, ROBOT, WANDER, Machine, release
from tests.kit.calling import call_of, opening
from tests.kit.data import LAMP, DataStage, program, request
from tests.kit.node_stage import MS, S, messages
from tests.runtime.programs import roam
from tests.runtime.scripted import Log, Script, session
from tests.waiting import until

# --- among all servers, in virtual time ------------------------------------------------------------


def at(whole: VirtualSession, t_ns: int, server: str, ask: CallRequest[Any], number: int = 1) -> None:
    call = call_of(ask, "ann/1", number)
    whole.transport.at(t_ns, lambda: whole.transport.inject(topics.calls(server), call))


def moved(script: Script, since_ns: int, until_ns: int) -> bool:
    """Whether anything but zero was sent to the base in the meantime."""
    return any(since_ns <= t < until_ns and (v, w) != (0.0, 0.0) for t, v, w in script.told)


@pytest.mark.parametrize("server", ["RServer", "Clock"])
def test_a_stop_that_one_server_heard_holds_everywhere_until_the_clock_releases_it(server: str) -> None:
    script, log = Script(), Log()
    whole = session(roam(), script, log)
    at(whole, 1 * S, server, emergency.stop())
    at(whole, 3 * S, "Clock", opening("ann"))
    at(whole, 3 * S + 1, "Clock", clock_library.release(), 2)
    assert whole.run(4 * S)
    assert moved(script, 0, 1 * S)
    assert not moved(script, 1 * S + 51 * MS, 3 * S)
    assert moved(script, 3 * S + 50 * MS, 4 * S)
    holds = [f.verdicts["drive"].hold for f in log.frames]
    assert set(holds[22:60]) == {"stopped"}
    assert set(holds[62:]) == {None}
    assert not any(f.disagreements for f in log.frames)


@pytest.mark.parametrize("killed", ["RServer", "Clock"])
def test_it_survives_the_death_of_any_one_of_them(killed: str) -> None:
    script = Script()
    whole = session(roam(), script, Log())
    at(whole, 1 * S, "RServer", emergency.stop())
    whole.transport.at(2 * S, lambda: whole.restart(killed))
    assert whole.run(4 * S)
    assert moved(script, 0, 1 * S)
    assert not moved(script, 1 * S + 1, 4 * S)


# --- DServer's actuators ---------------------------------------------------------------------------

IDLE_LAMP = msgspec.structs.replace(LAMP, idle=(False,))


@pytest.fixture
def lit() -> DataStage:
    """A lamp that the program has lit in frame 1."""
    stage = DataStage()
    leader = stage.connect("ada/leader")
    leader.do(deploy(msgspec.structs.replace(program("run", IDLE_LAMP), reads=("Lamp",))))
    stage.tick(1)
    stage.handle(request(1, "lamp", True))
    assert leader.do(data.get("Lamp")) is True
    return stage


def lamp(stage: DataStage) -> bool:
    found = stage.node._variables.current("Lamp")
    return bool(msgspec.msgpack.decode(found.data))


def test_a_stop_makes_variables_idle_at_once_and_says_so_in_frames(lit: DataStage) -> None:
    lit.handle(call_of(emergency.stop(), "ann/1"))
    assert not lamp(lit)
    (frame,) = messages(lit.tick(2), ServerFrame)
    assert frame.stopped is not None
    lit.handle(request(2, "lamp", True))
    assert not lamp(lit), "and stay idle"


def test_an_old_tick_does_not_bring_back_a_stop(lit: DataStage) -> None:
    stopped, now = Stopped(by="ann/1", t_ns=lit.now_ns), lit.now_ns
    lit.handle(Tick(k=2, t_ns=now, run="run", stopped=stopped))
    lit.handle(Tick(k=3, t_ns=now, run="run", released_ns=now))
    lit.handle(Tick(k=2, t_ns=now, run="run", stopped=stopped))
    lit.handle(request(3, "lamp", True))
    assert lamp(lit)


def test_variables_become_idle_when_the_ticks_stop(lit: DataStage) -> None:
    lit.pass_time(100 * MS)
    assert lamp(lit)
    lit.pass_time(30 * MS)
    assert not lamp(lit)


def test_what_is_held_when_idle_is_left_as_it_is() -> None:
    stage = DataStage()
    leader = stage.connect("ada/leader")
    leader.do(deploy(program("run", LAMP)))
    stage.tick(1)
    stage.handle(request(1, "lamp", True))
    stage.handle(call_of(emergency.stop(), "ann/1"))
    stage.pass_time(500 * MS)
    assert lamp(stage)


# --- the button, at real processes -----------------------------------------------------------------


def serving(machine: Machine, *servers: str) -> None:
    for server in servers:
        started = machine.start(
            "serve", server, "--robot", ROBOT, *(("--map", MAP) if server == "all" else ())
        )
        until(lambda s=started: s.ended() or "Ctrl-C ends" in s.err, f"{server} runs")  # type: ignore[misc]
    awaited = {"Clock", "RServer", "DServer"} if "all" in servers else set(servers)
    with machine.session() as session:
        until(lambda: awaited <= set(session.servers()), f"{awaited} are there")


@pytest.mark.long
def test_a_button_stops_all_and_tells_who_acknowledged(machine: Machine) -> None:
    serving(machine, "all")
    run = machine.start("drive", WANDER, "--set", "DockedAt=0")
    until(lambda: run.ended() or machine.moves(), "the robot drives")
    with machine.session() as session, StopButton(session) as button:
        pressed = button.press()
        assert pressed.problems == {}
        assert set(pressed.acknowledged) == {"Clock", "RServer", "DServer"}
        assert pressed.kept
        until(machine.stands, "the robot stands")
        assert button.press().kept, "again"
        release(session)
        until(machine.moves, "the robot drives on")


@pytest.mark.parametrize("is_started_again", [False, True])
def test_a_server_that_ends_before_it_acknowledges_is_waited_for(
    machine: Machine, monkeypatch: pytest.MonkeyPatch, is_started_again: bool
) -> None:
    serving(machine, "Clock", "RServer")
    pid = machine.pid("RServer")
    assert pid is not None
    with (
        machine.session() as session,
        StopButton(session, timeout_s=60.0 if is_started_again else 1.0) as button,
    ):
        collect = button._collect

        def end_and_collect(*arguments: Any) -> StopReport:
            os.kill(pid, signal.SIGKILL)
            until(lambda: machine.pid("RServer") is None and "RServer" not in session.servers(), "it ends")
            if is_started_again:
                machine.start("serve", "RServer", "--robot", ROBOT)
            return collect(*arguments)

        monkeypatch.setattr(button, "_collect", end_and_collect)
        os.kill(pid, signal.SIGSTOP)
        pressed = button.press()
    assert pressed.kept == is_started_again
    assert ("RServer" in pressed.acknowledged) == is_started_again
    assert ("RServer" in pressed.problems) != is_started_again


def test_without_a_clock_the_servers_stop_and_it_is_not_kept(machine: Machine) -> None:
    serving(machine, "RServer")
    with machine.session() as session, StopButton(session, timeout_s=20.0) as button:
        pressed = button.press()
    assert pressed.acknowledged == ("RServer",)
    assert not pressed.kept
    assert "the Clock is down" in pressed.problems["Clock"]


def test_the_clock_alone_keeps_it(machine: Machine) -> None:
    serving(machine, "Clock")
    with machine.session() as session:
        with StopButton(session, timeout_s=20.0) as button:
            assert button.press().kept
        with session.connect("Clock") as clock:
            clock.do(clock_library.release())
        with session.connect("Clock") as clock, pytest.raises(CallRefusedError, match="no method `halt`"):
            clock.do(emergency.stop()._replace(method="halt"))


def test_a_stop_that_arrives_again_after_the_release_is_no_other_stop() -> None:
    """It comes by two links from the gateway, and is sent again when its answer was lost."""
    script = Script()
    whole = session(roam(), script, Log())
    at(whole, 1 * S, "RServer", emergency.stop(), 7)
    at(whole, 2 * S, "Clock", opening("ann"))
    at(whole, 2 * S + 1, "Clock", clock_library.release(), 2)
    at(whole, 3 * S, "RServer", emergency.stop(), 7)
    assert whole.run(4 * S)
    assert not moved(script, 1 * S + 1, 2 * S)
    assert moved(script, 3 * S + 50 * MS, 4 * S)
