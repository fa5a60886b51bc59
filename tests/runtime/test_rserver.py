"""RServer: fields of the base, one command a frame, and a watchdog."""

from __future__ import annotations

from colony.runtime.arbitration import timing
from colony.runtime.bindings import ActuatorBinding
from colony.runtime.fields import RSERVER
from colony.runtime.messages import Request, Send, ServerFrame, Tick, Verdict, Wake, WakeAt
from colony.runtime.servers.commanding import Commanded
from colony.runtime.servers.rserver import RServer
from tests.runtime.runtime_programs import drive
from tests.runtime.scripted import Script

MS = 1_000_000


def server(script: Script, places: tuple[int | None, ...] = (0, 1)) -> RServer:
    binding = ActuatorBinding(actuator="drive", server="RServer", command="drive", places=places)
    commanded = Commanded(actuator=drive(), binding=binding, places=("go",))
    return RServer(script, (commanded,), times=timing(50 * MS), watchdog_ns=250 * MS, keep=4)


def tick(k: int) -> Tick:
    return Tick(k=k, t_ns=k * 50 * MS)


def go(k: int, *values: float) -> Request:
    return Request(k=k, actuator="drive", client="go", bid="command", values=values)


def frame_of(one: RServer, k: int) -> ServerFrame:
    (message,) = (
        e.message
        for e in one.handle(tick(k), k * 50 * MS)
        if isinstance(e, Send) and isinstance(e.message, ServerFrame)
    )
    return message


def test_it_has_exactly_the_documented_fields() -> None:
    assert set(frame_of(server(Script()), 0).fields) == {f.name for f in RSERVER.fields}


def test_the_settings_are_the_command_sent_last() -> None:
    script = Script()
    one = server(script)
    list(one.handle(tick(0), 0))
    effects = list(one.handle(go(0, 300.0, -10.0), MS))
    assert script.told == [(0, 300.0, -10.0)]
    assert any(isinstance(e, Send) and isinstance(e.message, Verdict) for e in effects)
    fields = frame_of(one, 1).fields
    assert [fields[n].value for n in ("speed_setting", "turn_setting")] == [300.0, -10.0]  # type: ignore[union-attr]


def test_parameters_are_passed_by_name_and_what_is_not_declared_is_0() -> None:
    for places, expected in (((1, 0), (7.0, 5.0)), ((None, 1), (0.0, 7.0))):
        script = Script()
        one = server(script, places)
        list(one.handle(tick(0), 0))
        list(one.handle(go(0, 5.0, 7.0), 0))
        assert script.told == [(0, *expected)]


def test_the_watchdog_barks_when_no_command_is_dispatched_any_more() -> None:
    script = Script()
    one = server(script)
    list(one.handle(tick(0), 0))
    wakes = [e.t_ns for e in one.handle(go(0, 300.0, 0.0), 10 * MS) if isinstance(e, WakeAt)]
    assert wakes == [260 * MS]
    list(one.handle(tick(1), 50 * MS))
    list(one.handle(go(1, 300.0, 0.0), 60 * MS))
    assert [e.t_ns for e in one.handle(Wake(), 260 * MS) if isinstance(e, WakeAt)] == [310 * MS]
    assert script.stopped == []
    assert list(one.handle(Wake(), 310 * MS)) == []
    assert len(script.stopped) == 1
    assert list(one.handle(Wake(), 400 * MS)) == []
    assert len(script.stopped) == 1


def test_closing_stops_the_base() -> None:
    script = Script()
    server(script).close()
    assert len(script.stopped) == 1


def test_a_base_that_gave_nothing_yet_has_no_values() -> None:
    class Mute(Script):
        def state(self) -> None:
            return None

    fields = frame_of(server(Mute()), 0).fields
    assert set(fields) == {"speed_setting", "turn_setting"}
