"""By how many ways a module's command can reach an actuator."""

from __future__ import annotations

import pytest

from colony.compile.pipeline import compile_program
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
    compilation = compile_program(program(f"drive = {wiring}"))
    for clients in (compilation.traversal, compilation.clients):
        assert any(c.has_several_paths for c in clients.actuators[0].clients if c.module == "a") is several


def test_ways_to_another_actuator_do_not_count() -> None:
    (_, arm) = compile_program(program("drive = a suppresses b\narm = a")).clients.actuators
    assert not any(c.has_several_paths for c in arm.clients)
