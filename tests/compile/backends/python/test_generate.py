"""Generated Python: what it looks like, that it stands alone, and that size and depth are no trouble."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from colony.compile.backends.python.generate import generate, load
from colony.compile.lower.lower import lower
from colony.compile.pipeline import compile_program
from colony.dsl.load import load_text
from colony.ir.expression import NESTING_LIMIT, Expression, Unary, UnaryOperation
from colony.ir.frame import Frame
from colony.ir.program import Program
from colony.text.diagnostics import DiagnosticError
from colony.verify.testing.strategies import traces
from tests.drawn.strategies import programs
from tests.executors import outcomes
from tests.networks import chain
from tests.programs import generated
from tests.runtime.programs import roam

WANDER = """
robot rome {
  sensor sonar[24] : mm range 0 .. 10000 from PServer.sonar
  sensor bumper : bool from RServer.bumper
  actuator drive { velocity : mm/s range -600 .. 600, turn : deg/s range -90 .. 90 }
    to RServer.drive idle drive(velocity = 0, turn = 0)
}
let ahead = min(sonar[11..13])
module cruise { when true  do drive(velocity = 300 mm/s, turn = 0) }
module avoid {
  let left = min(sonar[13..17])
  let right = min(sonar[7..11])
  when min(left, right, ahead) < 600 mm
  do drive(velocity = 80 mm/s, turn = if left > right then 30 deg/s else -30 deg/s)
}
module back_off { when recently(bumper, 2 s)  do drive(velocity = -0.2 * sonar[0] / 1 s, turn = 15 deg/s) }
network { drive = back_off suppresses (avoid suppresses cruise) }
contract never_ram: bumper implies drive.velocity <= 0
"""


def _source(text: str) -> str:
    return generated(load_text(text, "wander.colony"))


def _imports(source: str) -> set[str]:
    found: set[str] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom):
            found.add(node.module or "")
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    return found


def _step(source: str) -> str:
    return source[source.index("    def step(self, t_ns, readings, taken_ns=None, restarted=False):") :]


def test_it_reads_like_the_program() -> None:
    step = _step(_source(WANDER))
    assert "# back_off, priority 3, wander.colony:" in step
    assert "# avoid, priority 2, wander.colony:" in step
    assert "min(sonar[11], sonar[12], sonar[13])" in step
    assert "avoid_left = min(sonar[13:18])" in step
    assert "self.back_off_recently_" in step
    assert max(map(len, step.splitlines())) <= 150


def test_commands_are_computed_for_the_winner_only() -> None:
    lines = _step(_source(WANDER)).splitlines()
    (at,) = (i for i, line in enumerate(lines) if "-0.2 * sonar[0]" in line)
    assert "drive_by = 'back_off'" in lines[at - 1]
    indent = len(lines[at]) - len(lines[at].lstrip())
    assert indent > min(len(line) - len(line.lstrip()) for line in lines if "# avoid" in line)


def test_a_value_is_computed_once() -> None:
    step = _step(_source(WANDER))
    assert step.count("min(sonar[13:18])") == step.count("min(sonar[7:12])") == 1


def test_what_can_hold_no_nan_needs_no_helper() -> None:
    assert "def minimum" not in _source(WANDER)
    without_range = (
        WANDER.replace(" range 0 .. 10000", "")
        .replace("min(sonar[7", "min(sqrt(sonar[7")
        .replace("11])\n  when", "11] / 1 mm) * 1 mm)\n  when")
    )
    assert "def minimum" in _source(without_range)


@given(data=st.data())
def test_it_imports_nothing_but_math_and_the_users_modules(data: st.DataObject) -> None:
    source = generated(data.draw(programs()))
    assert _imports(source) <= {"math", "tests.drawn.python_modules"}


def test_it_runs_without_colony(tmp_path: Path) -> None:
    path = tmp_path / "wander.py"
    path.write_text(_source(WANDER))
    code = (
        "import sys, wander; p = wander.Program()\n"
        "r = {'sonar': [3000.0] * 24, 'bumper': False}\n"
        "print(p.step(5, r)); r['sonar'][15] = 40000.0; r['sonar'][9] = 200; print(p.step(6, r))\n"
        "print(p.step(7, {})); print('colony' in sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-I", "-c", f"import sys; sys.path.insert(0, {str(tmp_path)!r})\n{code}"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.splitlines() == [
        "((('drive', 'cruise', (300.0, 0.0), None),), (), ())",
        "((('drive', 'avoid', (80.0, 30.0), None),), (('sensor clamped', 'sonar'),), ())",
        "((('drive', 'cruise', (300.0, 0.0), None),), (), ('never_ram',))",  # nobody knows of the bumper
        "False",
    ]


def test_names_that_python_or_the_backend_needs_for_itself() -> None:
    text = """
