"""`module a = b(...)`: params set anew, memory of its own, errors told once and in the right place."""

from __future__ import annotations

import pytest

from colony.ir import expression as e
from colony.ir.program import Module, PythonModule
from tests.dsl.texts import findings, messages, named, program

BASE = """
module base {
  param near = 1 m
  param wide = near * 2
  param kind = goal.a
  param bold = false
  state count = 0
  next count = count + 1
  let  close = sonar[12] < wide
  when close or bold
  do   drive(velocity = near / 10 s, turn = 0)
}
enum goal { a = 1, b = 2 }
"""


def params(name: str, text: str) -> dict[str, object]:
    return dict(named(Module, name, BASE + text).params)


def test_params_set_anew_are_seen_by_those_below() -> None:
    assert params("x", "module x = base") == {"near": 1000.0, "wide": 2000.0, "kind": 1.0, "bold": False}
    assert params("x", "module x = base(near = 3 m)")["wide"] == 6000.0
    assert params("x", "module x = base(near = 3 m, wide = 1 m)")["wide"] == 1000.0
    assert params("x", "module x = base(kind = goal.b, bold = true)")["kind"] == 2.0
    assert params("x", "module x = base(near = 0)")["near"] == 0.0


def test_arguments_are_constants_of_the_file_that_sets_them() -> None:
    assert params("x", "param near = 4 m\nmodule x = base(near = near / 2)")["near"] == 2000.0


def test_a_chain_of_derived_modules() -> None:
    text = "module x = base(near = 3 m)\nmodule y = x(bold = true)\nmodule z = y(near = 5 m)"
    assert params("z", text) == {"near": 5000.0, "wide": 10000.0, "kind": 1.0, "bold": True}


def test_a_base_may_stand_below() -> None:
    text = "module z = y(near = 5 m)\nmodule y = x(bold = true)\nmodule x = base"
    assert params("z", text)["near"] == 5000.0


def test_names_and_memory_are_its_own() -> None:
    whole = program(BASE + "module x = base\nmodule w { when recently(bumper, 1 s) }\nmodule v = w")
    base, x, w, v = whole.modules
    assert isinstance(base, Module)
    assert isinstance(x, Module)
    assert [s.name for s in x.states] == ["x.count"]
    assert [let.name for let in x.lets] == ["x.close"]
    assert isinstance(x.when, e.BinaryOperation)
    assert x.when.left == e.LocalValue(type=x.when.left.type, name="x.close")
    assert isinstance(w, Module)
    assert isinstance(v, Module)
    assert isinstance(w.when, e.MemoryCall)
    assert isinstance(v.when, e.MemoryCall)
    assert w.when.cell != v.when.cell


def test_a_contract_sees_the_params_of_each() -> None:
    assert (
        findings(BASE + "module x = base(near = 3 m)\ncontract c: x.near > base.near and x.count >= 0") == []
    )


def test_of_a_python_module() -> None:
    text = """module p from python "a:B" { param gain = 2 reads sonar commands drive rate 1 s }
              module q = p(gain = 3)"""
    q = named(PythonModule, "q", text)
    assert (q.params, q.class_name, q.actuator, q.rate_ns) == ((("gain", 3.0),), "B", "drive", 10**9)


def test_errors_of_the_base_are_told_once() -> None:
    assert findings("module a { param p = 1 when nobody }\nmodule b = a(p = 2)\nmodule c = b") == [
        "1:29 E101"
    ]


def test_a_param_that_does_not_fit_in_the_base_shows_the_derivation() -> None:
    text = "module a { param i = 3 when sonar[i] < 1 m }\nmodule b = a(i = 30)"
    assert findings(text) == ["1:35 E205"]
    shown = messages(text)
    assert "error[E205]: index 30 is outside the array" in shown
    assert "<text>:2:1: note: derived here\n  2 | module b = a(i = 30)" in shown


def test_all_places_that_a_param_makes_wrong_are_reported_once() -> None:
    text = "module a { param i = 3 when sonar[i] < sonar[i + 1] }\nmodule b = a(i = 30)\nmodule c = b"
    assert findings(text) == ["1:35 E205", "1:46 E205"]


def test_a_call_in_the_base_shows_the_call_and_the_derivation() -> None:
    text = (
        "let at(i : number) = sonar[4 / i]\nmodule a { param i = 4 when at(i) < 1 m }\nmodule b = a(i = 0.1)"
    )
    shown = messages(text)
    assert findings(text) == ["1:28 E205"]
    assert shown.index("note: called here") < shown.index("note: derived here")


def test_a_param_of_the_wrong_type_is_told_at_its_value() -> None:
    text = (
        "module a { param i = 3 mm when sonar[1] < i }\nmodule b = a(i = 30)\nmodule c = b(i = 1 s, i = 4 mm)"
    )
    assert findings(text) == ["2:18 E404", "3:18 E404", "3:23 E404"]


@pytest.mark.long
def test_a_long_chain() -> None:
    text = (
        BASE + "".join(f"module m{i} = m{i + 1}(near = {i} m)\n" for i in range(2000)) + "module m2000 = base"
    )
    assert dict(named(Module, "m0", text).params)["near"] == 0.0


def test_a_long_cycle() -> None:
    text = "".join(f"module m{i} = m{(i + 1) % 2000}\n" for i in range(2000))
    assert findings(text) == ["1:8 E404"]
    assert "`m0` = `m1` = `m2` = `m3` = ... = `m0`" in messages(text)
