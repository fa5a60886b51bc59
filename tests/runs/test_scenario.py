"""Scenarios: what a program reads that nobody simulates, over time."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from colony.ir.program import Robot, Sensor
from colony.ir.servers import FieldSpec
from colony.ir.types import BOOL, DISTANCE, Array, Quantity, Value
from colony.runs.scenario import (
    ReadingChange,
    Scenario,
    ScenarioError,
    described_sensor,
    player,
    read_scenario,
    setting,
)
from colony.runtime.kit.script import Do, Sleep

S = 1_000_000_000


def sensor(name: str, server: str, field: str, type_: object = BOOL, factor: float = 1.0) -> Sensor:
    return Sensor(name=name, type=type_, factor=factor, server=server, field=field)  # type: ignore[arg-type]


ESTOP = sensor("estop", "Panel", "estop")
POSE = sensor("pose_x", "DServer", "PoseX", DISTANCE, 1000.0)
SCAN = sensor("scan", "Lidar", "scan", Array(DISTANCE, 2), 1000.0)
GAS = sensor("gas", "Nose", "gas", Quantity(written="percent"), 0.01)
ROBOT = Robot(name="amr", sensors=(ESTOP, POSE, SCAN, GAS, sensor("bumper", "RServer", "bumper")))

TEXT = """
# a stop of three seconds
at 12 s   estop = true    # pressed
at 15s    estop = false, pose_x = 2 m
at 500 ms scan = [1, 250 mm]
at 20     PoseX = missing, Panel.estop = true
"""


def scenario(tmp_path: Path, text: str) -> Scenario:
    path = tmp_path / "a.scenario"
    path.write_text(text)
    return read_scenario(str(path), ROBOT)


def test_values_hold_until_the_next(tmp_path: Path) -> None:
    found = scenario(tmp_path, TEXT)
    assert [found.value_at("Panel", "estop", t * S) for t in (0, 11, 12, 14, 15, 20)] == [
        *(None, None, True, True, False, True)
    ]
    assert found.value_at("Lidar", "scan", S // 2 - 1) is None
    assert found.value_at("Lidar", "scan", S // 2) == (1000.0, 250.0)  # in base units
    assert found.value_at("Lidar", "temperature", S) is None
    assert [found.value_at("DServer", "PoseX", t * S) for t in (14, 15, 20)] == [None, 2000.0, "missing"]
    assert [(c.t_ns, c.value) for c in found.variables] == [(15 * S, 2.0), (20 * S, None)]  # as declared
    assert found
    assert not Scenario()


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("estop = true", "found `estop = true`; expected `at TIME NAME = VALUE`"),
        ("at 3 mm estop = true", "expected `at TIME NAME = VALUE`"),
        ("at -1 s estop = true", "expected `at TIME NAME = VALUE`"),
        ("at 1 s estop", "found `estop`; expected NAME=VALUE"),
        ("at 1 s estop =", "estop: found ``; expected true or false"),
        ("at 1 s stop = true", "no sensor reads `stop`; did you mean `estop`?"),
        ("at 1 s bumper = true", "`bumper` cannot be given: the simulated base measures it"),
        ("at 1 s scan = [1]", "scan: found 1 value; expected 2"),
        ("at 1 s scan = []", "scan: found 0 values; expected 2"),
        ("at 1 s pose_x = 1e308 km", "pose_x: found `1e308 km`; expected a number in mm"),
        ("at 1 s scan = [1, 1e307]", "scan: found `1e307`; expected a number in mm"),  # of m
        ("at 1 s estop = true,", "found ``; expected NAME=VALUE"),
        (f"at 1 s estop = {'x' * 9999}", f"estop: found `{'x' * 60}...`; expected true or false"),
        (f"at 1 s scan = {'x' * 9999}", f"scan: found `{'x' * 60}...`; expected a number in mm, cm or m"),
        ("at 1 s scan = [1", "scan: found `[1`; expected a list of 2"),
        ("at 1 s gas = 30 mm", "gas: found `30 mm`; expected a number in percent"),
        (
            "at 1 s gas = 30percnt",
            "gas: found `30percnt`; expected a number in percent; did you mean `percent`?",
        ),
        (f"at 1 s {'x' * 9999} = 1", f"no sensor reads `{'x' * 60}...`; "),
        (f"at 1 s {'x' * 9999}", f"found `{'x' * 60}...`; expected NAME=VALUE"),
        ("x" * 9999, f"found `{'x' * 60}...`; expected `at TIME"),
        ("at 1 s estop = true, estop = false", "`estop` has a value at this time already, in line 2"),
        ("at 1 s pose_x = 1, PoseX = 1", "`pose_x` has a value at this time already, in line 2"),
    ],
)
def test_lines_that_are_none(tmp_path: Path, line: str, message: str) -> None:
    with pytest.raises(ScenarioError) as failed:
        scenario(tmp_path, f"# first\n{line}\n")
    assert str(failed.value).startswith(f"{tmp_path / 'a.scenario'}:2: error: ")
    assert message in str(failed.value)


def test_a_second_value_at_one_time_is_an_error_in_a_later_line_too(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=r"a\.scenario:3: error: `estop` has a value .* in line 1"):
        scenario(tmp_path, "at 1 s estop = true\nat 2 s estop = true\nat 1000 ms Panel.estop = false\n")


def test_a_file_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match="cannot read the scenario: No such file"):
        read_scenario(str(tmp_path / "no.scenario"), ROBOT)
    (tmp_path / "latin.scenario").write_bytes(b"\xff")
    with pytest.raises(ScenarioError, match="it is not UTF-8"):
        read_scenario(str(tmp_path / "latin.scenario"), ROBOT)


@pytest.mark.parametrize(
    ("field", "text", "expected"),
    [
        (FieldSpec("gas", Quantity(), "", declared="percent"), "30", 0.3),
        (FieldSpec("gas", Quantity(), "", declared="percent"), "30 percent", 0.3),
        (FieldSpec("gas", Quantity(), ""), "30", 30.0),
        (FieldSpec("gas", Quantity(), ""), "30 percent", 0.3),
        (FieldSpec("scan", Array(DISTANCE, 2), "", declared="m"), "2", (2000.0, 2000.0)),
        (FieldSpec("scan", Array(DISTANCE, 2), "", declared="m"), "[1, 250 mm]", (1000.0, 250.0)),
        (FieldSpec("scan", Array(DISTANCE, 2), ""), "2", (2.0, 2.0)),
        (FieldSpec("cliff", Array(BOOL, 2), ""), "true", (True, True)),
    ],
)
def test_a_value_of_a_described_field_is_in_its_declared_unit(
    field: FieldSpec, text: str, expected: Value
) -> None:
    described = described_sensor("Nose", field)
    assert setting(Robot(name="amr", sensors=(described,)), f"{described.name}={text}").given == expected


def test_changes_of_devices_are_in_base_units(tmp_path: Path) -> None:
    found = scenario(tmp_path, TEXT)
    assert [(c.t_ns, c.sensor.name, c.given) for c in found.fields] == [
        (S // 2, "scan", (1000.0, 250.0)),
        *((t * S, "estop", pressed) for t, pressed in ((12, True), (15, False), (20, True))),
    ]
    assert ReadingChange(0, ESTOP, None).given == "missing"


def test_time_stands_at_0_until_the_run_begins() -> None:
    begin_ns: list[int] = []
    changes = (ReadingChange(0, POSE, 1.0), ReadingChange(S // 10, POSE, 2.0))
    script = player(changes, lambda: begin_ns[0] if begin_ns else None, {"Other": 3.0})
    now, step, done = 0, next(script), list[dict[str, float]]()
    while len(done) < 6:
        match step:
            case Sleep(seconds):
                now += round(seconds * 1e9)
                step = script.send(now)
            case Do(_, call):
                done.append(msgspec.msgpack.decode(call.arguments.values))  # type: ignore[attr-defined]
                if len(done) == 3:
                    begin_ns.append(now)
                step = script.send(None)
    assert done == [{"Other": 3.0, "PoseX": value} for value in (1.0, 1.0, 1.0, 2.0, 2.0, 2.0)]


def test_variables_are_set_again_and_again_and_deleted_in_the_end() -> None:
    script = player((ReadingChange(S, POSE, 2.0), ReadingChange(2 * S, POSE, None)), lambda: 5 * S)
    now, done, step = 5 * S, list[tuple[float, str]](), next(script)
    while now < 8 * S:
        match step:
            case Sleep(seconds):
                now += round(seconds * 1e9)
                step = script.send(now)
            case Do(_, call):
                done.append(((now - 5 * S) / S, call.method))
                step = script.send(None)
    assert done == [*((1.0 + i / 10, "set_many") for i in range(10)), (2.0, "delete")]
