"""The JSON schema of bodies agrees with their reader, and the file with the data classes."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import jsonschema
import pytest

from colony.body.reader import body_of_text
from colony.body.schema import body_schema
from tests.body.test_reader import LIDAR, SMALL
from tests.paths import ROBOTS, ROOT

WHOLE = SMALL + LIDAR
VALID = [SMALL, WHOLE, *(path.with_suffix(".toml").read_text(encoding="utf-8") for path in ROBOTS)]

MISTAKES = [
    ('name = "small"', ""),
    ('name = "small"', 'name = "a b"'),
    ("wheel_base", "wheelbase"),
    ('"30 cm"', "30"),
    ('"30 cm"', "true"),
    ('"30 cm"', '"thirty cm"'),
    ('"30 cm"', '["30 cm"]'),
    ('"circle"', '"oval"'),
    ('shape = "circle", ', ""),
    (', radius = "0.2 m"', ""),
    ("[body.limits]", "[body.limit]"),
    ('"10 Hz"', "10"),
    ('"hold"', '"holt"'),
    ('"150 deg .. 165 deg"', '"150 deg"'),
    ('"150 deg .. 165 deg"', "150"),
    ("count = 360", 'count = "360"'),
    ("count = 360", "count = 360.5"),
    ("count = 360", "count = 5000"),
    ('"90 deg"]', "90]"),
    ('["5 cm", "0 mm", "90 deg"]', '["5 cm", "0 mm"]'),
    ('"lidar"', '"ladar"'),
    ('"colony.drivers.ldlidar:LD06"', '"ldlidar"'),
    ("inverted = true", "inverted = []"),
    ("[server.Lidar]", '[server."a b"]'),
    ("fields.temperature", "fields.temperature.more"),
]
"""What is wrong in a body whatever the dimensions: both find it."""


def accepts(text: str) -> bool:
    return bool(jsonschema.Draft7Validator(body_schema()).is_valid(tomllib.loads(text)))


def test_the_file_is_made_from_the_data_classes() -> None:
    text = (ROOT / "robots" / "body.schema.json").read_text(encoding="utf-8")
    assert json.loads(text) == json.loads(json.dumps(body_schema()))
    jsonschema.Draft7Validator.check_schema(body_schema())


@pytest.mark.parametrize("text", VALID)
def test_both_accept_bodies(text: str) -> None:
    assert body_of_text(text, "body.toml").diagnostics == ()
    assert accepts(text)


@pytest.mark.parametrize(("old", "new"), MISTAKES)
def test_both_refuse_mistakes(old: str, new: str) -> None:
    assert old in WHOLE
    text = WHOLE.replace(old, new)
    assert body_of_text(text, "body.toml").diagnostics
    assert not accepts(text)


def test_a_body_names_its_schema() -> None:
    for path in ROBOTS:
        first = path.with_suffix(".toml").read_text(encoding="utf-8").partition("\n")[0]
        assert (path.parent / Path(first.removeprefix("#:schema "))).is_file()
