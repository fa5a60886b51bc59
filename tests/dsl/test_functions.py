"""Functions: what a call means, which calls are errors, and how large and deep programs get."""

from __future__ import annotations

from itertools import count
from pathlib import Path

import pytest

from colony.dsl.check.compatibility import with_new_cells
from colony.dsl.load import load_text
from colony.ir import expression as e
from colony.ir.frame import Frame
from colony.ir.program import Contract, Module
from colony.verify.reference.interpreter import Interpreter
from tests.dsl.test_imports import Files
from tests.dsl.texts import ROBOT, expression, findings, messages, named, program
from tests.sampling import long

NEAR = "let near(r : mm, d : mm = 900 mm) = recently(r < d, 1 s)"


def renumbered(text: str, before: str = "") -> e.Expression:
    """The typed expression of a text, its memory cells numbered in the order of the text."""
    return with_new_cells(expression(text, before), count(1).__next__)


def cells(of: e.Expression) -> list[int]:
    return [x.cell for x in e.subexpressions(of) if isinstance(x, e.MemoryCall)]


@pytest.mark.parametrize(
    ("function", "call", "meaning"),
    [
        (NEAR, "near(sonar[3])", "recently(sonar[3] < 900 mm, 1 s)"),
        (NEAR, "near(sonar[3], 1 m)", "recently(sonar[3] < 1 m, 1 s)"),
        (NEAR, "near(sonar[3], d = 1 m)", "recently(sonar[3] < 1 m, 1 s)"),
        (NEAR, "near(d = sonar[1], r = sonar[2])", "recently(sonar[2] < sonar[1], 1 s)"),
        ("let f() = now", "f() + 1 s", "now + 1 s"),
        (
            "let f(scan[] : mm) = max(scan) - min(scan)",
            "f(sonar[3..5])",
            "max(sonar[3..5]) - min(sonar[3..5])",
        ),
        ("let f(scan[24] : mm) = scan < 1 m", "f(sonar)", "sonar < 1 m"),
        ("let f(b : bool, t : s = 2 s) = sustained(b, t)", "f(bumper, 3 s)", "sustained(bumper, 3 s)"),
        ("let f(b : bool, t : s = 2 s) = sustained(b, t)", "f(bumper)", "sustained(bumper, 2 s)"),
        ("let f(n : number) = sum(sonar[k] for k in 0 .. n)", "f(5)", "sum(sonar[k] for k in 0 .. 5)"),
        ("let f(b : bool) = rising(b) or falling(b)", "f(bumper)", "rising(bumper) or falling(bumper)"),
        (
            "let f(x : number) = x + x",
            "f(previous(docked_at, 0))",
            "previous(docked_at, 0) + previous(docked_at, 0)",
        ),
        (
            "let g(x : mm) = x * 2\nlet f(x : mm) = g(x) + g(x = x + 1 mm)",
            "f(sonar[0])",
            "sonar[0] * 2 + (sonar[0] + 1 mm) * 2",
        ),
        ("let f(bumper : mm) = bumper < 1 m", "f(sonar[0])", "sonar[0] < 1 m"),
        ("let f(m : goal) = m == goal.a\nenum goal { a = 1 }", "f(goal.a)", "goal.a == goal.a"),
    ],
)
def test_a_call_means_the_body_with_the_arguments(function: str, call: str, meaning: str) -> None:
    assert renumbered(call, function) == renumbered(meaning, "enum goal { a = 1 }\n" * ("goal" in call))


@pytest.mark.parametrize("whole", ["ahead", "sonar[3..7]", "window(sonar, 5, 2)", "same(sonar[3..7])"])
def test_indices_of_a_parameter_are_its_own(whole: str) -> None:
    text = f"""
    let ahead = sonar[3..7]
    let same(x[] : mm) = x
    let least(x[] : mm) = x[index_of_min(x)]
    let inner(x[] : mm) = x[index_of_min(x[1..3])]
    let outer(x[] : mm) = least(x) + index_of_min(same(x)) * 1 mm
    contract exact: least({whole}) == 4 mm and inner({whole}) == 4 mm and outer({whole}) == 6 mm
    """
    readings = [0.0, 0.0, 0.0, 6.0, 7.0, 4.0, 5.0, 8.0, *[0.0] * 16]
    assert Interpreter(program(text)).step(Frame(0, {"sonar": readings})).breaches == ()


