"""Servers written with the kit: methods, fields of frames, what they say of themselves, how they end."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator, Mapping

import pytest

from colony.ir.program import Sensor
from colony.ir.servers import FieldSpec
from colony.ir.types import BOOL, DIMENSIONLESS, Array, Quantity
from colony.runtime.kit.connection import Session, connect
from colony.runtime.kit.description import Description, FieldDescription, describe, field_type, server_spec
from colony.runtime.kit.errors import CallRefusedError
from colony.runtime.kit.server import Offer, Server, Servers, field
from colony.runtime.protocol import topics
from colony.runtime.protocol.bindings import SensorBinding, bind
from colony.runtime.protocol.messages import Effect, Fetch, Message, Send, ServerFrame, Tick, Wake, WakeAt
from colony.runtime.transport.live.errors import AlreadyRunningError
from colony.text.diagnostics import DiagnosticError
from colony.text.units import LENGTH, TIME
from tests.robot_servers import ROME_SERVERS
from tests.runtime.kit.stage import (
    BATTERY,
    Battery,
    battery_process,
    battery_thread,
    level,
    plain,
    several_process,
)
from tests.runtime.programs import robot
from tests.runtime.transport.live.stage import ROBOT, Recorder, hosted
from tests.waiting import until


class _Ticking(Recorder):
    """A Clock of sorts: ticks until a frame of each server came, and then asks for the first again."""

    def __init__(self, *servers: str) -> None:
        frames = map(topics.frames, servers)
        super().__init__(topics.CLOCK, *frames, on=self._tick, begin=lambda now: [WakeAt(now)])
        self.servers = set(servers)
        self.k = 0

    @property
    def frames(self) -> list[ServerFrame]:
        return [message for message in self.got if isinstance(message, ServerFrame)]

    def _tick(self, message: Message, now_ns: int) -> Iterator[Effect]:
        if isinstance(message, Wake) and {frame.server for frame in self.frames} != self.servers:
            self.k += 1
            yield Send(topics.TICKS, Tick(k=self.k, t_ns=now_ns))
            yield WakeAt(now_ns + 5_000_000)
        elif isinstance(message, ServerFrame) and len(self.frames) == 1:
            yield Send(topics.fetches(message.server), Fetch(server=message.server, k=message.k))


def test_its_fields_are_in_the_frames_also_in_those_that_are_asked_for_again(
    environment: Mapping[str, str],
) -> None:
    reports: list[str] = []
    clock = _Ticking(BATTERY)
    with battery_thread(environment, report=reports.append), hosted(environment, [clock]):
        until(
            lambda: sum(frame.k == clock.frames[0].k for frame in clock.frames) >= 2, "the same frame twice"
        )
    first, *others = clock.frames
    assert first in others
    values = {name: sample and sample.value for name, sample in first.fields.items()}
    assert values == {"level": 0.5, "cells": (3.0, 4.0), "broken": None, "nothing": None}
    assert "Battery.broken failed" in reports[0]
    assert "ZeroDivisionError" in reports[0]


def test_it_says_what_it_has_so_that_programs_can_be_bound_to_it(environment: Mapping[str, str]) -> None:
    with (
        battery_thread(environment),
        Session.open(ROBOT, environment=environment) as session,
        session.connect(BATTERY) as connection,
    ):
        description = connection.do(describe())
    spec = server_spec(description)
    assert [(m.name, m.right) for m in description.methods][:2] == [("level", "read"), ("charge", "command")]
    assert spec.name == BATTERY
    assert spec.fields == (
        FieldSpec("level", DIMENSIONLESS, "how full it is, 0 to 1", has_age=False),
        FieldSpec("cells", Array(DIMENSIONLESS, 2), "", has_age=True),
        FieldSpec("broken", DIMENSIONLESS, "", has_age=False),
        FieldSpec("nothing", BOOL, "", has_age=False),
    )


def test_units_of_fields() -> None:
    speed = FieldDescription(name="speed", kind="number", unit="mm/s")
    assert field_type(speed) == Quantity(LENGTH.over(TIME))
    assert field("far", lambda: 1.0, unit="m").description.unit == "mm"
    far = FieldDescription(name="far", kind="number", unit="m")
    with pytest.raises(ValueError, match="far: the unit `m`; expected base units: mm, s, deg"):
        server_spec(Description(server="S", fields=(far,)))
    with pytest.raises(ValueError, match="`parsec` is not a unit"):
        server_spec(
            Description(server="S", fields=(FieldDescription(name="d", kind="number", unit="parsec"),))
        )


def test_what_a_handler_raises_is_reported_and_the_server_lives_on(environment: Mapping[str, str]) -> None:
    reports: list[str] = []
    with (
        battery_thread(environment, report=reports.append),
        connect(BATTERY, robot=ROBOT, environment=environment) as connection,
    ):
        with pytest.raises(CallRefusedError, match=r"Battery\.fail failed: ZeroDivisionError") as refused:
            connection.do(plain("fail"))
        assert refused.value.code == "failed"
        assert connection.do(level()) == 0.5
    assert "Traceback" in reports[0]


def test_its_name_is_taken_as_long_as_it_is_open(environment: Mapping[str, str]) -> None:
    with (
        battery_thread(environment),
        pytest.raises(AlreadyRunningError, match="Battery of rome is already running"),
    ):
        Server.open(BATTERY, robot=ROBOT, environment=environment)
    Server.open(BATTERY, robot=ROBOT, environment=environment).close()


def test_a_loop_that_was_ended_before_it_began_ends(environment: Mapping[str, str]) -> None:
    with Server.open(BATTERY, robot=ROBOT, environment=environment) as server:
        server.exitloop()
        serving = threading.Thread(target=server.mainloop, args=(Battery().methods(),))
        serving.start()
        serving.join(20)
        assert not serving.is_alive()


def test_several_servers_share_a_process(environment: Mapping[str, str]) -> None:
    with several_process(environment) as process, Session.open(ROBOT, environment=environment) as session:
        lidar, button = session.connect("Lidar"), session.connect("Button")
        assert [f.name for f in lidar.do(describe()).fields] == ["scan"]
        assert [f.name for f in button.do(describe()).fields] == ["pressed"]
        assert button.do(plain("press")) == "Button was pressed"
        with pytest.raises(CallRefusedError, match="Lidar has no method `press`"):
            lidar.do(plain("press"))
        with pytest.raises(AlreadyRunningError, match=f"Button of rome is already .* process {process.pid}"):
            Server.open("Button", robot=ROBOT, environment=environment)
        process.send_signal(signal.SIGTERM)
        assert process.wait(20) == 0
    with Servers.open("Lidar", "Button", robot=ROBOT, environment=environment):
        pass


def test_frames_of_several_servers_of_a_process(environment: Mapping[str, str]) -> None:
    clock = _Ticking("Lidar", "Button")
    with several_process(environment), hosted(environment, [clock]):
        until(lambda: {frame.server for frame in clock.frames} == {"Lidar", "Button"}, "frames of both")
    fields = {frame.server: frame.fields for frame in clock.frames}
    assert {server: list(names) for server, names in fields.items()} == {
        "Lidar": ["scan"],
        "Button": ["pressed"],
    }


def test_names_of_several_servers_must_be_right(environment: Mapping[str, str]) -> None:
    for names in ((), ("Lidar", "Lidar")):
        with pytest.raises(ValueError, match="expected one or more, each once"):
            Servers.open(*names, robot=ROBOT, environment=environment)
    with Servers.open("Lidar", "Button", robot=ROBOT, environment=environment) as servers:
        for offered in ({}, {"Lidar": Offer()}, {"Lidar": Offer(), "Button": Offer(), "Lift": Offer()}):
            with pytest.raises(ValueError, match="expected Lidar, Button"):
                servers.mainloop(offered)
    with Server.open("Button", robot=ROBOT, environment=environment):  # nothing of it is left
        pass


def test_a_signal_ends_the_loop(environment: Mapping[str, str]) -> None:
    with battery_process(environment) as process:
        process.send_signal(signal.SIGTERM)
        assert process.wait(20) == 0


def test_a_program_reads_it() -> None:
    described = Description(
        server=BATTERY,
        fields=(FieldDescription(name="level", kind="number"), FieldDescription(name="full", kind="bool")),
    )
    servers = (*ROME_SERVERS, server_spec(described))
    sensor = Sensor(name="charged", type=BOOL, server=BATTERY, field="full")
    bindings = bind(robot(sensor), servers)
    assert bindings.sensors[-1] == SensorBinding(
        sensor="charged", server=BATTERY, field="full", max_age_ns=None, factor=1.0
    )
    wrong = Sensor(name="charged", type=BOOL, server=BATTERY, field="level")
    with pytest.raises(DiagnosticError, match=r"Battery\.level is number, not bool"):
        bind(robot(wrong), servers)
