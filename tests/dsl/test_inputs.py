"""Inputs of modules: what they become in the program, which bindings are errors, and what templates are."""

from __future__ import annotations

from pathlib import Path

import pytest

from colony.dsl.parse import parse
from colony.dsl.printer import print_file
from colony.ir import expression as e
from colony.ir.frame import Frame
from colony.ir.program import Let, Module, PythonModule
from colony.ir.types import BOOL
from colony.text.source import Source
from colony.verify.reference.interpreter import Interpreter
from tests.dsl.test_imports import Files
from tests.dsl.texts import expression, findings, messages, named, program

FOLLOW = """
module follow {
  input side : mm
  param keep = 400 mm
  when side < keep
  do drive(velocity = 1 mm/s * (side / 1 mm), turn = 0)
}
"""
LEFT = f"{FOLLOW}module left = follow(side = min(sonar[3..5]), keep = 300 mm)\n"
NETWORK = "network { drive = left }\n"


def test_an_input_is_a_let_of_the_file_level() -> None:
    whole = program(
        f"let last_let = now\n{LEFT}{NETWORK}state s = 0\nmachine m {{ start a  a -> b when bumper }}"
    )
    assert [d.name for d in whole.derived] == ["last_let", "left.side", "s", "m"]
    assert [m.name for m in whole.modules] == ["left"]
    let = named(Let, "left.side", LEFT)
    assert let.expression == expression("min(sonar[3..5])")
    when = named(Module, "left", LEFT).when
    assert isinstance(when, e.BinaryOperation)
    assert when.left == e.DerivedValue(type=let.expression.type, name="left.side")
    assert when.right == expression("300 mm")


def test_each_module_has_an_input_of_its_own() -> None:
    a, b, c = "follow(side = captured(sonar[0], bumper))", "a(keep = 1 m)", "b(side = 0)"
    text = f"{FOLLOW}module a = {a}\nmodule b = {b}\nmodule c = {c}"
    lets = {d.name: d.expression for d in program(text).derived if isinstance(d, Let)}
    assert list(lets) == ["a.side", "b.side", "c.side"]
    assert isinstance(lets["a.side"], e.MemoryCall)
    assert isinstance(lets["b.side"], e.MemoryCall)
    assert lets["a.side"].cell != lets["b.side"].cell
    assert str(lets["c.side"].type) == "mm"


def test_memory_of_a_binding_is_not_that_of_the_body() -> None:
    text = "module m { input b : bool when rising(b) }\nmodule n = m(b = falling(bumper))"
    whole = program(text)
    cells = [x.cell for d in whole.derived for x in e.subexpressions(d.expression) if hasattr(x, "cell")]  # type: ignore[union-attr]
    assert cells != [x.cell for x in e.subexpressions(named(Module, "n", text).when) if hasattr(x, "cell")]


def test_missing_inputs_are_needed_where_they_are_read() -> None:
    text = """
    module m {
      input side : mm
      when value_or(side, 0 mm) < 1 m and (fresh(side) or true)
      do drive(velocity = 1 mm/s, turn = 0)
    }
    module left = m(side = sonar[0])
    module right = m(side = sonar[0] + heading * 1 mm / 1 deg)
    network { drive = left suppresses right }
    contract c: value_or(left.side, 1 m) < 2 m and left is active
    """
    interpreter = Interpreter(program(text))
    outcome = interpreter.step(Frame(0, {"sonar": [3000.0] * 24}))
    assert outcome.decisions[0].by == "right"
    assert outcome.breaches == ("c",)
    outcome = interpreter.step(Frame(50_000_000, {"sonar": [300.0] * 24}))
    assert outcome.decisions[0].by == "left"
    assert outcome.breaches == ()