def test_names_in_a_body_are_those_of_the_declaration() -> None:
    text = """
    param limit = 1 m
    let near(r : mm) = r < limit
    module m { param limit = 2 m  let n = near(sonar[0]) and sonar[1] < limit  when n }
    """
    assert named(Module, "m", text).lets[0].expression == expression("sonar[0] < 1 m and sonar[1] < 2 m")


def test_a_function_of_a_module_reads_its_names_above() -> None:
    text = """
    module m {
      param limit = 1 m
      let ahead = sonar[12]
      let near(r : mm) = r < limit and r < ahead
      when near(sonar[0])
    }
    module wide = m(limit = 2 m)
    """
    when = named(Module, "wide", text).when
    assert isinstance(when, e.BinaryOperation)
    assert isinstance(when.right, e.BinaryOperation)
    assert when.left == expression("sonar[0] < 2 m")
    assert when.right.right == e.LocalValue(type=when.right.right.type, name="wide.ahead")


def test_each_call_has_memory_of_its_own() -> None:
    text = f"{NEAR}\nlet f(r : mm) = near(r) or near(r, 1 m)\nlet a = f(sonar[0])\nlet b = f(sonar[0])"
    derived = {d.name: d for d in program(text).derived}
    found = [c for name in "ab" for c in cells(derived[name].expression)]  # type: ignore[union-attr]
    assert len(set(found)) == len(found) == 4


def test_memory_in_an_argument_exists_once_for_each_place() -> None:
    found = cells(expression("f(recently(bumper, 1 s))", "let f(b : bool) = b and (b or not b)"))
    assert len(set(found)) == len(found) == 3


def test_a_variable_of_a_reduction_is_not_captured() -> None:
    function = "let most(x : number) = max(x + k for k in 0 .. 3)"
    found = expression("sum(most(k) for k in 0 .. 2)", function)
    assert isinstance(found, e.Reduce)
    assert isinstance(found.body, e.Reduce)
    assert found.variable != found.body.variable
    assert isinstance(found.body.body, e.BinaryOperation)
    assert found.body.body.left == e.LoopIndex(type=found.body.type, name=found.variable)
    inner = expression("most(sum(k for k in 0 .. 2))", function)
    assert len({x.variable for x in e.subexpressions(inner) if isinstance(x, e.Reduce)}) == 2
    assert findings("let f(x : number) = x + k\nlet a = sum(f(1) for k in 0 .. 2)") == ["1:25 E101"]


def test_a_literal_zero_has_the_type_of_its_parameter() -> None:
    found = expression("f(0)", "let f(x : mm) = x")
    assert str(found.type) == "mm"
    assert findings("let zero() = 0\nlet a = zero() < sonar[0]") == ["2:9 E201"]


FRESH = [
    ("sonar[3]", "fresh(sonar)"),
    ("sonar[3] + sonar[4]", "fresh(sonar)"),
    ("if bumper then sonar[3] else 1 m", "all(fresh(bumper), fresh(sonar))"),
    ("value_or(sonar[3], 1 m)", "true"),
    ("ahead", "fresh(ahead)"),
    ("docked_at * 1 mm", "fresh(docked_at)"),
    ("last.drive.velocity * 1 s", "fresh(last.drive.velocity)"),
    ("now * 1 mm/s", "true"),
]


@pytest.mark.parametrize(("argument", "meaning"), FRESH)
def test_fresh_asks_of_all_that_an_argument_needs(argument: str, meaning: str) -> None:
    before = "let ahead = sonar[12]\nlet f(x : mm) = fresh(x)\nlet g(x : mm) = f(x)"
    assert expression(f"g({argument})", before) == expression(meaning, before)


def test_fresh_cannot_ask_for_lets_of_modules_in_contracts() -> None:
    text = "let f(x : mm) = fresh(x)\nmodule m { let near = sonar[0] when f(near) }\ncontract c: f(m.near)"
    assert findings(text) == ["1:23 E202"]
    assert "3:13: note: called here" in messages(text)


