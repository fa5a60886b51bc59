"""`default V` of an actuator's field: a `do` may leave the field out."""

from __future__ import annotations

from pathlib import Path

import pytest

from colony.compile.backends.python.generate import generate, load
from colony.compile.pipeline import compile_program
from colony.dsl.load import check_text, load_file, load_text
from colony.execute.colonyc import decode, encode
from colony.execute.executor import ProgramExecutor
from colony.ir.frame import Frame
from colony.verify.reference.interpreter import Interpreter

DRIVE = "velocity : mm/s range -500 .. 500, sideways : {sideways}"
ROBOT = """language 1
param slow = 0.1 m/s
enum gait {{ walk = 0, run = 1 }}
robot r {{
  sensor near : mm from PServer.near
  actuator drive {{ {fields} }} to Base.Drive idle drive(velocity = 0, sideways = {idle})
}}
"""


def robot(sideways: str, idle: str = "0") -> str:
    return ROBOT.format(fields=DRIVE.format(sideways=sideways), idle=idle)


@pytest.mark.parametrize(
    ("sideways", "idle", "sent"),
    [
        ("mm/s default 0", "0", 0.0),
        ("mm/s range -100 .. 100 default -20", "0", -20.0),
        ("cm/s default 5", "0", 5.0),
        ("cm/s default 5 mm/s", "0", 0.5),
        ("mm/s default slow / 2", "0", 50.0),
        ("percent default 20", "0", 20.0),
        ("bool default true", "false", True),
        ("gait default gait.run", "gait.walk", 1.0),
    ],
)
def test_what_is_left_out_has_the_default(sideways: str, idle: str, sent: float | bool) -> None:
    program = load_text(
        robot(sideways, idle) + "module go { when true do drive(velocity = 100 mm/s) } network { drive = go }"
    )
    frame = Frame(t_ns=0, readings={"near": 1.0})
    compiled = compile_program(program).compiled
    for executor in (Interpreter(program), ProgramExecutor(decode(encode(compiled), "p"))):
        assert executor.step(frame).commands["drive"].values == (100.0, sent)


def test_what_is_given_counts() -> None:
    text = robot("mm/s default 0") + (
        "module go { when true do drive(sideways = 7 mm/s, velocity = 0) } network { drive = go }"
    )
    outcome = Interpreter(load_text(text)).step(Frame(t_ns=0, readings={"near": 1.0}))
    assert outcome.commands["drive"].values == (0.0, 7.0)


@pytest.mark.parametrize(
    ("sideways", "codes"),
    [
        ("mm/s range -100 .. 100 default 200", ["E304"]),
        ("mm/s range 10 .. 100 default 0", ["E304", "E306"]),
        ("mm/s default 3 deg", ["E202"]),
        ("mm/s default true", ["E202"]),
        ("mm/s default near", ["E204"]),
        ("mm/s default 1 default 2", ["E005"]),
        ("mm/s default 1 range 0 .. 2", ["E005"]),
    ],
)
def test_a_default_is_a_constant_of_the_field(sideways: str, codes: list[str]) -> None:
    found = check_text(robot(sideways)).diagnostics
    assert [d.code for d in found if d.severity == "error"] == codes


def test_a_field_with_a_wrong_default_may_be_left_out() -> None:
    text = (
        robot("mm/s default 3 deg") + "module go { when true do drive(velocity = 0) } network { drive = go }"
    )
    assert [d.code for d in check_text(text).diagnostics if d.severity == "error"] == ["E202"]


def test_the_idle_command_gives_every_field() -> None:
    text = robot("mm/s default 0").replace(", sideways = 0)", ")")
    [found] = [d for d in check_text(text).diagnostics if d.severity == "error"]
    assert (found.code, found.message) == (
        "E401",
        "the command does not give `sideways` of `drive`",
    )


def test_fields_without_a_default_are_needed() -> None:
    text = robot("mm/s default 0") + "module go { when true do drive(sideways = 0) } network { drive = go }"
    [found] = [d for d in check_text(text).diagnostics if d.severity == "error"]
    assert found.message == "the command does not give `velocity` of `drive`"


def test_the_answer_of_a_module_in_python_may_leave_it_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "left_out.py").write_text(
        "class Go:\n    def step(self, frame):\n        return {'velocity': frame['near']}\n"
    )
    behavior = tmp_path / "go.colony"
    behavior.write_text(
        robot("mm/s default 5")
        + 'module go from python "left_out:Go" { reads near commands drive } network { drive = go }'
    )
    program = load_file(behavior)
    compiled = compile_program(program).compiled
    frame = Frame(t_ns=0, readings={"near": 30.0})
    for executor in (Interpreter(program), ProgramExecutor(compiled), load(generate(compiled))):
        assert executor.step(frame).commands["drive"].values == (30.0, 5.0)
