"""What the options of `colony run` mean."""

from __future__ import annotations

from dataclasses import fields
from unittest.mock import ANY

import click
import pytest

from colony.cli.run import command as run_command
from colony.cli.run.options import OptionError, duration_ns, held, run_spec
from colony.cli.serve import command as serve_command
from colony.cli.serve.processes import ServeSpec
from colony.ir.program import Program, Robot, Sensor
from colony.ir.types import BOOL, DIMENSIONLESS, DISTANCE, Array, Enum, Type
from colony.runs.spec import RunSpec
from colony.sim.world_spec import WorldSpec

S = 1_000_000_000


def names(command: click.Command) -> set[str]:
    return {str(option.name) for option in command.params}


def test_every_field_of_a_specification_is_an_option() -> None:
    run, serve = names(run_command), names(serve_command)
    world = {*WorldSpec.__struct_fields__} - {"floors"}  # which follow from the route
    assert world <= run
    assert world <= serve
    assert {field.name for field in fields(RunSpec)} - {"world", "pinned_variables", "others"} <= run
    assert {field.name for field in fields(ServeSpec)} - {
        *("described", "world", "pinned_variables", "interface", "limits")
    } <= serve


def test_options_become_the_fields_of_their_names() -> None:
    options = {"file": "f", "seed": 7, "movers": 2, "length_ns": S, "settings": ("Count=1",), "watch": True}
    assert run_spec(PROGRAM.robot, options) == RunSpec(
        file="f",
        world=WorldSpec(seed=7, movers=2),
        length_ns=S,
        pinned_variables={"Count": 1.0},
        scenario=ANY,
    )


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("60", 60 * S),
        ("1.5", 3 * S // 2),
        ("2min", 120 * S),
        ("2 min", 120 * S),
        ("50ms", S // 20),
        (".5s", S // 2),
    ],
)
def test_durations(text: str, expected: int) -> None:
    assert duration_ns(text) == expected


@pytest.mark.parametrize(
    "text", ["", "0", "-1", "1e-12", "x", "5 mm", "5 parsec", "nan", "inf", "1e999", "1e10", "5 s s"]
)
def test_bad_durations(text: str) -> None:
    with pytest.raises(OptionError, match="--duration: found"):
        duration_ns(text)


def sensor(name: str, type: Type, factor: float = 1.0, server: str = "DServer") -> Sensor:
    return Sensor(name=name.lower(), type=type, factor=factor, server=server, field=name)


GOAL = Enum("goal", (("none", 0.0), ("corner", 67.0)))
PROGRAM = Program(
    robot=Robot(
        name="r",
        sensors=(
            sensor("Docked", BOOL),
            sensor("Count", DIMENSIONLESS),
            sensor("Distance", DISTANCE, 1000.0),
            sensor("Goal", GOAL),
            sensor("Path", Array(DISTANCE, 2)),
            sensor("Flags", Array(BOOL, 2)),
            sensor("bumper", BOOL, server="RServer"),
            sensor("estop", BOOL, server="Panel"),
        ),
    )
)

GOOD = [
    ("Docked=true", True),
    ("Docked = false", False),
    ("DServer.Docked=true", True),
    ("Count=3", 3.0),
    ("Count=-2.5e1", -25.0),
    ("Distance=2", 2.0),
    ("Distance=2 m", 2.0),
    ("Distance=500mm", 0.5),
    ("Goal=corner", 67.0),
    ("Goal=goal.corner", 67.0),
    ("Goal=67", 67.0),
    ("Path=[1, 2 m]", (1.0, 2000.0)),
    ("Flags=[true,false]", (True, False)),
]


@pytest.mark.parametrize(("setting", "value"), GOOD)
def test_settings(setting: str, value: object) -> None:
    variables, others = held(PROGRAM.robot, (setting,))
    assert not others
    (found,) = variables.values()
    assert found == value
    assert type(found) is type(value)


BAD = [
    ("Docked", "NAME=VALUE"),
    ("=3", "NAME=VALUE"),
    ("Docket=true", "did you mean `Docked`"),
    ("bumper=true", "`bumper` cannot be given: the simulated base measures it"),
    ("Docked=missing=3", "true or false"),
    ("Docked=1", "true or false"),
    ("Count=yes", "a number"),
    ("Count=nan", "a number"),
    ("Count=1 mm", "a number"),
    ("Distance=3 s", "a number in mm"),
    ("Goal=exit", "goal.none, goal.corner"),
    ("Goal=3", "goal.none, goal.corner"),
    ("Path=3 s", "a number"),
    ("Path=[3]", "expected 2"),
    ("Path=[3, x]", "a number in mm"),
]


@pytest.mark.parametrize(("setting", "text"), BAD)
def test_bad_settings(setting: str, text: str) -> None:
    with pytest.raises(OptionError, match=r"^--set") as bad:
        held(PROGRAM.robot, (setting,))
    assert text in str(bad.value)


def test_the_last_setting_of_a_variable_counts() -> None:
    variables, _ = held(PROGRAM.robot, ("Count=1", "Docked=true", "Count=2"))
    assert variables == {"Count": 2.0, "Docked": True}


def test_a_field_that_nobody_simulates() -> None:
    variables, [estop] = held(PROGRAM.robot, ("estop=true",))
    assert not variables
    assert (estop.t_ns, estop.sensor.name, estop.value) == (0, "estop", True)
