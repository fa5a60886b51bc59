from __future__ import annotations

from dataclasses import replace

from colony.compile.backends.table import client_table
from colony.compile.pipeline import compile_program
from tests.networks import chain
from tests.wiring import program


def test_columns_stand_under_one_another() -> None:
    text = client_table(compile_program(program("drive = back_off suppresses (docked inhibits cruise)")))
    assert text == (
        "drive\n"
        "  priority  module    guard             exclusive guard\n"
        "         2  back_off  P                 P\n"
        "         1  cruise    P and not docked  P and not back_off and not docked\n"
        "\n"
        "P: the client's own activity. Both guards give the same winner."
    )


def test_long_guards_go_on_in_the_next_line() -> None:
    inhibitors = " inhibits ".join(f"a_rather_long_name_{i}" for i in range(5))
    lines = client_table(compile_program(program(f"drive = {inhibitors} inhibits cruise"))).splitlines()
    assert len(lines) > 5
    assert max(map(len, lines)) < 130


def test_actuators_that_nothing_drives() -> None:
    wired = program("drive = a\narm = b")
    text = client_table(compile_program(replace(wired, wires=wired.wires[:1])))
    assert "arm\n  nothing drives it" in text


def test_no_network_at_all() -> None:
    assert client_table(compile_program(program(""))) == ""


def test_shared_parts_are_named_and_the_text_is_linear() -> None:
    sizes = [len(client_table(compile_program(chain(size)))) for size in (500, 2_000)]
    assert "$1 = " in client_table(compile_program(chain(500)))
    assert sizes[1] < 4.5 * sizes[0]