def test_what_a_body_does_not_read_is_not_needed() -> None:
    text = """
    let first(a : mm, b : mm) = a
    module m { when first(sonar[0], heading * 1 mm / 1 deg) < 1 m do drive(velocity = 1 mm/s, turn = 0) }
    network { drive = m }
    """
    interpreter = Interpreter(program(text))
    [decision, _] = interpreter.step(Frame(0, {"sonar": [500.0] * 24})).decisions
    assert decision.by == "m"


def test_functions_stand_wherever_expressions_do() -> None:
    text = f"""
    {NEAR}
    state s = false
    next s = near(sonar[0])
    machine mode {{ start a  a -> b when near(sonar[1])  b -> a when not near(sonar[1]) }}
    module m {{ when near(sonar[2]) do drive(velocity = if near(sonar[3]) then 1 mm/s else 0, turn = 0) }}
    network {{ drive = m }}
    limit drive.velocity <= 100 mm/s when near(sonar[4])
    let is_slow(b : bool, v : mm/s) = b implies v < 1 m/s
    contract c: is_slow(drive by m, drive.velocity)
    test "t" {{ at 0 s given sonar = 500 expect near(sonar[5]), is_slow(drive by m, v = drive.velocity) }}
    """
    whole = program(text)
    velocity = e.SentField(type=whole.robot.actuators[0].fields[0].type, actuator="drive", field_index=0)
    [contract] = whole.contracts
    assert isinstance(contract, Contract)
    assert velocity in list(e.subexpressions(contract.expression))


ERRORS = [
    ("let a = near()", "`near` needs `r`", "use: near(r, d = ...)"),
    ("let a = near(sonar[0], 1 m, 1 m)", "`near` takes 2 arguments, found 3", "use: near(r, d = ...)"),
    ("let a = near(sonar[0], x = 1 m)", "`near` has no parameter `x`", "use: near(r, d = ...)"),
    ("let a = near(sonar[0], r = 1 m)", "parameter `r` is given twice", ""),
    ("let a = near(d = 1 m, sonar[0])", "without a name stands after one with a name", "use: near"),
    ("let a = near(bumper)", "parameter `r` of `near` takes a value in mm, found a bool", ""),
    ("let a = near(sonar)", "takes a value in mm, found an array of 24 values in mm", ""),
    ("let f(s[] : mm) = 1\nlet a = f(sonar[0])", "an array of values in mm, found a value in mm", ""),
    ("let f(s[3] : mm) = 1\nlet a = f(sonar)", "an array of 3 values in mm, found an array of 24", ""),
    ("let a = later(1)\nlet later(x : number) = x", "`later` is used before it is declared", "call itself"),
    ("let f(x : number) = f(x)", "`f` is used before it is declared", "a function cannot call itself"),
    ("let v = 3\nlet a = v(1)", "`v` is a value, not a function", ""),
    ("let v = 3\nlet a = v()", "`v` is a value, not a function", "leave the parentheses out"),
    ("let a = bumper()", "`bumper` is a value, not a function", ""),
    ("param p = 3\nlet a = p(1)", "`p` is a constant, not a function", ""),
    ("let a = sum(k(1) for k in 0 .. 1)", "`k` is the variable of a reduction, not a function", ""),
    ("module m { when true }\nlet a = m(1)", "`m` is a module, not a function", ""),
    ("let a = near", "`near` is a function, not a value", "call it: `near(r, d)`"),
    ("module m { when near < 3 }", "`near` is a function, not a value", ""),
    ("let a = nears(sonar[0])", "unknown function `nears`", "did you mean `near`?"),
    ("let a = brooks.near(sonar[0])", "unknown function `brooks.near`", ""),
    ("module m { let f(x : mm) = x when true }\nlet a = m.f(1 mm)", "`m` is a module", "only inside it"),
    ("let f(x : mm = sonar[0]) = x", "the default of `x` must be constant", "use literals"),
    ("let f(x : mm = 3) = x", "the default of `x` must be a value in mm", ""),
    ("let f(x[] : mm = 3 mm) = x", "the array `x` cannot have a default", ""),
    ("let f(x : mm, x : s) = x", "parameter `x` is declared twice", ""),
    ("let f(x : metre) = x", "unknown type `metre`", ""),
    ("let f(restarted : bool) = restarted", "`restarted` is a reserved name", ""),
    ("let min(x : mm) = x", "`min` is a function of the language", "choose another name"),
    ("let bumper(x : mm) = x", "the robot has a sensor `bumper` already", ""),
    ("let near = 3", "`near` is declared twice", ""),
    ("param p = near(1 mm)", "`near` is not constant", ""),
    ("let a = sonar[0..half(2)]\nlet half(x : number) = x / 2", "`half` is not constant", ""),
    ("let half(x : number) = x / 2\nlet a = sonar[0..half(2)]", "a call is not constant", ""),
    ("let f(x : mm) = x < 3 s", "`<` needs two numbers of one dimension", ""),
    ("let f(x : bool) = drive by cruise", "allowed only in contracts", ""),
    ("let a = min(b = 3)", "`min` takes its arguments by position", "compare with `==`"),
    ("let a = clamp(1, 2, high = 3)", "`clamp` takes its arguments by position", "use: clamp(x, low, high)"),
]


