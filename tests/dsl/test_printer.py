from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given

from colony.dsl import ast
from colony.dsl.parse import parse
from colony.dsl.printer import print_expression, print_file
from colony.text.source import Source
from tests.case_files import table
from tests.drawn.strategies import texts
from tests.paths import BEHAVIORS


def read(text: str) -> ast.File:
    parsed = parse(Source("<text>", text))
    assert parsed.diagnostics == ()
    return parsed.file


@given(texts())
def test_parse_print_parse_is_the_identity_on_drawn_programs(text: str) -> None:
    tree = read(text)
    printed = print_file(tree)
    assert read(printed) == tree
    assert print_file(read(printed)) == printed


@pytest.mark.parametrize("path", BEHAVIORS, ids=lambda p: p.stem)
def test_and_on_the_behaviors(path: Path) -> None:
    tree = read(path.read_text(encoding="utf-8"))
    assert read(print_file(tree)) == tree


def expression(text: str) -> ast.Expression:
    (let,) = read(f"let x = {text}").declarations
    assert isinstance(let, ast.LetDecl)
    return let.value


@pytest.mark.parametrize(("text", "printed"), table(Path(__file__).parent / "cases" / "printed.table"))
def test_only_the_parentheses_that_are_needed(text: str, printed: str) -> None:
    assert print_expression(expression(text)) == printed


def test_declarations_that_behaviors_do_not_have() -> None:
    text = """
import "a.colony" as a
enum goal { none = 0, light = -7.5 }
param p = 3 mm
state n : a.goal = a.goal.none
next n = if true then goal.light else n
machine mode {
  start idle
  idle -> busy when p > 2 mm
  any -> idle when false
}
sequence tour { out until s[0] > 1 home = d.e(q = 1) until true within 2 s else out }
sequence idle when p > 2 mm keep { idle = m until if true then false else true within p else lost }
sequence again when true restart { a = a(b = 1) until false }
robot r {
  sensor s[3] : number range -1 .. 1 default 0.5 from A.b within 3 s
  actuator lamp { on : bool, level : mm/s range 0 .. 1 } to DServer.Lamp idle hold on_loss degrade
}
module m from python "x.y:Z" { param q = 1 reads s, a.n commands lamp rate 300 ms }
module d = a.m(q = 2, r = 3 s)
network { w = (x suppresses[1.5 s] y) inhibits z inhibits[2 s] d  lamp = w }
limit lamp.level >= 0 when s[0] > 0
contract dim in time: lamp.level <= 1 mm/s
assume lit: value_or(s[0] > 0, true) and not broken(a.w)
reach dark: lamp.level < 1 mm/s implies not lamp.on
test "t" {
  at 0 s
  from 1 s to 2 s every 100 ms
    given s = [1, 2, 3], s[1] = -4 taken 2 * 3 ms ago, s = missing expect lamp is commanded, d is active
}
"""
    tree = read(text)
    assert read(print_file(tree)) == tree
