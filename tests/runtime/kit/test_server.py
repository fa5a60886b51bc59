"""Servers written with the kit: methods, fields of frames, what they say of themselves, how they end."""

from __future__ import annotations

import signal
import threading
from collections.abc import Mapping

import pytest

from colony.ir.program import Sensor
from colony.ir.servers import FieldSpec
from colony.ir.types import BOOL, DIMENSIONLESS, Array, Quantity
from colony.runtime.kit.connection import Session
from colony.runtime.kit.description import (
    Description,
    FieldDescription,
    FieldReader,
    describe,
    field_type,
    server_spec,
)
from colony.runtime.kit.errors import CallRefusedError
from colony.runtime.kit.server import Offer, Server, Servers, field
from colony.runtime.kit.service import Service
from colony.runtime.protocol.bindings import SensorBinding, bind
from colony.runtime.protocol.messages import Fetch, ServerFrame, Tick
from colony.runtime.transport.live.run_directory import AlreadyRunningError
from colony.text.diagnostics import DiagnosticError
from colony.text.units import LENGTH, TIME
from tests.kit.node_stage import Caller, NodeStage, messages
from tests.robot_servers import ROME_SERVERS
from tests.runtime.kit.stage import (
    BATTERY,
    Battery,
    battery_thread,
    level,
    plain,
    several_process,
)
from tests.runtime.programs import robot
from tests.runtime.transport.live.stage import ROBOT


@pytest.fixture
def reports() -> list[str]:
    return []


@pytest.fixture
def ada(reports: list[str]) -> Caller:
    battery = Battery()
    fields = FieldReader(BATTERY, battery.fields(), reports.append)
    return NodeStage(Service(BATTERY, battery.methods(), fields, reports.append)).connect()


def test_its_fields_are_in_the_frames_also_in_those_that_are_asked_for_again(
    ada: Caller, reports: list[str]
) -> None:
    frame, *_ = messages(ada.stage.handle(Tick(k=1, t_ns=0)), ServerFrame)
    assert messages(ada.stage.handle(Fetch(server=BATTERY, k=1)), ServerFrame)[0] == frame
    values = {name: sample and sample.value for name, sample in frame.fields.items()}
    assert values == {"level": 0.5, "cells": (3.0, 4.0), "broken": None, "nothing": None}
    [report] = reports
    assert "Battery.broken failed" in report
    assert "ZeroDivisionError" in report


def test_it_says_what_it_has_so_that_programs_can_be_bound_to_it(ada: Caller) -> None:
    description = ada.do(describe())
    spec = server_spec(description)
    assert [(m.name, m.right) for m in description.methods][:2] == [("level", "read"), ("charge", "command")]
    assert spec.name == BATTERY
    assert spec.fields == (
        FieldSpec("level", DIMENSIONLESS, "how full it is, 0 to 1", has_age=False),
        FieldSpec("cells", Array(DIMENSIONLESS, 2), "", has_age=True),
        FieldSpec("broken", DIMENSIONLESS, "", has_age=False),
        FieldSpec("nothing", BOOL, "", has_age=False),
    )


def test_what_a_handler_raises_is_reported_and_the_server_lives_on(ada: Caller, reports: list[str]) -> None:
    assert ada.refusal(plain("fail")) == "failed"
    assert ada.do(level()) == 0.5
    [report] = reports
    assert "Traceback" in report


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
