"""Readings and commands in units of every kind: outside as declared, inside in base units."""

from __future__ import annotations

import pytest

from colony.dsl.load import load_text
from colony.ir.frame import Frame
from colony.verify.reference.interpreter import Interpreter

TEXT = """language 1
robot cart {{
  sensor x : {unit} from DServer.X
  actuator out {{ y : {unit} }} to DServer.Out idle out(y = 0)
}}
module twice {{ when x > {bound} do out(y = x * 2) }}
network {{ out = twice }}
test "in its unit" {{ at 0 s given x = 8 expect x == 8 {unit}, out.y == 16 {unit} }}
"""


@pytest.mark.parametrize(
    ("unit", "bound", "inside"),
    [
        ("percent", "5 percent", 0.08),
        ("degC", "5 degC", 8.0),
        ("Ah", "5 A*min", 28800.0),
        ("mA", "0.005 A", 0.008),
        ("mV", "5 mV", 0.008),
        ("W", "5 V*A", 8.0),
        ("Wh", "5 Wh", 28800.0),
        ("Hz", "5 s^-1", 8.0),
        ("N", "5 kg*m/s^2", 0.008),
        ("kg", "5000 g", 8e-6),
        ("percent/min", "0", 8 / 6000),
    ],
)
def test_a_reading_enters_and_a_command_leaves_in_the_declared_unit(
    unit: str, bound: str, inside: float
) -> None:
    program = load_text(TEXT.format(unit=unit, bound=bound))
    [sensor] = program.robot.sensors
    assert 8 * sensor.factor == pytest.approx(inside)
    outcome = Interpreter(program).step(Frame(t_ns=0, readings={"x": 8.0}))
    assert outcome.commands["out"].values == (pytest.approx(16.0),)
