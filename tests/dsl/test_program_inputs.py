"""`input NAME : TYPE ... from DServer.NAME` in a file: a variable that a behavior reads beside its robot."""

from __future__ import annotations

import pytest

from colony.runtime.protocol.interface import interface_of
from colony.verify.testing.examples import failures_as_diagnostics, run_examples
from tests.dsl.texts import findings, messages, program

INPUTS = """
enum task { none = 0, fetch = 1 }
input goal : mm range 0 .. 5000 default 1 m from DServer.Goal within 1 s
input next_task : task default task.none from DServer.Task
input place[2] : m from DServer.Place
"""
GO = (
    INPUTS
    + """
module go {
  when goal > 2 m and next_task == task.fetch and place[0] > 0.5 m
  do drive(velocity = 100 mm/s, turn = 0)
}
network { drive = go }
"""
)


def test_it_is_a_sensor_of_the_program_and_not_of_the_robot() -> None:
    found = program(GO)
    inputs = [s for s in found.robot.sensors if s.own]
    assert [(s.name, s.server, s.field, s.unit, s.default) for s in inputs] == [
        ("goal", "DServer", "Goal", "mm", 1000.0),
        ("next_task", "DServer", "Task", "", 0.0),
        ("place", "DServer", "Place", "m", None),
    ]
    assert inputs[0].within_ns == 10**9
    assert interface_of(found.robot) == interface_of(program("module m { when bumper }").robot)


def test_tests_give_it_readings() -> None:
    test = """
    test "a goal" {
      at 0 s    given goal = 3 m, next_task = task.fetch, place = [1 m, 0 m]  expect drive by go
      at 1 s    given place = missing, goal = 3 m                            expect drive is idle
      at 2 s    given place = [1 m, 0], goal = missing            expect not (go is active)
    }
    """
    assert failures_as_diagnostics(run_examples(program(GO + test))) == ()


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("input goal : mm from PServer.sonar", "1:22 E312"),
        ("input bumper : bool from DServer.Bumper", "1:7 E102"),
        ("input a : mm from DServer.A\nlet a = 1", "2:5 E102"),
        ("input a : mm range 5 .. 0 from DServer.A", "1:14 E303"),
        ("input a : mm from DServer.A\nparam b = a", "2:11 E204"),
        ("input t : number from DServer.T", "1:7 E307"),
    ],
)
def test_what_it_cannot_be(text: str, code: str) -> None:
    assert findings(text) == [code]


def test_the_server_is_named() -> None:
    said = messages("input goal : mm from PServer.sonar")
    assert "an input of a program reads a variable of DServer, found `PServer`" in said
