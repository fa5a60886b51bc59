"""Expressions that are accepted: their types, what they become, and how literals 0 and arrays spread."""

from __future__ import annotations

from pathlib import Path

import pytest

from colony.ir import expression as e
from colony.ir.types import Array, Bool, Quantity
from colony.text.units import LENGTH
from tests.case_files import table
from tests.dsl.texts import expression, findings, type_of

BEFORE = """
enum goal { none = 0, light = 76 }
machine mode { start one  one -> two when bumper }
state laps = 0
let ahead = sonar[12]
let far = sonar > 1 m
"""


@pytest.mark.parametrize(("text", "type_"), table(Path(__file__).parent / "cases" / "types.table"))
def test_types(text: str, type_: str) -> None:
    assert type_of(text, BEFORE) == type_


def test_a_let_of_a_lone_zero_is_a_plain_number() -> None:
    assert findings("let z = 0\nlet x = sonar[0] < z") == ["2:9 E201"]
    assert findings("param z = 0\nlet x = sonar[0] < z") == ["2:9 E201"]
    assert findings("state z = 0\nlet x = sonar[0] < z") == ["2:9 E201"]


def test_a_slice_of_a_ring_wraps_round_the_end() -> None:
    found = expression("infrared[22..1]")
    assert isinstance(found, e.Slice)
    assert found.indices == (22, 23, 0, 1)
    assert findings("let x = sonar[22..1]") == ["1:9 E217"]


def test_a_constant_index_is_rounded_before_it_must_be_inside() -> None:
    assert findings("let x = sonar[23.4]") == []
    assert findings("let x = sonar[-0.5]") == []  # halves to even
    assert findings("let x = sonar[23.5]") == ["1:15 E205"]
    assert findings("param i = 24\nlet x = sonar[i]") == ["2:15 E205"]
    assert findings("let x = sum(sonar[k + 20] for k in 0 .. 23)") == []  # computed: taken modulo the size


def test_a_reduction() -> None:
    found = expression("sum(sonar[k] for k in -1 .. 2 * 3 if infrared[k])")
    assert isinstance(found, e.Reduce)
    assert (found.function, found.variable, found.low, found.high) == (e.Function.SUM, "k", -1, 6)
    assert isinstance(found.body, e.Element)
    assert found.body.index == e.LoopIndex(type=Quantity(), name="k")
    assert isinstance(found.condition, e.Element)


def test_variables_of_nested_reductions_are_told_apart() -> None:
    found = expression("sum(sum(k for k in 0 .. k0) for k in 0 .. 3) + k", "param k0 = 2\nlet k = 1")
    assert isinstance(found, e.BinaryOperation)
    outer = found.left
    assert isinstance(outer, e.Reduce)
    assert isinstance(outer.body, e.Reduce)
    assert outer.variable != outer.body.variable
    assert outer.body.body == e.LoopIndex(type=Quantity(), name=outer.body.variable)
    assert found.right == e.DerivedValue(type=Quantity(), name="k")


def test_the_variable_of_a_reduction_hides_other_names() -> None:
    found = expression("sum(sonar for sonar in 0 .. 3)")
    assert isinstance(found, e.Reduce)
    assert found.body == e.LoopIndex(type=Quantity(), name="sonar")


def test_the_bounds_of_a_reduction_do_not_see_its_variable() -> None:
    assert findings("let x = sum(k for k in 0 .. k)") == ["1:29 E101"]


def test_now_may_be_called_or_not_unless_something_else_has_its_name() -> None:
    assert isinstance(expression("now"), e.Now)
    assert expression("now") == expression("now()")
    assert type_of("now", "let now = 3 mm") == "mm"


def test_fresh_and_value_or() -> None:
    assert expression("fresh(sonar)") == e.Fresh(type=Bool(), name="sonar", derived=False)
    assert expression("fresh(a)", "let a = 3") == e.Fresh(type=Bool(), name="a", derived=True)
    found = expression("value_or(sonar, 3 m)")
    assert isinstance(found, e.ValueOr)
    assert found.type == Array(Quantity(LENGTH), 24)