robot class_ {
  sensor lambda : number from DServer.x
  sensor min : number from DServer.x
  sensor self : bool from DServer.x
  sensor records : number from DServer.x
  sensor settle : number from DServer.x
  sensor has_min : number from DServer.x
  sensor __x : number from DServer.x
  sensor get : number from DServer.t
  actuator def { t : number, min : number } to DServer.Out idle hold
}
state first_ns = 0
next first_ns = first_ns + 1
let None = min + lambda
module None_ {
  when self
  do   def(t = None + __x + get + now() / 1 s, min = records + has_min + settle + first_ns)
}
network { def = None_ }
"""
    program = load_text(text)
    executor = load(generated(program))
    frame = {"lambda": 1.0, "min": 2.0, "self": True, "records": 3.0, "settle": 4.0, "has_min": 5.0}
    for i in range(2):
        (decision,) = executor.step(Frame(i * 10**9, frame | {"__x": 6.0, "get": 7.0})).decisions
        assert decision.values == (16.0 + i, 12.0 + i)


def test_odd_text_in_names_of_files_stays_in_comments() -> None:
    source = generated(load_text(WANDER, 'a"""\nimport os\n\\'))
    assert _imports(source) == {"math"}
    assert ":  # avoid, priority 2, a????import os??:" in source
    load(source)


def test_names_stand_in_comments_as_they_are() -> None:
    program = load_text(WANDER.replace("avoid", "Xeno_XX"), "X.colony")
    assert re.search(r":  # Xeno_XX, priority 2, X\.colony:\d+$", generated(program), re.M)


def test_a_program_that_was_made_without_text_has_no_places() -> None:
    source = generated(roam())
    assert re.search(r"# cruise, priority 1$", source, re.MULTILINE)
    assert "<none>" not in source


def test_a_class_that_cannot_be_named_is_refused() -> None:
    text = WANDER + 'module p from python "colony.x:Y" { reads bumper }\nmodule q { when true }\n'
    program = load_text(text)
    for path in ("os; import x", "os.class", "", "x..y"):
        wrong = tuple(replace(m, module_path=path) if m.name == "p" else m for m in program.modules)
        other = replace(program, modules=wrong)
        with pytest.raises(DiagnosticError) as failure:
            generated(other)
        (found,) = failure.value.diagnostics
        assert (found.code, found.message) == ("E405", f"`{path}.Y` is not the name of a Python class")


def test_modules_in_python_are_built_with_their_params_and_asked_where_all_is_there() -> None:
    text = WANDER + (
        'module p from python "colony.x:Y" { param a = 1 param b = 2.5 reads bumper }\n'
        'module q from python "colony.x:Y" { reads calm }\nstate calm = 0\n'
    )
    source = _source(text)
    assert source.count("from colony.x import Y as ") == 2
    assert "(**{'a': 1.0, 'b': 2.5})," in source
    assert re.search(r"PythonStep\('q', Python\w+\(\), ", source)
    assert re.search(r"\.step\(t, \{'bumper': bumper\} if has_bumper else None, records\)", source)
    assert re.search(r"\.step\(t, \{'calm': [\w.]+\}, records\)", source)


def test_where_a_module_is_in_python_time_counts() -> None:
    robot = WANDER[: WANDER.index("let ahead")]
    still = "module still { when bumper do drive(velocity = 0, turn = 0) }\nnetwork { drive = still }\n"
    assert "first_ns" not in _source(robot + still)
    assert "self.first_ns = t_ns" in _source(robot + still + 'module p from python "a:B" { reads bumper }\n')


