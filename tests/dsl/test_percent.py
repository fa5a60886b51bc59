"""Plain numbers with values in percent: the errors, and what is accepted."""

from __future__ import annotations

import pytest

from colony.dsl.load import check_text, load_text
from colony.text.diagnostics import Diagnostic
from colony.text.units import parse_unit

ROBOT = """language 1
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
        ("let a = battery == -20", "-20"),
        ("let a = battery != 1e2", "1e2"),
        ("let a = battery in 0.1 .. 90", "0.1"),
        ("let a = cells[1] < 20", "20"),
        ("let a = min(cells) < 20", "20"),
        ("let a = any(cells[0 .. 1] < 20)", "20"),
        ("let a = min(cells[k] for k in 0 .. 2) < 20", "20"),
        ("let a = previous(battery, 0) < 20", "20"),
        ("let a = abs(battery - 50 percent) < 20", "20"),
        ("let a = -battery < 20", "20"),
        ("let a = min(battery, 30)", "30"),
        ("let a = clamp(battery, 0.1, 30)", "0.1"),
        ("let f(b : percent) = b let a = f(20)", "20"),
        ("let f(b : percent = 20) = b let a = f()", "20"),
        (
            "module m { input b : percent when b > 0 do fan(level = 0) } module n = m(b = 20)"
            " network { fan = n }",
            "20",
        ),
        ("let a = (if load > 3 then battery else 0.5) < 20", "0.5"),
        ("let a = value_or(battery, 100) < 0.2", "100"),
        ("let b = battery - 0.1", "0.1"),
        ("let a = last.fan.level > 20", "20"),
        ("param low = 20 let a = battery < low", "low"),
        ("contract c: fan.level <= 90", "90"),
        ("limit fan.level <= 50 when load > 2", "50"),
        ("module m { param full = 80 when true do fan(level = full) } network { fan = m }", "full"),
        ("module m { let b = battery when b < 20 do fan(level = 0.5) } network { fan = m }", "20"),
        ('test "t" { at 0 s given battery = 20 expect battery == 20 }', "20"),
        ("let a = battery - 20 > 0", "20"),
        ("let a = if load > 3 then battery else 80", "80"),
        ("let a = previous(battery, 100)", "100"),
        ("let a = battery < (if load > 3 then 0.2 else 30)", "30"),
        ("limit fan.level <= if load > 3 then 50 else 0.9", "0.9"),
        (
            "module m { when true do fan(level = if load < 5 then 80 else 0.2) } network { fan = m }",
            "80",
        ),
        ("let a = any(r < 20 for r in cells)", "20"),
        ("let a = min(r for r in cells) < 20", "20"),
        ("state charged : percent = 50 percent let a = charged < 20", "20"),
        ("state charged : percent = 50", "50"),
        ("state charged : percent = 0 next charged = if load > 3 then 20 else 0.3", "20"),
        ("module m { state s : percent = 0 when s < 20 do fan(level = 0) } network { fan = m }", "20"),
        (
            "module m { param p = 0.1 state s : percent = 0 when s < 20 do fan(level = p) }"
            " module n = m(p = 0.2) network { fan = m suppresses n }",
            "20",
        ),
        ("param low = 20 let f(b : percent) = b let a = f(low)", "low"),
        ("param low = 20 state s : percent = low", "low"),
        ("let f(v : percent) = v < 20 let a = f(load / 12)", "20"),
        ("let f(v[] : percent) = any(v < 20) let a = f(cells * load)", "20"),
        ("let f(v : percent = 1 percent) = v < 20 let a = f()", "20"),
        ("let f(v : percent) = v < 20 let a = f(load / 12) or f(load / 13)", "20"),
        (
            "module m { input v : percent when v < 20 do fan(level = 0) } module n = m(v = load / 12)"
            " network { fan = n }",
            "20",
        ),
    ],
)
def test_a_plain_number_with_a_value_in_percent_is_an_error(text: str, place: str) -> None:
    first, *_ = found(text)
    assert first.code in ("E201", "E202", "E404")
    assert place in first.span.text
    assert (
        f"`{place} percent`" in str(first.hint)
        or first.hint == "write its numbers in percent, as in `20 percent`"
    )


@pytest.mark.parametrize(
    "text",
    [
        "let a = battery < 20 percent",
        "let a = battery < 2000 percent",
        "let a = battery <= 100 percent",
        "let a = battery < load",
        "let a = load < 20",
        "let a = battery * 20 < 5",
        "let a = battery / 2 percent < 5",
        "let a = count(cells[k] < 50 percent for k in 0 .. 2) < 2",
        "let a = index_of_min(cells) < 2",
        "let a = if battery < 50 percent then 80 else 20",
        "let a = battery < (if load > 20 then load else 30 percent)",
        "let a = captured(battery, load > 3) < 20 percent",
        "state charged : percent = 50 percent next charged = battery let a = charged < 1/5",
        "let f(v : percent) = v * load < 20 let a = f(load / 12)",
        "let g(b : number) = b < 20 let a = g(battery)",
        "let loads = cells * load let a = min(r for r in cells) < 1 percent or any(r > 20 for r in loads)",
        "let a = battery > 0 and value_or(battery, 0) > 2 percent",
        "param low = 20 percent let a = battery < low",
        "param low = 2000 percent let a = battery < low",
        'test "t" { at 0 s given battery = 20, cells[1] = 30 percent expect battery == 20 percent }',
    ],
)
def test_what_is_meant_is_accepted(text: str) -> None:
    assert found(text) == []


@pytest.mark.parametrize("unit", ["percent", "mm/m"])
@pytest.mark.parametrize(
    ("high", "default"), [("100", "50"), ("100 UNIT", "50 UNIT"), ("full", "2 * quarter")]
)
def test_a_unit_that_is_written_counts_once(unit: str, high: str, default: str) -> None:
    text = f"""
    param full = 100 UNIT
    param quarter = 25 UNIT
    robot r {{
      sensor level : UNIT range -({high}) .. {high} default {default} from DServer.Level
      sensor levels[2] : UNIT from DServer.Levels
      actuator fan {{ level : UNIT range 0 .. {high} default {default} }} to DServer.Fan idle fan(level = 0)
    }}
    test "t" {{ at 0 s given level = {default}, levels = [{high}, {default}], last.fan.level = {high} }}
    """
    program = load_text(text.replace("UNIT", unit))
    whole = float(parse_unit(unit).factor * 100)
    level, field = program.robot.sensors[0], program.robot.actuators[0].fields[0]
    assert (level.low, level.high, level.default) == (-whole, whole, whole / 2)
    assert (field.low, field.high, field.default) == (0, whole, whole / 2)
    [step] = program.tests[0].steps
    assert [g.value for g in step.given] == [whole / 2, (whole, whole / 2), whole]


def test_a_plain_param_is_no_percent_in_a_range_either() -> None:
    [error] = found('param full = 100\ntest "t" { at 0 s given battery = full }')
    message = "the value given to `battery` must be a value in percent, found a plain number"
    assert (error.code, error.message) == ("E202", message)


def test_the_error_shows_both_ways_to_write_the_number() -> None:
    [error] = found("let a = battery > 0.5")
    expected = "`>` needs two numbers of one dimension, found a value in percent and a plain number"
    assert error.message == expected
    assert error.hint == "write `0.5 percent`, or `50 percent` for 0.5 of the whole"


def test_a_module_derived_with_a_plain_number_is_refused() -> None:
    text = """
    module weak { param low = 20 percent when battery < low do fan(level = 5 percent) }
    module weaker = weak(low = 10)
    network { fan = weak suppresses weaker }
    """
    [error] = found(text)
    assert (error.code, error.span.text) == ("E404", "10")
    assert "`10 percent`" in str(error.hint)
