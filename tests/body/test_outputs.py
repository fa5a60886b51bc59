"""Outputs: held to their interface."""

from __future__ import annotations

import pytest

from tests.body.test_disagreements import found
from tests.body.test_reader import SMALL, problems

INTERFACE = """language 1
robot small {
  frame    50 ms
  sensor   horn_on : bool                        from Signals.horn
  sensor   glow : percent range 0 .. 100         from Signals.lamp
  actuator signals { horn : bool, lamp : number range 0 .. 1 }
           to Signals.set  idle signals(horn = false, lamp = 0)
}
"""
BODY = (
    SMALL
    + """
[server.Signals]
simulated = { device = "output", outputs = { horn = "on", lamp = "level" } }
"""
)


def test_an_interface_of_outputs_agrees() -> None:
    assert found(INTERFACE, BODY) == []


@pytest.mark.parametrize(
    ("old", "new", "code", "message"),
    [
        ("horn_on : bool", "horn_on : number", "R003", "`horn_on`: Signals.horn is bool, not number"),
        ("Signals.lamp", "Signals.lmp", "R002", "`glow`: Signals has no field `lmp`"),
        ("number range 0 .. 1 ", "number range 0 .. 2 ", "R008", None),
        ("Signals.set", "Signals.put", "R004", "`signals`: Signals has no command `put`"),
        ("0 .. 100 ", "0 .. 50 ", "B015", None),
    ],
)
def test_what_does_not_fit_an_output_is_found(old: str, new: str, code: str, message: str | None) -> None:
    assert old in INTERFACE
    [(found_code, _, found_message)] = found(INTERFACE.replace(old, new), BODY)
    assert found_code == code
    assert message in (None, found_message)


@pytest.mark.parametrize(
    ("outputs", "code", "message"),
    [
        ("{}", "B009", "0 outputs; expected 1 to 100"),
        ('{ horn = "loud" }', "B006", None),
        ('{ "my horn" = "on" }', "B006", None),
        (
            "{ " + ", ".join(f'a{i} = "on"' for i in range(101)) + " }",
            "B009",
            "101 outputs; expected 1 to 100",
        ),
    ],
)
def test_outputs_that_make_no_sense_are_reported(outputs: str, code: str, message: str | None) -> None:
    [(found_code, _, found_message)] = problems(BODY.replace('{ horn = "on", lamp = "level" }', outputs))
    assert message in (None, found_message)
    assert found_code == code