@pytest.mark.parametrize(("text", "message", "hint"), ERRORS, ids=[text[-40:] for text, _, _ in ERRORS])
def test_an_error_is_reported_once(text: str, message: str, hint: str) -> None:
    shown = messages(f"{text}\n{NEAR}" if text == "let near = 3" else f"{NEAR}\n{text}")
    assert shown.count(": error[") == 1, shown
    assert message in shown
    assert hint in shown.rpartition("hint: ")[2], shown


def test_errors_in_a_body_are_reported_once_and_not_by_calls() -> None:
    text = "let f(x : mm) = x + nothing\nlet g(x : mm) = f(x)\nlet a = f(1 mm) + g(1 mm)\nlet b = g(sonar)"
    assert findings(text) == ["1:21 E101"]
    assert findings(f"{text} + nobody")[1:] == ["4:20 E101"]


def test_an_error_that_only_a_call_shows_names_all_calls() -> None:
    text = "let tenth(s[] : mm) = s[9]\nlet twice(s[] : mm) = tenth(s) * 2\nlet a = twice(sonar[0..3])"
    shown = messages(text)
    assert findings(text) == ["1:25 E205"]
    assert shown.index("2:23: note: called here") < shown.index("3:9: note: called here")
    assert findings(f"{text}\nlet b = twice(sonar[0..8])\nlet c = twice(sonar)") == ["1:25 E205", "1:25 E205"]


def test_an_array_has_the_bearings_of_the_argument() -> None:
    text = (
        "let f(s[24] : bool) = any(s[-30 deg .. 30 deg]) and any(b and a > 0 deg for b, a in s)\nlet a = f("
    )
    assert findings(f"{text}not infrared)") == []
    assert findings(f"{text}sonar > 1 m)") == ["1:27 E216", "1:85 E216"]


def test_a_constant_that_depends_on_a_parameter_is_asked_of_each_call() -> None:
    text = "let f(b : bool, t : s) = sustained(b, t)\nlet g(t : s) = f(bumper, t * 2)\nlet a = g(1 s)"
    assert findings(text) == []
    shown = messages(f"{text}\nlet b = g(now)")
    assert "1:39: error[E204]: the duration of `sustained` must be constant" in shown
    assert "4:9: note: called here" in shown
    assert findings("let f(t : mm) = sustained(bumper, t)") == ["1:35 E202"]


def test_functions_come_in_by_imports(tmp_path: Path) -> None:
    files = Files(tmp_path)
    files.write(
        helpers=f"param far = 3 m\n{NEAR}\nlet is_far(r : mm) = r > far",
        by_alias='import "rome"\nimport "helpers" as h\n'
        "let x = h.near(sonar[0], d = h.far) and h.is_far(sonar[1])",
        plainly='import "rome"\nimport "helpers"\nlet x = near(sonar[0], far) and is_far(sonar[1])',
    )
    found = [
        with_new_cells(d.expression, count(1).__next__)  # type: ignore[union-attr]
        for root in ("by_alias", "plainly")
        for d in files.program(root).derived
    ]
    assert found[0] == found[1]
    files.write(wrong='import "rome"\nimport "helpers" as h\nlet x = near(sonar[0]) and h.neer(sonar[0])')
    assert files.findings("wrong") == ["wrong.colony:3:9 E107", "wrong.colony:3:28 E107"]


