"""Views of a program's code: what stands before decisions."""

from __future__ import annotations

from dataclasses import replace

import pytest

from colony.execute.code import Apply, Kind, SensorFresh
from colony.execute.needs import before_decisions
from colony.execute.operators import Operator
from tests.programs import lowered, robot

TEXT = f"{robot()} module m {{ when a do out(v = 1) }} network {{ out = m }}"
OPS = (
    SensorFresh("a"),
    Apply(Operator.NOT, (0,)),
    Apply(Operator.NOT, (1,)),
    SensorFresh("b"),
    Apply(Operator.NOT, (3,)),
)


@pytest.mark.parametrize(
    ("decided", "condition", "expected"),
    [
        (0, 0, "10000"),
        (0, 1, "11000"),
        (0, 2, "11100"),
        (0, 4, "00011"),
        (2, 4, "11011"),
        (3, 0, "11100"),
        (5, 0, "11111"),
    ],
)
def test_what_stands_before_decisions_or_decides(decided: int, condition: int, expected: str) -> None:
    """All that stands there already, the condition of a client, and whatever that depends on."""
    code = lowered(TEXT)
    (out,) = (one for one in code.actuators if one.clients)
    (client,) = out.clients
    client = replace(client, **dict.fromkeys(client.conditions, condition))
    code = replace(
        code,
        ops=OPS,
        kinds=(Kind.BOOL,) * len(OPS),
        decided=decided,
        actuators=(replace(out, clients=(client,)),),
    )
    assert "".join("1" if flag else "0" for flag in before_decisions(code)) == expected
