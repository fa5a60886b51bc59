"""What a polar picture shows, as data."""

from __future__ import annotations

import math
from typing import Any

import pytest

from colony.dsl.load import load_text
from colony.ir.bearings import listed_bearings, uniform
from colony.ir.frame import Frame, Reading
from colony.view.polar_picture import DiscreteValues, Panel, PolarScene, Ranges, describe, scene_of

BEHAVIOR = """
enum look {{ free = 0, wall = 7 }}
robot r {{ sensor x{} from PServer.x }}
"""


def panel(sensor: str, reading: Reading, *, read: bool = True) -> Panel:
    """The panel of a sensor `x` that is declared so and reads this."""
    program = load_text(BEHAVIOR.format(sensor))
    [found] = scene_of(program, "title", Frame(0, {"x": reading}), {"x"} if read else (), ()).panels
    return found


def test_only_arrays_with_bearings_have_panels() -> None:
    program = load_text(BEHAVIOR.format("[3] : m"))
    assert scene_of(program, "title", Frame(0, {}), (), ["a"]) == PolarScene(
        title="title", panels=(), lines=("a",)
    )


def test_lengths_are_in_meters_and_marked() -> None:
    ring = "[6] : cm bearing -180 deg range 0 .. 1000"
    found = panel(ring, (50, 1000, 300, math.inf, 1200.5, -2))
    assert isinstance(found.content, Ranges)
    assert found.content.marks == ("reading", "limit", "reading", "infinite", "limit", "negative")
    assert found.content.values[:3] == (0.5, 10.0, 3.0)
    assert (found.content.unit, found.content.limit, found.content.scale.high) == ("m", 10.0, 3.0)
    assert found.notes == ("ring of 6, 60 deg apart", "nearest 0.5 m at -180 deg")


def test_a_reading_at_the_upper_end_of_the_range_can_be_the_highest() -> None:
    found = panel("[2] : degC bearing 0 deg step 30 deg range 0 .. 100", (30.0, 100.0))
    assert found.notes[1:] == ("highest 100 degC at 30 deg",)


@pytest.mark.parametrize("bad", [math.nan, "nan", None, True, "far", -math.inf])
def test_an_invalid_element_is_marked(bad: object) -> None:
    reading: tuple[Any, ...] = (25.0, bad)
    found = panel("[2] : degC bearing 0 deg step 30 deg", reading, read=False)
    assert isinstance(found.content, Ranges)
    assert found.content.marks == ("reading", "invalid")
    assert found.notes == (
        "arc of 2 from 0 deg to 30 deg, 30 deg apart",
        "highest 25 degC at 0 deg",
        "the program takes it as missing",
    )


def test_an_integer_beyond_all_floats_is_infinite() -> None:
    found = panel("[2] : m bearing 0 deg step 30 deg", (1.0, 10**400))
    assert isinstance(found.content, Ranges)
    assert found.content.marks == ("reading", "infinite")


@pytest.mark.parametrize("reading", [None, "nan", 3.0, (1.0, 2.0)])
def test_what_is_no_array_of_this_size_is_missing(reading: Reading) -> None:
    assert panel("[3] : m bearing 0 deg step 30 deg", reading).content is None


def test_a_range_of_one_value_has_a_scale() -> None:
    for value, high in ((5.0, 5.0), (0.0, 1.0)):
        found = panel(f"[2] : m bearing 0 deg step 30 deg range {value:g} .. {value:g}", (value, value))
        assert isinstance(found.content, Ranges)
        assert (set(found.content.marks), found.content.scale.high) == ({"limit"}, high)


def test_bools_are_states() -> None:
    found = panel("[6] : bool bearing -180 deg", (True, False, True, True, True, True))
    assert found.content == DiscreteValues(states=(1, 0, 1, 1, 1, 1), names=("false", "true"))
    assert found.notes[1] == "true at -180 deg, -60 deg, 0 deg, 60 deg and 1 more"
    assert panel("[2] : bool bearing -180 deg", (False, False)).notes[1] == "true nowhere"


def test_enumerators_are_states() -> None:
    found = panel("[3] : look bearing [0 deg, 90 deg, 0 deg]", (7, 0, 3))
    assert found.content == DiscreteValues(states=(1, 0, None), names=("free", "wall"))
    assert found.notes == ("3 directions",)


def test_arrays_are_described() -> None:
    assert describe(listed_bearings([30])) == "one element at 30 deg"
    clockwise = uniform(30, -7.5, 3)
    assert clockwise is not None
    assert describe(clockwise) == "arc of 3 from 15 deg to 30 deg, 7.5 deg apart"