@pytest.mark.parametrize("name", ["p", "s", "mode", "g", "cruise"])
def test_only_sensors_and_lets_of_the_file_can_be_fresh(name: str) -> None:
    text = (
        f"let x = fresh({name})\nparam p = 3\nstate s = 0\nmachine mode {{ start one }}\n"
        "enum g { a = 1 }\nmodule cruise { when true }"
    )
    assert findings(text) == ["1:15 E202" if name != "cruise" else "1:15 E106"]


def test_a_let_of_a_module_is_never_missing_to_it() -> None:
    assert findings("module m { let a = sonar[0] when fresh(a) }") == ["1:40 E202"]


def test_fresh_of_what_only_contracts_can_name_is_an_error_and_loses_nothing() -> None:
    module = "module m { let near = sonar[0] > 1 mm when near }\nmachine goal { start a a -> b when true }\n"
    assert findings(f"{module}contract c: fresh(m.near) and false") == ["3:19 E202"]
    assert findings(f"{module}contract c: fresh(drive.velocity) and false") == ["3:19 E202"]
    assert findings(f"{module}module n {{ when fresh(goal.a) }}") == ["3:23 E202"]
    assert findings(f"{module}limit drive.velocity <= 0 when fresh(goal.b)") == ["3:38 E202"]


# --- where memory may stand ----------------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    [
        "let x = recently(bumper, 1 s)",
        "state s = false next s = rising(bumper)",
        "module m { let a = every(1 s) when recently(a, 1 s)"
        " do drive(velocity = 0, turn = elapsed(a) * 1 deg/s/s) }",
        "module m { state s = 0 s next s = elapsed(bumper) when s > 0 }",
        "machine p { start a a -> b when recently(bumper, 1 s) }",
        "limit drive.velocity <= previous(3 mm/s, 0) when recently(bumper, 1 s)",
        "contract c: recently(bumper, 1 s)",
        'test "t" { at 0 s expect recently(bumper, 1 s) }',
        "let x = sum(if recently(infrared[k], 1 s) then 1 else 0 for k in 0 .. 3 if rising(infrared[k]))",
    ],
)
def test_memory_is_allowed(text: str) -> None:
    assert findings(text) == []


@pytest.mark.parametrize(
    "text",
    [
        "param p = previous(3, 4)",
        "state s = recently(true, 1 s)",
        "enum g { a = previous(1, 2) }",
        "module m { param p = previous(1, 2) when true }",
        "module m { param p = 1 when true } module n = m(p = previous(1, 2))",
        "let x = recently(bumper, previous(1 s, 2 s))",
        "let x = sum(k for k in previous(1, 2) .. 3)",
        "let x = sonar[previous(1, 2) .. 3]",
        'test "t" { at previous(1 s, 2 s) }',
        'test "t" { at 0 s given docked_at = previous(1, 2) }',
        "network { drive = a suppresses[previous(1 s, 2 s)] a }"
        " module a { when true do drive(velocity = 0, turn = 0) }",
    ],
)
def test_memory_is_refused_where_a_constant_must_stand(text: str) -> None:
    assert [f.split()[1] for f in findings(text)] == ["E209"]


# --- how deep and how large ----------------------------------------------------------------------


def test_expressions_nest_a_hundred_deep() -> None:
    for good, bad in ((" + ".join("1" * 100), " + ".join("1" * 101)), ("-" * 99 + "1", "-" * 100 + "1")):
        assert findings(f"let x = {good}") == []
        assert findings(f"let x = {bad}") == ["1:9 E004"]


def test_brackets_nest_a_hundred_deep() -> None:
    assert findings("let x = " + "(" * 100 + "1" + ")" * 100) == []
    assert findings("let x = " + "(" * 101 + "1" + ")" * 101 + "\n") == ["1:109 E004"]


def test_brackets_in_comments_and_texts_do_not_nest() -> None:
    assert findings("# " + "(" * 200 + '\ntest "' + "[" * 200 + '" { }') == []