def test_arrays_of_any_length() -> None:
    text = """
    module m { input scan[] : mm  input bits[24] : bool when scan[4] < min(scan) and any(bits) }
    module a = m(scan = sonar, bits = infrared)
    module b = a(scan = sonar[3..7])
    """
    sizes = {d.name: str(d.expression.type) for d in program(text).derived if isinstance(d, Let)}
    assert sizes == {"a.scan": "mm[24]", "a.bits": "bool[24]", "b.scan": "mm[5]", "b.bits": "bool[24]"}
    shown = messages(f"{text}\nmodule c = a(scan = sonar[3..6])")
    assert shown.startswith("<text>:2:67: error[E205]: index 4 is outside the array, whose last index is 3")
    assert "note: derived here\n  6 | module c = a(scan = sonar[3..6])" in shown


def test_a_default_makes_an_ordinary_module() -> None:
    text = "let ahead = sonar[12]\nmodule m { input side : mm = ahead / 2 when side < 1 m }\nmodule n = m"
    whole = program(text)
    assert [d.name for d in whole.derived] == ["ahead", "m.side", "n.side"]
    assert [m.name for m in whole.modules] == ["m", "n"]


def test_bindings_are_read_in_their_own_files(tmp_path: Path) -> None:
    files = Files(tmp_path)
    files.write(
        base='import "rome"\nlet limit = 1 m\nmodule m { input a : mm input b : mm = limit when a < b }',
        top='import "base" as base\nlet limit = 2 m\nmodule here = base.m(a = limit)',
    )
    lets = {d.name: d for d in files.program("top").derived}
    assert list(lets) == ["base.limit", "limit", "here.a", "here.b"]
    assert isinstance(lets["here.a"], Let)
    assert isinstance(lets["here.b"], Let)
    assert lets["here.a"].expression.name == "limit"  # type: ignore[union-attr]
    assert lets["here.b"].expression.name == "base.limit"  # type: ignore[union-attr]


def test_modules_in_python_have_inputs() -> None:
    text = """
    module p from python "a:B" { input side : mm  param gain = 1  reads bumper  commands drive }
    module left = p(side = sonar[3], gain = 2)
    """
    module = named(PythonModule, "left", text)
    assert [r.name for r in module.reads] == ["bumper", "side"]
    assert module.reads[1].expression.name == "left.side"  # type: ignore[union-attr]
    assert module.params == (("gain", 2.0),)
    assert findings('module p from python "a:B" { input bumper : bool = bumper reads bumper }') == [
        "1:36 E102"
    ]


ERRORS = [
    ("module a = follow(side = bumper)", "E404", "input `side` takes a value in mm, found a bool", ""),
    ("module a = follow(size = 1 mm)", "E404", "no param or input `size`", "did you mean `side`?"),
    ("module a = follow(x = 1 mm)", "E404", "no param or input `x`", "are side; its params are keep"),
    ("module a = follow(side = 0, side = 1 mm)", "E404", "input `side` is bound twice", ""),
    ("module a = follow(side = nothing)", "E101", "unknown name `nothing`", ""),
    ("module a = follow(keep = sonar[0])", "E204", "param `keep` must be constant", "as `input keep : mm`"),
    ("module a = follow(keep = 300)", "E404", "found a plain number", "write its unit: `300 mm`"),
    ("module a = follow(side = drive by left)", "E210", "only in contracts and tests", ""),
    ("module a = follow(side = left.side)", "E106", "only in contracts and tests", ""),
    ("network { drive = follow }", "E408", "module `follow` has an input that is not bound: `side`",
     "derive a module that binds it, and use that: `module NAME = follow(side = ...)`"),
    ("contract c: follow is active", "E408", "an input that is not bound", ""),
    ("contract c: drive by follow", "E408", "an input that is not bound", ""),
    ("module a = follow(keep = 1 m)\nnetwork { w = a }", "E408", "module `a` has an input",
     "bind `side` there: `module a = follow(..., side = ...)`"),
    ("module a = follow()\nnetwork { w = a }", "E408", "module `a` has an input",
     "bind `side` there: `module a = follow(side = ...)`"),
    ("module a = follow(sid = 1 m)\nnetwork { w = a }", "E404", "no param or input `sid`", "mean `side`?"),
    ("module a = follow(sid = 1 m)\nmodule b = a(keep = 1 m)\nnetwork { w = b }", "E404", "`sid`", ""),
    ("module a { input x : mm param x = 3 when true }", "E102", "`x` is declared twice in the module", ""),
    ("module a { input x : mm let x = 3 when true }", "E102", "`x` is declared twice in the module", ""),
    ("module a { input last : mm when true }", "E109", "`last` is a reserved name", ""),
    ("module a { input x : foot when true }", "E101", "unknown type `foot`", ""),
    ("module a { input x[0] : mm when true }", "E214", "the size of an array", ""),
    ("module a { input x : mm = keep param keep = 3 mm when true }", "E101", "unknown name `keep`", ""),
    ("module a { input x : mm when x < 3 s }", "E201", "a value in mm and a value in s", ""),
    ("module a { input x : mm when true param y = sonar[x..3] }", "E005", "found `param`", "before `when`"),
    ("module a { when true input x : mm }", "E005", "found `input`", "`input` belongs before `when`"),
    ("input x : mm", "E005", "expected `bearing`, `default`, `from` or `range`", "in `module NAME"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "code", "message", "hint"), ERRORS, ids=[text[:50] for text, *_ in ERRORS])
