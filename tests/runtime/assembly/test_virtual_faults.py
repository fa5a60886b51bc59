"""Sessions in which messages are lost, and processes die, freeze and come back: with a process for each
client, and with one for all."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import pytest

from colony.analysis.audit import audit
from colony.ir.expression import Binary, BinaryOperation, SensorValue, StateValue
from colony.ir.frame import MISSED
from colony.ir.program import Chain, Module, Program, State, Use, Wire
from colony.ir.types import BOOL
from colony.runtime.protocol.messages import Malformed, Message, Ready, Request, Sample, ServerFrame, Tick
from colony.runtime.transport.exchange import Link
from tests.runtime.assembly.test_virtual import MS, S, pulsing, run, script
from tests.runtime.programs import drive, go, less, nearest, roam
from tests.runtime.scripted import FAR, Log, Script, session

SERVERS = ("Clock", "RServer", "PServer", "DServer", "Runtime")


@pytest.fixture
def log() -> Log:
    return Log()


@pytest.fixture(params=[True, False], ids=["alone", "together"])
def isolate(request: pytest.FixtureRequest) -> bool:
    """Whether each client is a process of its own."""
    return bool(request.param)


def process_of(client: str, isolate: bool) -> str:
    """The process that dies with a client."""
    return client if isolate else "clients"


def fates_of(log: Log, client: str) -> list[str | None]:
    """What became of a client of `drive` in each frame; None where it was not decided."""
    return [dict(f.verdicts["drive"].fates)[client] if f.verdicts else None for f in log.frames]


def cut_off(address: str, from_ns: int) -> Link:
    """Nothing that this client says of itself arrives from then on."""

    def says(message: Message) -> bool:
        match message:
            case Request():
                return f"{message.actuator}/{message.client}" == address
            case Ready():
                return message.client == address
        return False

    def link(sender: str, receiver: str, message: Message) -> int | None:
        cut = says(message) and message.k * 50 * MS >= from_ns  # type: ignore[union-attr]
        return None if cut else 0

    return link


def test_a_client_cut_off_is_late_then_lost_and_the_robot_idles_at_the_deadline(isolate: bool) -> None:
    stage = Script()
    log = run(roam(), stage, 3 * S, link=cut_off("drive/cruise", 1 * S), isolate=isolate)
    fates = fates_of(log, "cruise")
    assert set(fates[20:25]) == {"late"}
    assert set(fates[26:]) == {"lost"}
    assert stage.told[20][0] == 20 * 50 * MS + 40 * MS
    assert stage.told[40][0] == 40 * 50 * MS
    assert all(told[1:] == (0.0, 0.0) for told in stage.told[20:])
    assert all(not f.disagreements for f in log.frames)


@pytest.mark.parametrize("dies", [True, False])
def test_with_their_process_all_clients_are_late_and_then_lost_and_come_back_with_their_memory(
    log: Log, dies: bool
) -> None:
    """The bumper was pressed at 3 s; the process is away from 6 s to 7 s, and the robot idles meanwhile."""
    whole = session(latching(), remembering(), log)
    assert [p for p in whole.processes if p not in SERVERS] == ["clients"]
    whole.transport.at(6 * S, lambda: (whole.kill if dies else whole.freeze)("clients"))
    whole.transport.at(7 * S, lambda: whole.revive("clients"))
    assert whole.run(9 * S)
    for client in ("seen", "cruise"):
        fates = fates_of(log, client)
        assert set(fates[:120]) <= {"won", "suppressed", "inactive"}
        assert set(fates[120:125]) == {"late"}
        assert set(fates[126:140]) == {"lost"}
        assert set(fates[142:]) == ({"won"} if client == "seen" else {"suppressed"})
    lost = {address for f in log.frames for address in f.tick.lost}
    assert lost == {"drive/seen", "drive/cruise"}
    assert set(log.winners()[120:140]) == {None}
    assert not any(f.restart or f.disagreements for f in log.frames)


def test_clients_of_one_process_do_not_wait_for_the_servers_of_others(log: Log) -> None:
    """What PServer has is late from 1 s on: who reads it is late, the one beside it that does not is not."""

    def slow(sender: str, receiver: str, message: Message) -> int | None:
        late = isinstance(message, ServerFrame) and message.server == "PServer" and message.k >= 20
        return 48 * MS if late and receiver.startswith("drive/") else 0

    whole = session(roam(), remembering(), log, link=slow)
    assert whole.run(4 * S)
    assert set(fates_of(log, "cruise")[20:60]) == set(fates_of(log, "avoid")[20:60]) == {"late"}
    assert set(fates_of(log, "back_off")) == {"inactive", "won"}
    assert "won" in fates_of(log, "back_off")[60:]


def test_when_the_ticks_stop_the_watchdog_stops_the_robot() -> None:
    stage, log = Script(), Log()
    whole = session(roam(), stage, log)

    def stop() -> bool:
        if stage.clock() == 1 * S and not killed:
            killed.append(whole.transport.kill("Clock"))
        return False

    killed: list[object] = []
    whole.run(3 * S, stop=stop)
    assert stage.told[-1][0] == 1 * S
    assert stage.stopped == [0, 1 * S + 100 * MS, 3 * S]


def test_late_ticks_and_frames_are_caught_up_with(isolate: bool) -> None:
    def slow_to_cruise(sender: str, receiver: str, message: Message) -> int | None:
        far = receiver == node and isinstance(message, (Tick, ServerFrame))
        return 130 * MS if far and 20 <= message.k < 25 else 0  # type: ignore[union-attr]

    node = "drive/cruise" if isolate else "drive/avoid"  # the first of those that read the same
    log = run(roam(), Script(), 3 * S, link=slow_to_cruise, isolate=isolate)
    fates = [dict(f.verdicts["drive"].fates)["cruise"] for f in log.frames]
    assert "late" in fates[20:28]
    assert "late" not in fates[30:]
    assert all(not f.disagreements for f in log.frames)


# --- processes that die and come back --------------------------------------------------------------


def near(t: int) -> Sample:
    return Sample((400.0, *FAR[1:]), t)


def missed(program: Program, log: Log) -> set[int]:
    """The frames in which a client was late or lost; in all others the interpreter's commands were sent."""
    report = audit(program, log.frames)
    assert report.agrees, report.first
    fates = [{fate for verdict in log.verdicts.values() for _, fate in verdict.fates} for log in log.frames]
    return {i for i, found in enumerate(fates) if not found or not found.isdisjoint(MISSED)}


