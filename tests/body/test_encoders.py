"""Encoders of wheels: held to their interface."""

from __future__ import annotations

import pytest

from tests.body.test_disagreements import found
from tests.body.test_reader import SMALL

INTERFACE = """language 1
robot small {
  frame  50 ms
  sensor rolled[2] : m   from Wheels.travel within 60 ms
}
"""
BODY = (
    SMALL
    + """
[server.Wheels]
rate = "50 Hz"

[server.Wheels.simulated]
device     = "encoders"
resolution = "0.5 mm"
"""
)


def test_an_interface_of_encoders_agrees() -> None:
    assert found(INTERFACE, BODY) == []


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("[2]", "[4]", ("B013", '"encoders"', "`rolled` has 4 elements, and its device has 2")),
        ("[2]", "", ("B013", '"encoders"', "`rolled` is no array, and its device has 2")),
        ("travel", "ticks", ("R002", "rolled", "`rolled`: Wheels has no field `ticks`")),
        (": m ", ": deg ", ("R003", "rolled", "`rolled`: Wheels.travel is mm[2], not deg[2]")),
    ],
)
def test_what_does_not_fit_encoders_is_found(old: str, new: str, problem: tuple[str, str, str]) -> None:
    assert old in INTERFACE
    assert found(INTERFACE.replace(old, new), BODY) == [problem]