def test_an_error_is_reported_once(text: str, code: str, message: str, hint: str) -> None:
    shown = messages(f"{text}\n{LEFT}")
    assert shown.count(": error[") == 1, shown
    assert f"error[{code}]" in shown
    assert message in shown
    assert hint in shown.rpartition("hint: ")[2], shown


def test_a_module_with_unbound_inputs_shows_where_it_is_derived() -> None:
    shown = messages(f"module a = follow()\nnetwork {{ w = a }}\n{LEFT}")
    assert "note: `a` is derived here\n  1 | module a = follow()" in shown


def test_the_text_of_a_template_is_checked() -> None:
    assert findings("module m { input a : mm input s[] : mm when s[3] < a and a < 1 s and nothing }") == [
        "1:58 E201",
        "1:70 E101",
    ]


def test_an_array_of_a_template_has_the_bearings_of_what_is_bound() -> None:
    text = "module m { input s[24] : bool when any(s[-30 deg .. 30 deg]) and s[180 deg] and s[25] }"
    assert findings(f"{text}\nmodule a = m(s = infrared)") == []
    assert findings(f"{text}\nmodule b = m(s = sonar > 1 m)") == ["1:40 E216", "1:66 E216", "1:83 E205"]


def test_a_contract_cannot_read_a_template() -> None:
    text = f"{LEFT}contract c: follow.side < 1 m or follow.keep > 1 mm"
    assert [finding.split()[1] for finding in findings(text)] == ["E408", "E408"]
    assert findings(text.replace("follow.", "left.").replace("module left = left.", "")) == []


def test_contracts_ask_whether_an_input_is_missing() -> None:
    whole = program(f"{LEFT}{NETWORK}contract c: fresh(left.side)")
    [contract] = whole.contracts
    assert contract.expression == e.Fresh(type=BOOL, name="left.side", derived=True)
    step = Interpreter(whole).step
    assert step(Frame(0, {"sonar": [3000.0] * 24})).breaches == ()
    assert step(Frame(50_000_000, {})).breaches == ("c",)


def test_a_template_is_no_part_of_the_program() -> None:
    whole = program(FOLLOW)
    assert whole.modules == ()
    assert whole.derived == ()
    assert "W001" not in messages(f"{LEFT}{NETWORK}")


def test_a_value_and_an_input_of_one_full_name(tmp_path: Path) -> None:
    files = Files(tmp_path)
    files.write(
        low='import "rome"\nlet side = 1 m',
        middle='import "low" as left',
        top=f'import "middle"\n{LEFT}',
    )
    assert files.findings("top") == ["top.colony:9:22 E102"]


def test_printing_keeps_inputs_and_functions() -> None:
    text = (
        "let f(a[] : mm, b[3] : bool, c : s = 1 s) = a + c\n\nlet x = f(y, c = 2 s)\n\n"
        "module m {\n  input a[] : mm\n  input b : bool = x\n  let g(z : mm) = z\n  when g(a)\n}\n"
    )
    file = parse(Source("text", text)).file
    assert print_file(file) == text