def test_an_error_in_a_body_is_reported_once_with_the_first_call() -> None:
    calls = "\n".join(f"let a{i} = least(sonar[{i}..{i + 1}])" for i in range(3))
    shown = messages(f"let least(x[] : mm) = min(x[8], x[9])\n{calls}")
    assert shown.count(": error[") == 2
    assert shown.count("called here") == 2


# --- sizes -----------------------------------------------------------------------------------------


def chain(links: int, body: str, call: str) -> str:
    lines = ["let f0(x : number) = x + x"]
    lines += [f"let f{i}(x : number) = {body.replace('f(', f'f{i - 1}(')}" for i in range(1, links)]
    return "\n".join([*lines, f"let a = {call.replace('f(', f'f{links - 1}(')}"])


@pytest.mark.parametrize(
    "body",
    [
        "f(x) + f(x)",
        *map(long, ["f(f(x))", "f(x + x)", "f(previous(x, 0) + x)", "min(f(x), f(x), f(x))"]),
    ],
)
def test_functions_that_double_end_with_one_error(body: str) -> None:
    shown = messages(chain(60, body, "f(docked_at)"))
    assert shown.count(": error[") == 1
    assert "error[E012]: with the functions called here, the program has more than 100,000" in shown


@pytest.mark.long
def test_a_program_is_too_large_once() -> None:
    text = chain(12, "f(x) + f(x)", "f(docked_at)")
    assert findings(text) == []
    calls = "\n".join(f"let b{i} = f11(docked_at)" for i in range(30))
    assert [f.split()[1] for f in findings(f"{text}\n{calls}")] == ["E012"]


@pytest.mark.thorough
def test_templates_do_not_count() -> None:
    text = chain(12, "f(x) + f(x)", "f(docked_at)")
    modules = "\n".join(f"module m{i} {{ input n : number when f11(n) > 0 }}" for i in range(30))
    assert findings(f"{text}\n{modules}") == []


def test_chains_of_calls_nest_as_deep_as_expressions() -> None:
    assert findings(chain(90, "f(x)", "f(docked_at)")) == []
    shown = messages(chain(1000, "f(x)", "f(docked_at)"))
    assert shown.count(": error[") == 1
    assert "error[E004]: with the functions called here, the expression nests more than 100 levels" in shown
    assert "hint: name parts of it with `let`" in shown


def test_arguments_nest_where_they_are_read() -> None:
    before = f"let f(x : number) = {'-' * 60}x"
    deep = f"let a = f({'-' * 30}docked_at)"
    assert findings(f"{before}\n{deep}") == []
    assert findings(f"{before}\n{deep.replace('(', '(' + '-' * 30)}") == ["2:9 E004"]


def test_iterations_multiply_through_arguments() -> None:
    text = "let f(x : number) = sum(x for k in 0 .. 99)\nlet a = f(sum(1 for k in 0 .. {}))"
    assert findings(text.format(39)) == []
    shown = messages(text.format(49))
    assert "1:25: error[E211]: 5000 iterations with what `x` stands for" in shown
    assert "2:9: note: called here" in shown


def test_spans_are_those_of_the_call() -> None:
    whole = load_text(f"{NEAR}\ncontract c: near(sonar[0])\n{ROBOT}")
    span = whole.contracts[0].expression.span
    assert span.source.text[span.start : span.end] == "near(sonar[0])"


def test_rendered_errors_of_deep_calls_stay_short() -> None:
    text = "let f0(s[] : mm) = s[9]\n" + "\n".join(f"let f{i}(s[] : mm) = f{i - 1}(s)" for i in range(1, 50))
    shown = messages(f"{text}\nlet a = f49(sonar[0..3])")
    assert shown.count("called here") == 10