# --- size and depth ------------------------------------------------------------------------------


def _agree(program: Program, *readings: dict[str, object]) -> None:
    outcomes(program, [Frame(i, reading) for i, reading in enumerate(readings)])


DEEP = """
robot r {
  sensor x : number from DServer.x
  sensor b : bool from DServer.b
  actuator out { v : number } to DServer.Out idle hold
}
module m { when b  do out(v = %s) }
network { out = m }
"""


def test_deep_nesting() -> None:
    depth = NESTING_LIMIT - 5
    _agree(load_text(DEEP % ("(" * 40 + "x" + " * 1.5 - 1)" * 40)), {"x": 3.0, "b": True})
    conditional = "x"
    for i in range(40):
        conditional = f"(if x < {i} then {i} else {conditional})"
    _agree(load_text(DEEP % conditional), {"x": 3.5, "b": True}, {"x": 50.0, "b": True})
    program = load_text(DEEP % "if b then 1 else 2")
    condition: Expression = program.modules[0].when  # type: ignore[union-attr]
    for _ in range(depth - depth % 2):
        condition = UnaryOperation(type=condition.type, operator=Unary.NOT, operand=condition)
    module = replace(program.modules[0], when=condition)
    _agree(replace(program, modules=(module,)), {"x": 0.0, "b": True}, {"x": 0.0, "b": False})


@pytest.mark.long
def test_big_arrays() -> None:
    text = (
        DEEP.replace("sensor x", "sensor a[3000] : number range -9 .. 9 from DServer.a\n  sensor x")
        % "sum(a) + min(a) + max(a[5..2990]) + count(a > 1) + index_of_max(a) + a[x] + mean(a[1..2])"
        + "contract any_: any(a < 0 or a > x)\ncontract later: count(recently(a > 8, 1 s)) < 10\n"
    )
    program = load_text(text)
    arrays = [[((i * seed) % 181) / 10 - 9 for i in range(3000)] for seed in (7, 13)]
    _agree(program, *[{"a": a, "x": 1234.0, "b": True} for a in arrays], {"a": arrays[0], "b": True})


def test_many_modules() -> None:
    source = generated(chain(3000))
    load(source)
    assert len(source) < 3000 * 400


def test_many_clients_of_one_shared_value() -> None:
    modules = "".join(
        f"module m{i} {{ when heavy > {i}  do out(v = heavy * {i} + light) }}\n" for i in range(60)
    )
    text = (DEEP % "x").replace("network { out = m }", "") + (
        "let heavy = sqrt(x) + sin(x * 1 deg) + sum(k * x for k in 1 .. 20)\nlet light = x - 1\n"
        + modules
        + f"network {{ out = {' suppresses '.join(f'm{i}' for i in reversed(range(60)))} }}\n"
    )
    source = _source(text)
    assert source.count("sqrt(") <= 3
    _agree(load_text(text), *[{"x": float(x), "b": True} for x in (-1, 0, 1, 2, 3)])


@given(data=st.data())
def test_generated_source_is_the_same_each_time(data: st.DataObject) -> None:
    program = data.draw(programs())
    clients = compile_program(program).clients
    source = generate(lower(program, clients))
    assert source == generate(lower(program, clients))
    assert not [line for line in source.splitlines() if line != line.rstrip()]
    executors = [load(source) for _ in range(2)]
    for frame in data.draw(traces(program)):
        assert len({repr(e.step(frame)) for e in executors}) == 1


@given(data=st.data())
def test_leaving_contracts_out_changes_nothing_else(data: st.DataObject) -> None:
    program = data.draw(programs())
    clients = compile_program(program).clients
    whole = load(generate(lower(program, clients)))
    without = load(generate(lower(replace(program, contracts=()), clients)))
    for frame in data.draw(traces(program)):
        expected, found = whole.step(frame), without.step(frame)
        assert repr(found) == repr(expected._replace(breaches=()))
