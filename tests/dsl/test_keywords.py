"""Words are keywords only where they can stand: every one is as good a name as any."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

import pytest

from colony.dsl.check.calls import FUNCTION_NAMES
from colony.dsl.parser import CONTEXTUAL_KEYWORDS as KEYWORDS
from colony.dsl.parser import GRAMMAR
from colony.dsl.syntax_errors import RESERVED
from colony.text.units import BASE_UNITS
from tests.dsl.texts import findings
from tests.sampling import sampled

CONTEXTUAL = re.findall(r"^([A-Z_]+)\.2: /(\w+)\\b/", GRAMMAR.read_text(encoding="utf-8"), re.MULTILINE)
WORDS = sorted(
    {
        *[word for _, word in CONTEXTUAL],
        *BASE_UNITS,
        *"min max sum held now fresh hold bool number count RServer t".split(),
    }
)

PROGRAM = """
robot r {{
  frame 50 ms
  sensor {sensor} : mm from PServer.x
  sensor array[4] : bool from PServer.y
  sensor b : bool from P.b
  actuator {actuator} {{ {field} : mm/s, other : bool }}
    to {server}.{member} idle {actuator}({field} = 0, other = true) on_loss stop
}}
enum {enum} {{ {enumerator} = 1, second = 2 }}
param {param} = 3 mm
let {let} = {sensor} + {param} + {param} * 2
let {function}({parameter} : mm, {other} : mm = 3 mm) = {parameter} + {other}
let {broken}({parameter} : bool) = not {parameter}
let called = {function}({sensor}, {other} = {let})
state {state} = 0
next {state} = {state} + 1
machine {machine} {{
  start one
  one -> two when {state} > 3 or any(array)
  any -> one when {machine} == {machine}.two
}}
module {module} {{
  param {own_param} = 1
  let {own_let} = {own_param} + 2
  state {own_state} = 0
  next {own_state} = {own_state} + {own_let}
  when {own_state} > {own_let} or {let} < {param}
  do {actuator}({field} = {own_state} * 1 mm/s, other = false)
}}
module {derived} = {module}({own_param} = 4)
sequence {sequence} when b {{
  out = {derived}({own_param} = 2) until b within 1 s else {end}
  back = {module} until value_or(b, true)
}}
assume {assume}: {let} < {param}
let breach = broken({assume}) or {broken}(b)
let over = {sequence} == {sequence}.{end}
module template {{
  input {input} : mm
  let {own_function}({parameter} : mm) = {input} < {parameter}
  when {own_function}({input})
}}
module bound = template({input} = {sensor})
module py from python "a:B" {{
  param {own_param} = 3
  reads {sensor}, {let}, array
  commands {actuator}
  rate 300 ms
}}
network {{ first = {module} {wire} = first suppresses {derived} {actuator} = {wire} suppresses[1 s] py }}
limit {actuator}.{field} <= 3 mm/s when {sensor} < 3 mm
contract {contract}: {actuator} by {module} implies {actuator}.{field} > 0 and {module} is active
  and {module}.{own_let} > {module}.{own_state} and {actuator} is idle and {wire} is active
contract {contract}_in_time in time requirement "SR-1", "SR-2": {actuator} by {module}
reach {reach}: {actuator} by {module}
let some = sum({k} for {k} in 0 .. 3 if {k} > 1) + count(array[{k}] for {k} in 0 .. 3)
let kind = {enum}.{enumerator} == {enum}.second
test "x" {{
  at 0 s given {sensor} = 3, array[1] = true expect {actuator} is commanded, {sensor} > {param}
  from 1 s to 2 s every 1 s given {sensor} = missing expect {actuator} by {derived}
}}
"""

ROLES = re.findall(r"\{(\w+)\}", PROGRAM)
EVERY = 4


def sample(words: Iterable[str], role: str) -> Sequence[str]:
    """Return a part of the words, another one for the next role."""
    return sorted(words)[sorted(set(ROLES)).index(role) % EVERY :: EVERY]


NAMES = {role: role.upper() for role in ROLES}


def test_the_program_is_good() -> None:
    assert findings(PROGRAM.format(**NAMES), robot="") == []


@pytest.mark.parametrize("role", sampled(sorted(set(ROLES)), every=4))
def test_every_word_is_a_name(role: str) -> None:
    for word in sample(WORDS, role):
        if word == "t" and role in ("sensor", "actuator"):
            continue  # recordings need it for the time
        found = findings(PROGRAM.format(**{**NAMES, role: word}), robot="")
        if word in FUNCTION_NAMES and role in ("function", "own_function", "broken"):
            assert "E109" in found[0], word
        elif word in BASE_UNITS and role == "end":
            assert "E407" in found[0], word
        else:
            assert found == [], word


@pytest.mark.parametrize("role", sorted(set(ROLES) - {"member"}))
def test_operator_words_are_reserved(role: str) -> None:
    for word in sample(RESERVED, role):
        assert "E005" in " ".join(findings(PROGRAM.format(**{**NAMES, role: word}), robot="")), word


def test_any_name_may_follow_a_dot() -> None:
    for word in RESERVED:
        assert findings(PROGRAM.format(**{**NAMES, "member": word}), robot="") == [], word


def test_a_phase_may_be_any_word_but_a_unit_and_any() -> None:
    text = (
        "machine p {{ start {0} {0} -> b when bumper {0} -> b when p == p.{0} {0} -> b when any(infrared)"
        " b -> {0} when true any -> {0} when p == p.{0} }}"
    )
    for word in WORDS:
        found = [f.split()[1] for f in findings(text.format(word))]
        assert found == (["E407"] if word in BASE_UNITS or word == "any" else []), word


def test_a_task_may_be_any_word_but_a_unit() -> None:
    text = (
        "module m {{ when bumper do drive(velocity = 0, turn = 0) }}"
        " sequence q {{ {0} = m until bumper within 1 s else onward"
        " onward = m until bumper within 2 s else {0} }}"
        " network {{ drive = q.{0} suppresses q.drive }}"
    )
    for word in WORDS:
        found = [f.split()[1] for f in findings(text.format(word))]
        assert found == (["E407"] if word in BASE_UNITS or word == "any" else []), word


def test_in_a_type_a_unit_is_the_unit() -> None:
    assert findings("enum m { a = 1 }\nstate s : m = 3 mm") == []


def test_the_grammar_knows_every_word_as_a_name() -> None:
    terminals = {terminal for terminal, _ in CONTEXTUAL} - {"ANY"}
    assert terminals == KEYWORDS
    listed = re.search(r"^\?word: (.*?)\n\n", GRAMMAR.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    assert set(re.findall(r"[A-Z_]+", listed[1])) == {"NAME", *terminals}