def remembering() -> Script:
    """The bumper is pressed at 3 s; `back_off` remembers it for a second, and `seen` for good."""
    return Script(bumper_at=lambda t: 3 * S <= t < 3 * S + 50 * MS)


def latching() -> Program:
    """`seen` is active from when the bumper was pressed."""
    pressed = SensorValue(type=BOOL, name="bumper")
    program = roam()
    ever = State(
        name="ever",
        type=BOOL,
        initial=False,
        next=BinaryOperation(
            type=BOOL, operator=Binary.OR, left=StateValue(type=BOOL, name="ever"), right=pressed
        ),
    )
    seen = Module(name="seen", when=StateValue(type=BOOL, name="ever"), command=go(10.0, 1.0))
    over = Chain(relation="suppresses", operands=(Use(name="seen"), Use(name="cruise")), windows_ns=(0,))
    return replace(
        program,
        derived=(ever,),
        modules=(seen, program.modules[0]),
        wires=(Wire(name="drive", actuator="drive", wiring=over),),
        contracts=(),
    )


def test_a_client_that_is_started_anew_remembers(log: Log, isolate: bool) -> None:
    whole, process = (
        session(latching(), remembering(), log, isolate=isolate),
        process_of("drive/seen", isolate),
    )
    whole.transport.at(6 * S, lambda: whole.kill(process))
    whole.transport.at(7 * S, lambda: whole.restart(process))
    assert whole.run(9 * S)
    assert missed(latching(), log) == set(range(120, 141))
    assert log.winners()[62:120] == ["seen"] * 58
    assert log.winners()[120:141] == [None] * 21
    assert log.winners()[141:] == ["seen"] * 39
    assert not any(f.restart or f.disagreements for f in log.frames)


def test_without_dserver_it_cannot_remember_and_everyone_begins_anew(log: Log, isolate: bool) -> None:
    whole = session(latching(), remembering(), log, isolate=isolate)
    whole.transport.at(6 * S, lambda: whole.kill("DServer"))
    whole.transport.at(7 * S, lambda: whole.restart(process_of("drive/seen", isolate)))
    assert whole.run(10 * S)
    (anew,) = (f.tick.k for f in log.frames if f.restart)
    assert 140 + 20 <= anew <= 140 + 23
    assert max(missed(latching(), log)) == anew
    assert log.winners()[anew - 1 : anew + 2] == [None, "cruise" if isolate else None, "cruise"], (
        "whoever was lost when the epoch began drives in the next frame"
    )
    assert not any(f.disagreements for f in log.frames)


@pytest.mark.parametrize("server", ["PServer", "DServer", "Runtime", "RServer"])
@pytest.mark.parametrize("away_ms", [0, 60, 1000])
def test_a_server_that_is_started_anew_costs_nobody_its_memory(
    log: Log, server: str, away_ms: int, isolate: bool
) -> None:
    whole = session(roam(), script(), log, isolate=isolate)
    whole.transport.at(1 * S + 10 * MS, lambda: whole.transport.kill(server))
    whole.transport.at(1 * S + (10 + away_ms) * MS, lambda: whole.restart(server))
    assert whole.run(5 * S)
    assert [f.tick.k for f in log.frames] == list(range(100))
    assert not any(f.restart or f.disagreements for f in log.frames)
    decided = [f for f in log.frames if f.verdicts]
    assert max(missed(roam(), log), default=0) < 50
    assert len(decided) >= 100 - away_ms // 50 - 2


