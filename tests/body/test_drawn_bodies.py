"""Bodies with drawn mistakes: there is a body or an error, and nothing raises."""

from __future__ import annotations

import random
import tomllib

import jsonschema
import pytest

from colony.body.disagreements import disagreements
from colony.body.reader import body_of_text
from colony.body.schema import body_schema
from colony.dsl.load import load_file, load_text
from colony.text.diagnostics import render
from colony.view.robot_scene import robot_scene
from tests.body.test_disagreements import BODY, INTERFACE
from tests.body.test_sensors import BODY as SENSORS_BODY
from tests.body.test_sensors import INTERFACE as SENSORS
from tests.paths import ROBOTS

SHIPPED = [path.with_suffix(".toml").read_text(encoding="utf-8") for path in ROBOTS]
TEXTS = [BODY, SENSORS_BODY, *SHIPPED]
DECLARED = [load_text(text).robot for text in (INTERFACE, SENSORS)]
INTERFACES = [*DECLARED, *(load_file(path).robot for path in ROBOTS)]
VALUES = """
"1 mm" | 3 | [] | {} | true | "x" | nan | inf | -1 | 1e309 | "-5 deg" | [["1 mm", "2 mm"]] | "1 .. 2 deg"
| 1979-05-27 | "0 mm" | { device = "lidar" } | "360 deg" | 99999999999999999999 | "1e5 m"
"""
SCHEMA = jsonschema.Draft7Validator(body_schema())


def drawn(chance: random.Random) -> str:
    """A body some of whose lines are gone, doubled, elsewhere, or have another value."""
    lines = chance.choice(TEXTS).split("\n")
    for _ in range(chance.randint(1, 4)):
        place, what = chance.randrange(len(lines)), chance.random()
        key, is_value, _ = lines[place].partition("=")
        if what < 0.3:
            lines[place] = ""
        elif what < 0.5:
            lines.insert(place, chance.choice(lines))
        elif is_value:
            lines[place] = f"{key}= {chance.choice(VALUES.split('|')).strip()}"
    return "\n".join(lines)


@pytest.mark.parametrize("seed", range(10))
def test_there_is_a_body_or_an_error(seed: int) -> None:
    chance = random.Random(seed)
    for _ in range(30):
        text = drawn(chance)
        file = body_of_text(text, "drawn.toml")
        assert (file.body is None) == bool(file.diagnostics), text
        assert all(render(d) for d in file.diagnostics)
        if file.body is not None:
            assert SCHEMA.is_valid(tomllib.loads(text)), text
            for robot in INTERFACES:
                assert all(render(d) for d in disagreements(robot, file.body, file))
                assert robot_scene(robot, file.body).title == robot.name
