"""By how many ways a module's command can reach an actuator."""

from __future__ import annotations

import pytest

from colony.compile.passes.elaborate import elaborate
from colony.compile.passes.ways import by_several_ways
from tests.wiring import program


@pytest.mark.parametrize(
    ("wiring", "several"),
    [
        ("a", False),
        ("b suppresses a", False),
        ("a suppresses b", False),
        ("b inhibits a", False),
        ("a inhibits b", False),
        ("(b suppresses a) suppresses (c suppresses a)", True),
        ("(a suppresses b) suppresses (a suppresses c)", True),
        ("(b inhibits a) suppresses (c inhibits a)", True),
        ("(a inhibits b) suppresses (c suppresses a)", False),
    ],
)
def test_ways_of_a(wiring: str, several: bool) -> None:
    assert by_several_ways(elaborate(program(f"drive = {wiring}")), "drive", "a") is several


def test_there_is_no_way_to_an_actuator_that_is_not_wired() -> None:
    assert not by_several_ways(elaborate(program("drive = a")), "arm", "a")


def test_a_module_of_another_actuator_has_no_way() -> None:
    network = elaborate(program("drive = a\narm = b suppresses a"))
    assert not by_several_ways(network, "drive", "b")