def test_the_clock_that_is_started_anew_goes_on(log: Log, isolate: bool) -> None:
    whole = session(latching(), remembering(), log, isolate=isolate)
    whole.transport.at(4 * S + 10 * MS, lambda: whole.restart("Clock"))
    assert whole.run(6 * S)
    (again,) = (f.tick for f in log.frames if f.tick.previous != f.tick.k - 1)
    assert (again.start, again.previous) == (0, 80)
    assert again.k > 4 * S // (50 * MS)
    assert again.t_ns <= 4 * S + 10 * MS + 300 * MS
    assert not any(f.restart or f.skipped or f.disagreements for f in log.frames)
    assert missed(latching(), log) == set()
    assert log.winners()[-1] == "seen"


def test_frozen_for_a_while_a_client_catches_up_without_asking_for_anything(isolate: bool) -> None:
    for asleep_ms in (100, 1000, 1900):
        log = Log()
        whole = session(latching(), remembering(), log, isolate=isolate)
        thaw, process = (2900 + asleep_ms) * MS, process_of("drive/seen", isolate)
        whole.transport.at(2900 * MS, partial(whole.freeze, process))
        whole.transport.at(thaw, partial(whole.revive, process))
        assert whole.run(6 * S)
        assert not any(f.restart or f.disagreements for f in log.frames)
        assert log.winners()[-1] == "seen"
        assert max(missed(latching(), log), default=0) <= thaw // (50 * MS)


@pytest.mark.parametrize("dies", [True, False])
def test_with_degrade_the_lesser_behavior_takes_over_within_a_second_and_hands_back(
    dies: bool, isolate: bool
) -> None:
    program = roam()
    degrading = replace(
        program, robot=replace(program.robot, actuators=(replace(drive(), on_loss="degrade"),))
    )
    quiet = (*program.modules[:3], Module(name="asleep", when=less(nearest(), 0.0)))
    log = Log()
    whole = session(replace(degrading, modules=quiet), Script(sonar_at=near), log, isolate=isolate)
    down = whole.kill if dies else whole.freeze
    whole.transport.at(2 * S, lambda: down("drive/avoid"))
    whole.transport.at(3500 * MS, lambda: whole.revive("drive/avoid"))
    assert whole.run(5 * S)
    winners = log.winners()
    assert winners[:40] == ["avoid"] * 40
    assert set(winners[40:60]) == {None, "cruise"}
    assert winners[60:70] == ["cruise"] * 10
    assert winners[75:] == ["avoid"] * 25
    assert not any(f.disagreements or f.restart for f in log.frames)


def test_rubbish_for_every_topic_changes_nothing(isolate: bool) -> None:
    log, plain = Log(), run(roam(), script())
    whole = session(roam(), script(), log, isolate=isolate)

    def throw() -> None:
        for address in whole.transport.addresses:
            for topic in ("Clock/ticks", f"{address}/frames", f"{address}/requests", f"{address}/call"):
                whole.transport.inject(topic, Malformed(topic=topic, connection=None, reason="rubbish"))

    for t in range(0, 5 * S, 330 * MS):
        whole.transport.at(t, throw)
    assert whole.run(5 * S)
    assert log.winners() == plain.winners()


# --- modules in Python ---------------------------------------------------------------------------


@pytest.mark.parametrize(("address", "late_ns"), [("drive/pulse", 10 * MS), ("DServer", 0)])
def test_a_client_of_a_module_in_python_or_dserver_that_is_started_anew_goes_on(
    log: Log, address: str, late_ns: int, isolate: bool
) -> None:
    whole = session(pulsing(), Script(), log, isolate=isolate)
    process = address if address in SERVERS else process_of(address, isolate)
    whole.transport.at(3 * S + late_ns, lambda: whole.restart(process))
    assert whole.run(5 * S)
    assert not any(f.restart or f.disagreements for f in log.frames)
    assert log.winners()[66:] == ["cruise", "cruise", "pulse"] * 11 + ["cruise"]


def test_an_object_in_python_that_is_gone_makes_everyone_begin_anew(log: Log, isolate: bool) -> None:
    whole = session(pulsing(), Script(), log, isolate=isolate)
    whole.transport.at(3 * S + 10 * MS, lambda: whole.restart("DServer/activity/pulse"))
    assert whole.run(5 * S)
    (anew,) = (f.tick.k for f in log.frames if f.restart)
    assert anew <= 63
    assert log.winners()[anew:] == (["cruise", "cruise", "pulse"] * 40)[: 100 - anew]
    assert not any(f.disagreements for f in log.frames)
