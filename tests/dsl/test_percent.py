"""Plain numbers beside values in percent: what is found, and what is meant."""

from __future__ import annotations

import pytest

from colony.dsl.load import check_text
from colony.text.diagnostics import Diagnostic

ROBOT = """language 2
robot r {
  sensor battery : percent range 0 .. 100 from DServer.Battery
  sensor cells[3] : percent default 50 from DServer.Cells
  sensor load : number from DServer.Load
  actuator fan { level : percent range 0 .. 100 } to DServer.Fan idle fan(level = 0)
}
"""


def found(text: str) -> list[Diagnostic]:
    return [d for d in check_text(ROBOT + text).diagnostics if d.code != "W002"]


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("let a = battery < 20", "20"),
        ("let a = battery <= 20", "20"),
        ("let a = 20 > battery", "20"),
        ("let a = battery >= 1.5", "1.5"),
        ("let a = battery == -20", "20"),
        ("let a = battery != 1e2", "1e2"),
        ("let a = battery in 0.1 .. 90", "90"),
        ("let a = cells[1] < 20", "20"),
        ("let a = min(cells) < 20", "20"),
        ("let a = any(cells[0 .. 1] < 20)", "20"),
        ("let a = min(cells[k] for k in 0 .. 2) < 20", "20"),
        ("let a = previous(battery, 0) < 20", "20"),
        ("let a = abs(battery - 50 percent) < 20", "20"),
        ("let a = -battery < 20", "20"),
        ("let a = min(battery, 30)", "30"),
        ("let a = clamp(battery, 0.1, 30)", "30"),
        ("let f(b : percent) = b let a = f(20)", "20"),
        ("let f(b : percent = 20) = b let a = f()", "20"),
        (
            "module m { input b : percent when b > 0 do fan(level = 0) } module n = m(b = 20)"
            " network { fan = n }",
            "20",
        ),
        ("let a = (if load > 3 then battery else 0.5) < 20", "20"),
        ("let a = value_or(battery, 100) < 0.2", "100"),
        ("let b = battery - 0.1 let a = b < 20", "20"),
        ("let a = last.fan.level > 20", "20"),
        ("param low = 20 let a = battery < low", "low"),
        ("contract c: fan.level <= 90", "90"),
        ("limit fan.level <= 50 when load > 2", "50"),
        ("module m { param full = 80 when true do fan(level = full) } network { fan = m }", "full"),
        ("module m { let b = battery when b < 20 do fan(level = 0.5) } network { fan = m }", "20"),
        ('test "t" { at 0 s given battery = 20 expect battery == 20 }', "20"),
    ],
)
def test_a_plain_number_beyond_one_is_an_error(text: str, place: str) -> None:
    assert [(d.code, d.severity, d.span.text) for d in found(text)] == [("E220", "error", place)]


def test_in_the_body_of_a_function_the_argument_is_shown() -> None:
    [diagnostic] = found("let g(b : number) = b < 20\nlet a = g(battery)")
    assert [(label.span.text, label.text) for label in diagnostic.labels] == [("battery", "given here")]


@pytest.mark.parametrize(
    "text",
    [
        "let a = battery < 20 percent",
        "let a = battery < 2000 percent",
        "let a = battery <= 1",
        "let a = battery < 0.2",
        "let a = load < 20",
        "let a = battery * 20 < 5",
        "let a = battery / 2 percent < 5",
        "let a = count(cells[k] < 0.5 for k in 0 .. 2) < 2",
        "let a = index_of_min(cells) < 2",
        "param low = 20 percent let a = battery < low",
        "param low = 2000 percent let a = battery < low",
        'test "t" { at 0 s given battery = 20, cells[1] = 30 percent expect battery == 20 percent }',
    ],
)
def test_what_is_meant_is_accepted(text: str) -> None:
    assert found(text) == []


def test_the_error_says_what_it_means_and_what_to_write() -> None:
    [error] = found("let a = battery < 20")
    assert error.message == "`battery` is in percent: 20 means 2000 percent"
    assert error.hint == "write `20 percent`"
    [error] = found("param low = 20\nlet a = battery < low")
    assert error.message == "`battery` is in percent: `low`, which is 20, means 2000 percent"
    assert error.hint == "write `20 percent` where it is declared"


def test_a_module_derived_with_a_plain_number_is_found_once() -> None:
    text = """
    module weak { param low = 0.2 when battery < low do fan(level = 0.5) }
    module weaker = weak(low = 10)
    module weakest = weak(low = 10)
    network { fan = weak suppresses weaker suppresses weakest }
    """
    assert [d.span.text for d in found(text)] == ["low"]
