"""The built-in actuators of a server: the values that their fields take."""

from __future__ import annotations

import math
from typing import Literal

import pytest

from colony.runtime.protocol.deployment import ActuatorFieldSpec
from colony.runtime.servers.commanding import expected_of


@pytest.mark.parametrize(
    ("value", "is_bool", "members", "ends", "expected"),
    [
        (True, True, (), (None, None), None),
        (1.0, True, (), (None, None), "a bool"),
        (True, False, (), (None, None), "a finite number"),
        ("1", False, (), (None, None), "a finite number"),
        (math.nan, False, (), (0.0, 1.0), "a finite number"),
        (math.inf, False, (), (0.0, None), "a finite number"),
        (2, False, (1.0, 2.0), (None, None), None),
        (1.5, False, (1.0, 2.0), (None, None), "the number of a member: 1, 2"),
        (0.0, False, (), (0.0, 400.0), None),
        (400.0, False, (), (0.0, 400.0), None),
        (400.5, False, (), (0.0, 400.0), "0 to 400"),
        (-1.0, False, (), (0.0, None), "0 to any"),
        (-1e9, False, (), (None, 5.0), None),
        (6.0, False, (), (None, 5.0), "any to 5"),
    ],
)
def test_expected_of_a_field_is_what_it_takes_instead(
    value: object,
    is_bool: bool,
    members: tuple[float, ...],
    ends: tuple[float | None, float | None],
    expected: str | None,
) -> None:
    low, high = ends
    kind: Literal["bool", "number"] = "bool" if is_bool else "number"
    field = ActuatorFieldSpec(name="x", kind=kind, factor=1.0, low=low, high=high, members=members)
    assert expected_of(field, value) == expected
