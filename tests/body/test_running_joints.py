"""Joints that are commanded by velocity: held to their interface."""

from __future__ import annotations

import pytest

from tests.body.test_disagreements import found
from tests.body.test_reader import SMALL, problems

INTERFACE = """language 1
robot small {
  frame    50 ms
  sensor   height : mm range 0 .. 400                  from Winch.position
  sensor   hoist : mm/s range -50 .. 50                from Winch.velocity
  sensor   spin : deg/s range -60 .. 60                from Brush.velocity
  actuator winch { velocity : m/s range -0.05 .. 0.05 }  to Winch.run  idle winch(velocity = 0)
  actuator brush { velocity : deg/s range -60 .. 60 }    to Brush.run  idle brush(velocity = 0)
}
"""
BODY = (
    SMALL
    + """
[server.Winch.simulated]
device  = "joint"
control = "velocity"
range   = "0 .. 400 mm"
speed   = "50 mm/s"

[server.Brush]
simulated = { device = "rotary_joint", control = "velocity", range = "0 .. 1e6 deg", speed = "60 deg/s" }
"""
)


def test_an_interface_of_running_joints_agrees() -> None:
    assert found(INTERFACE, BODY) == []


@pytest.mark.parametrize(
    ("old", "new", "code", "message"),
    [
        (
            "-50 .. 50 ",
            "-40 .. 50 ",
            "B015",
            "`hoist` has a range from -40 mm/s, and its device reads -50 mm/s",
        ),
        ("Winch.velocity", "Winch.target", "R002", "`hoist`: Winch has no field `target`"),
        ("Winch.run", "Winch.move", "R004", "`winch`: Winch has no command `move`"),
        ("-0.05 .. 0.05", "-0.05 .. 0.06", "R008", None),
        ("spin : deg/s", "spin : mm/s", "R003", "`spin`: Brush.velocity is deg/s, not mm/s"),
    ],
)
def test_what_does_not_fit_a_running_joint_is_found(
    old: str, new: str, code: str, message: str | None
) -> None:
    assert old in INTERFACE
    [(found_code, _, found_message)] = found(INTERFACE.replace(old, new), BODY)
    assert found_code == code
    assert message in (None, found_message)


def test_a_running_joint_has_no_positions() -> None:
    named = BODY.replace('speed   = "50 mm/s"', 'speed = "50 mm/s"\npositions = { up = "400 mm" }')
    [(code, place, message)] = problems(named)
    assert (code, place) == ("B009", "positions")
    assert message == "a joint that runs at a velocity is not sent to positions"
