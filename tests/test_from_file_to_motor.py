"""From one text to one command at the motor, by the real nodes in virtual time: nothing is done twice."""

from __future__ import annotations

from collections import Counter

import pytest

from colony.compile.pipeline import compile_program
from colony.dsl.load import load_text
from colony.execute import machine, sensors
from colony.execute.sensors import Records
from colony.ir.frame import Reading
from colony.ir.program import Sensor
from colony.ir.types import Value
from colony.runtime.assembly.virtual import Session
from colony.runtime.protocol.bindings import SensorBinding
from colony.runtime.protocol.messages import Sample
from tests.runtime.scripted import FAR, Log, Script

TEXT = """
robot rome {
  sensor   sonar[24] : m   from PServer.sonar   within 200 ms
  sensor   limit     : m/s from DServer.Limit
  actuator drive { velocity : m/s range 0 .. 1, turn : deg/s }
           to RServer.drive  idle drive(velocity = 0, turn = 0)
}
module stop   { when sonar[12] < 1 m  do drive(velocity = 0, turn = 30 deg/s) }
module cruise { when true             do drive(velocity = limit, turn = 0) }
network { drive = stop suppresses cruise }
"""
FRAMES = 4
FRAME_NS = 50_000_000
LIMIT = 0.3
NEAR = (*FAR[:12], 999.9, *FAR[13:])


def test_each_reading_is_converted_once_and_each_command_once(monkeypatch: pytest.MonkeyPatch) -> None:
    converted, entered = Counter[tuple[str, str]](), Counter[tuple[str, float]]()

    def counting(name: str) -> None:
        original = getattr(SensorBinding, name)

        def convert(binding: SensorBinding, value: Value) -> Value:
            converted[name, binding.sensor] += 1
            found: Value = original(binding, value)
            return found

        monkeypatch.setattr(SensorBinding, name, convert)

    def take(sensor: Sensor, reading: Reading, records: Records) -> tuple[Value, bool, Records]:
        entered[sensor.name, sensor.factor] += 1
        return sensors.take(sensor, reading, records)

    counting("in_base_units")
    counting("in_declared_unit")
    monkeypatch.setattr(machine, "take", take)

    program = load_text(TEXT)
    log = Log()
    script = Script(sonar_at=lambda t: Sample(FAR if t < 2 * FRAME_NS else NEAR, t))
    session = Session(
        program,
        compile_program(program).clients,
        script.drivers,
        clock=script.clock,
        seed=1,
        variables={"Limit": LIMIT},
        sinks=(log,),
    )
    session.run(FRAMES * FRAME_NS)

    # base units from the servers' frames to the motor
    assert [command[1:] for command in script.told[-FRAMES:]] == [(300.0, 0.0)] * 2 + [(0.0, 30.0)] * 2
    # each client has each of its readings converted once, where its frame is made, and computes with that
    for sensor, clients in (("sonar", 2), ("limit", 1)):  # the guard of `cruise` reads the sonar, too
        assert converted["in_base_units", sensor] == clients * FRAMES
        assert entered[sensor, 1.0] == clients * FRAMES
    # the observer has the declared units that people read, and its monitor converts them once
    assert converted["in_declared_unit", "sonar"] == converted["in_declared_unit", "limit"] == FRAMES
    assert entered["limit", 1000.0] == entered["sonar", 1000.0] == FRAMES
    assert len(entered) == 4
    assert log.frames[0].frame.readings == {"sonar": tuple(x / 1000.0 for x in FAR), "limit": LIMIT}
    assert [frame.verdicts["drive"].values for frame in log.frames] == [(LIMIT, 0.0)] * 2 + [(0.0, 30.0)] * 2
    assert not any(frame.disagreements for frame in log.frames)
