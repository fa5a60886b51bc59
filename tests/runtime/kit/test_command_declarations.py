"""What servers written with the kit declare of their commands."""

from __future__ import annotations

import math
from typing import Any

import pytest

from colony.runtime.kit.commands import command, parameter
from colony.runtime.kit.description import FieldReader
from colony.runtime.kit.service import Service
from tests.kit.lift import Lift

MISTAKES: list[tuple[dict[str, Any], str]] = [
    ({"name": "two words"}, "expected a name"),
    ({"unit": "parsec"}, "`parsec` is not a unit"),
    ({"unit": "mm", "boolean": True}, "found several kinds"),
    ({"boolean": True, "members": {"a": 1}}, "found several kinds"),
    ({"members": {"a": 1}, "low": 0.0}, "found several kinds"),
    ({"members": {}}, "found the members"),
    ({"members": {"a": math.inf}}, "found the members"),
    ({"low": 1.0, "high": 0.0}, "expected finite numbers, the lower one first"),
    ({"low": math.nan}, "expected finite numbers"),
    ({"low": "0"}, "found the bounds '0' and None; expected finite numbers"),
    ({"low": 0, "high": [1]}, "expected finite numbers"),
    ({"high": True}, "expected finite numbers"),
    ({"high": 10**400}, "expected finite numbers"),
    ({"high": 1e308, "unit": "m"}, "expected finite numbers"),
    ({"members": {"a": "1"}}, "found the members"),
    ({"name": 3}, "found the parameter 3"),
]


@pytest.mark.parametrize(("declared", "reason"), MISTAKES)
def test_mistakes_in_parameters(declared: dict[str, Any], reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        parameter(**{"name": "x", **declared})


def test_a_parameter_is_described_in_base_units() -> None:
    height = parameter("height", unit="m", low=0, high=0.4).description
    assert (height.unit, height.low, height.high) == ("mm", 0.0, 400.0)
    level = parameter("level", unit="percent", high=50.0).description
    assert (level.unit, level.low, level.high) == ("", None, 0.5)


def test_what_performs_a_command_has_its_own_units() -> None:
    taken: list[dict[str, Any]] = []
    made = command(
        "lift",
        lambda **given: taken.append(given),
        parameter("height", unit="m"),
        parameter("load", unit="kg"),
        parameter("fast", boolean=True),
        parameter("mode", members={"up": 3}),
    )
    made.perform(height=1500.0, load=2e-6, fast=True, mode=3.0)
    assert taken == [{"height": 1.5, "load": 2.0, "fast": True, "mode": 3.0}]


def test_parameters_and_commands_have_different_names() -> None:
    with pytest.raises(ValueError, match="expected each once"):
        command("move", print, parameter("x"), parameter("x"))
    with pytest.raises(ValueError, match="Lift: found two commands `move`"):
        Service(
            "Lift", (), FieldReader("Lift", (), print), print, commands=[Lift().command(), Lift().command()]
        )


def test_what_performs_a_command_must_take_its_parameters() -> None:
    with pytest.raises(ValueError, match=r"move: `perform` cannot be called .* unexpected .* 'speed'"):
        command("move", Lift().move, parameter("height"), parameter("fast"), parameter("speed"))
    with pytest.raises(ValueError, match="missing a required argument: 'fast'"):
        command("move", Lift().move, parameter("height"))
    assert command("any", lambda **given: None, parameter("x")).description.name == "any"
    assert command("min", min, parameter("key")).description.name == "min"


def test_what_performs_a_command_is_a_plain_function() -> None:
    async def later() -> None: ...

    with pytest.raises(ValueError, match="move: `perform` does nothing when it is called"):
        command("move", later)
    with pytest.raises(ValueError, match="move: `safe` does nothing when it is called"):
        command("move", print, safe=later)
