"""Recordings read back as the frames that they were made of."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from colony.compile.pipeline import compile_program
from colony.execute.executor import ProgramExecutor
from colony.ir.frame import Frame, Reading
from colony.ir.program import Actuator, ActuatorField, Program, Sensor
from colony.ir.types import BOOL, DIMENSIONLESS, Array
from colony.runtime.frames.run_frame import RunFrame
from colony.runtime.protocol.messages import Sample, Tick, Verdict
from colony.runtime.recordings.lines import Recording, add_checksum, encoder, seconds_text
from colony.runtime.recordings.replay import Rows, has_valid_checksum
from colony.text.diagnostics import DiagnosticError
from colony.text.units import nanoseconds
from tests.analysis.recorded_runs import Kept
from tests.kit.node_stage import MS, S
from tests.runtime.programs import roam
from tests.runtime.scripted import FAR, Log, Script, session


def recorded(script: Script, duration_ns: int = 5 * S) -> tuple[list[bytes], Log]:
    file, log = Kept(), Log()
    program = roam()
    session(program, script, log, Recording(compile_program(program).compiled, file)).run(duration_ns)
    assert file.closed
    return file.writes, log


def script() -> Script:
    return Script(
        sonar_at=lambda t: None if t % (250 * MS) == 0 else Sample((300.0 + t / 7e6, *FAR[1:]), t),
        bumper_at=lambda t: t == 2 * S,
    )


def test_every_write_is_a_whole_line() -> None:
    lines, log = recorded(script())
    assert len(lines) == len(log.frames) == 100
    for line in lines:
        assert line.endswith(b"\n")
        assert line.count(b"\n") == 1
        json.loads(line)


def test_what_is_read_back_is_decided_as_it_was() -> None:
    lines, log = recorded(script())
    program = roam()
    executor = ProgramExecutor(compile_program(program).compiled)
    for line, back, took in zip(lines, Rows(lines, "run.jsonl", program), log.frames, strict=True):
        assert back.frame.t_ns == took.frame.t_ns
        decision = executor.step(back.frame).decisions[0]
        row = json.loads(line)
        assert row["drive"] == {"by": decision.by, "velocity": decision.values[0], "turn": decision.values[1]}  # type: ignore[index]
        assert ("sonar" in row) is ("sonar" in took.frame.readings)


@given(st.integers(-(10**18), 10**18))
@settings(deadline=None)
def test_times_are_exact_decimals(t_ns: int) -> None:
    text = seconds_text(t_ns)
    assert json.loads(text, parse_float=lambda x: x) == text
    whole, fraction = text.split(".")
    assert int(whole + fraction.ljust(9, "0")) == t_ns


@given(st.integers(0, 10**15))
def test_times_of_eleven_days_read_back_through_a_double(t_ns: int) -> None:
    assert nanoseconds(float(seconds_text(t_ns))) == t_ns


SENSORS = (
    Sensor(name="n", type=DIMENSIONLESS, server="DServer", field="n"),
    Sensor(name="b", type=BOOL, server="DServer", field="b"),
    Sensor(name="a", type=Array(DIMENSIONLESS, 2), server="DServer", field="a"),
)
LAMP = Actuator(
    name="lamp", fields=(ActuatorField(name="on", type=BOOL),), server="DServer", command="Lamp", idle=None
)


def small() -> Program:
    robot = roam().robot
    return Program(robot=replace(robot, sensors=SENSORS, actuators=(LAMP,)))


def line(readings: dict[str, Reading], verdict: Verdict | None = None) -> str:
    log = RunFrame(
        tick=Tick(k=0, t_ns=0),
        frame=Frame(0, readings),
        verdicts={} if verdict is None else {"lamp": verdict},
    )
    return encoder(compile_program(small()).compiled)(log)


def members(of: str) -> str:
    """A line without its checksum, which is right."""
    assert has_valid_checksum(of.encode())
    return of[: of.rindex(', "@sum"')] + "}"


READINGS: list[tuple[Reading, str]] = [
    (1.5, "1.5"),
    (3, "3"),
    (1e300, "1e+300"),
    (-0.0, "-0.0"),
    (math.inf, "1e999"),
    (-math.inf, "-1e999"),
    (math.nan, '"nan"'),
    (True, "true"),
]


@pytest.mark.parametrize(("reading", "text"), READINGS)
def test_readings_are_valid_json_that_means_the_same(reading: Reading, text: str) -> None:
    assert members(line({"n": reading})) == f'{{"t": 0.0, "@tick": 0, "@semantics": 4, "n": {text}}}'
    array: Reading = (reading, 0.0)  # type: ignore[assignment]
    assert members(line({"a": array})) == f'{{"t": 0.0, "@tick": 0, "@semantics": 4, "a": [{text}, 0.0]}}'
    (row,) = Rows([line({"n": reading}).encode()], "x", small())
    if isinstance(reading, float) and math.isnan(reading):
        assert isinstance(row.frame.readings["n"], str)
    else:
        assert row.frame.readings["n"] == reading


def test_faulty_readings_stay_faulty() -> None:
    assert members(line({"a": (1.0,)})) == '{"t": 0.0, "@tick": 0, "@semantics": 4, "a": "1 elements"}'
    assert members(line({"n": None, "b": False})) == '{"t": 0.0, "@tick": 0, "@semantics": 4, "b": false}'


def verdict(**changes: object) -> Verdict:
    fields: dict[str, object] = {
        "k": 0,
        "t_ns": 0,
        "actuator": "lamp",
        "by": "m",
        "values": (True,),
        "fates": (),
    }
    return Verdict(**(fields | changes))  # type: ignore[arg-type]


def test_actuators() -> None:
    def lamp(of: Verdict) -> object:
        return json.loads(line({}, of))["lamp"]

    assert lamp(verdict()) == {"by": "m", "on": True}
    assert lamp(verdict(by=None, values=None)) is None
    assert lamp(verdict(by=None, values=(False,))) == {"by": None, "on": False}
    assert lamp(verdict(values=None, fault="not finite")) == {"by": "m", "fault": "not finite"}
    fates = (("m", "won"), ("n", "late"), ("o", "silent"))
    assert lamp(verdict(fates=fates)) == {"by": "m", "on": True, "fates": {"n": "late"}}
    assert lamp(verdict(by=None, values=None, fates=fates)) == {"by": None, "fates": {"n": "late"}}
    assert lamp(verdict(by=None, outside="ann/1")) == {"by": None, "on": True, "@outside": "ann/1"}
    assert lamp(verdict(by=None, values=None, hold="stopped")) == {"by": None, "@held_by": "stopped"}


def test_a_file_that_takes_a_part_gets_the_rest() -> None:
    class Slow(Kept):
        def write(self, data: object, /) -> int:
            return super().write(bytes(data)[:10])  # type: ignore[call-overload]

    file, program = Slow(), roam()
    session(program, Script(), Recording(compile_program(program).compiled, file)).run(100 * MS)
    assert [json.loads(row)["t"] for row in b"".join(file.writes).splitlines()] == [0.0, 0.05]


# --- damaged lines -----------------------------------------------------------------------------------


def rows(*lines: str) -> tuple[list[float], bool, bool]:
    """The times of the whole lines, and how the file ends: damaged, broken off."""
    found = Rows([text.encode() for text in lines], "x", small())
    return [row.frame.t_ns / 1e9 for row in found], found.damaged, found.broken_off


def at(t: float) -> str:
    return add_checksum(f'{{"t": {t}, "@tick": 0, "@semantics": 4, "b": true') + "\n"


def bad(t: float) -> str:
    return at(t).replace("true", "trux")


def test_damaged_lines_are_left_out_wherever_they_stand() -> None:
    assert rows(at(0), at(1), at(2)) == ([0.0, 1.0, 2.0], False, False)
    assert rows(bad(0), bad(1), at(2), bad(3)) == ([2.0], True, False)
    assert rows(bad(0)) == ([], True, False)
    assert rows(at(0), "\0" * 100 + "\n", at(2)) == ([0.0, 2.0], False, False)
    assert rows("\0" * 100 + "\n", at(2)) == ([2.0], False, False)


@pytest.mark.parametrize("length", range(1, len(at(1))))
def test_a_last_line_that_is_cut_anywhere_breaks_off(length: int) -> None:
    times, damaged, broken_off = rows(at(0), at(1)[:length])
    if length == len(at(1)) - 1:
        assert (times, damaged, broken_off) == ([0.0, 1.0], False, False)
    else:
        assert (times, damaged, broken_off) == ([0.0], False, True)


def test_a_last_line_whose_end_is_another_sign_is_damaged() -> None:
    assert rows(at(0), at(1)[:-1] + "\v") == ([0.0], True, False)


def test_zeros_at_the_end_are_damage() -> None:
    assert rows(at(0), "\0" * 100) == ([0.0], True, False)


@pytest.mark.parametrize(
    ("members", "column", "version"),
    [
        ('"@tick": 0', 10, "1"),
        ('"@tick": 0, "@semantics": 2', 22, "2"),
        ('"@semantics": 1', 10, "1"),
        ('"@semantics": null', 10, "None"),
        ('"@semantics": "2"', 10, "2"),
    ],
)
def test_lines_of_another_version_of_the_semantics_are_refused(
    members: str, column: int, version: str
) -> None:
    with pytest.raises(DiagnosticError) as caught:
        rows(at(0), add_checksum(f'{{"t": 1, {members}, "b": true') + "\n")
    (found,) = caught.value.diagnostics
    assert (found.code, found.span.source.position(found.span.start)) == ("A007", (2, column))
    assert f"of version {version} of the semantics; this is version 4" in found.message


def test_a_damaged_version_is_damage() -> None:
    assert rows(at(0), at(1).replace('tics": 4', 'tics": 5'), at(2)) == ([0.0, 2.0], False, False)


def test_frames_that_nobody_recorded_need_no_version() -> None:
    assert rows('{"t": 0, "b": true}\n', '{"t": 1, "@restart": true}\n') == ([0.0, 1.0], False, False)


def test_lines_without_checksums_are_plain_input() -> None:
    plain = '{"t": 0, "b": true}\n'
    assert rows(plain) == ([0.0], False, False)
    with pytest.raises(DiagnosticError, match="F001"):
        rows(plain, '{"t": 1, "b": tru')


def test_a_time_beyond_all_clocks_is_refused() -> None:
    with pytest.raises(DiagnosticError, match="F003"):
        rows('{"t": 1e305}\n')


def test_names_that_repeat_are_found_at_once() -> None:
    many = ", ".join(f'"x{i}": 0' for i in range(100_000))
    with pytest.raises(DiagnosticError, match="`x0` appears twice"):
        rows(f'{{"t": 0, {many}, "x0": 1}}\n')
