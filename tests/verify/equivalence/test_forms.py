"""What is emitted from the clients: that it is proved, and that changes to it are found."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest

from colony.compile.backends.json import to_json
from colony.compile.backends.python.generate import generate
from colony.compile.pipeline import Compilation, compile_program
from colony.dsl.load import load_file
from colony.execute.code import Apply, Code, Literal
from colony.execute.operators import Operator
from colony.verify.equivalence.prove import prove, prove_json, prove_python
from colony.verify.equivalence.results import EquivalenceProved, Result, WrongForm, WrongWinner
from tests.drawn.strategies import run_of_seed
from tests.paths import BEHAVIORS
from tests.sampling import sampled


@cache
def compilation(name: str) -> Compilation:
    [path] = [path for path in BEHAVIORS if path.stem == name]
    return compile_program(load_file(path))


def emitted(of: Compilation) -> Result:
    text = generate(of.compiled)
    return prove(of.program, of, json=to_json(of.clients), sent=lambda: of.compiled, python=text)


@pytest.mark.parametrize("path", sampled(BEHAVIORS, every=4), ids=lambda path: path.stem)
def test_all_forms_of_shipped_behaviors_are_proved(path: Path) -> None:
    result = emitted(compilation(path.stem))
    assert isinstance(result, EquivalenceProved)
    assert result.forms == ("clients", "JSON", "lowered code", "generated Python")


@pytest.mark.parametrize("seed", sampled(range(60), every=3, thorough=True))
@pytest.mark.parametrize("network", [True, False], ids=["network", "whole"])
def test_all_forms_of_drawn_programs_are_proved(seed: int, network: bool) -> None:
    program, _ = run_of_seed(seed, network=network)
    assert isinstance(emitted(compile_program(program)), EquivalenceProved), seed


# --- generated Python --------------------------------------------------------------------------------


def changed_text(change: Callable[[str], str]) -> Result:
    of = compilation("allen")
    text = generate(of.compiled)
    changed = change(text)
    assert changed != text
    return prove_python(of.program, of.clients, changed)


def replaced(what: str, instead: str) -> Result:
    """Replace text in which values of the network that have only numbers for names stand in braces."""

    def change(text: str) -> str:
        names = dict[str, str]()
        for name, value in NUMBERED.items():
            [names[name]] = re.findall(rf"(v\d+) = {re.escape(value.format(**names))}", text)
        return text.replace(what.format(**names), instead.format(**names))

    return changed_text(change)


NUMBERED = {
    "free": "not (collide_active or ",
    "sensing_free": "{free} and sensing",
    "not_travel": "not (travel_active or ",
    "lowest": "{not_travel} and {sensing_free}",
}
"""How values of the network begin that generated Python has no names for."""


@pytest.mark.parametrize(
    ("what", "instead"),
    [
        (" and {lowest}:  # runaway", ":  # runaway"),
        ("if travel_active and {sensing_free}:", "if {sensing_free}:"),
        ("if collide_active and sensing:", "if sensing and not collide_active:"),
        ("t < self.guard_10_until", "t <= self.guard_10_until"),
        ("self.guard_10_until = t + 300_000_000", "self.guard_10_until = t + 300_000_001"),
        (
            "if travel_active:\n            self.guard_10",
            "if travel_active and {sensing_free}:\n            self.guard_10",
        ),
        ("self.guard_10_until = 0", "self.guard_10_until = 1"),
        ("drive_by = 'travel'", "drive_by = 'wander'"),
        ("{sensing_free} = {free} and sensing", "{sensing_free} = {free} or sensing"),
        ("{sensing_free} = {free} and sensing", "{sensing_free} = {free}"),
    ],
)
def test_a_change_in_generated_python_is_found(what: str, instead: str) -> None:
    found = replaced(what, instead)
    assert isinstance(found, WrongWinner)
    assert found.form == "generated Python"
    assert found.network != found.by_priority


def test_a_change_that_changes_no_winner_is_proved() -> None:
    """Who comes after `travel` is only asked where `travel` is not active, or inhibited like themselves."""
    what, instead = "{not_travel} = not (travel_active or", "{not_travel} = not (collide_active or"
    assert isinstance(replaced(what, instead), EquivalenceProved)


def test_clients_in_another_order_are_found() -> None:
    def reordered(text: str) -> str:
        clients = re.compile(r"( {12}if .*?  # (?:collide|travel), .*?break\n)", re.DOTALL)
        first, second = clients.findall(text)[:2]
        return text.replace(first, "").replace(second, second + first)

    assert isinstance(changed_text(reordered), WrongWinner)


@pytest.mark.parametrize(
    ("what", "instead", "found"),
    [
        ("class Program:", "class Programme:", "no class `Program`"),
        (
            "                drive_turn = 0.0\n                break",
            "                drive_turn = 0.0",
            "collide",
        ),
        ("drive_by = 'travel'", "drive_by = str('travel')", "drive_by = str('travel')"),
        ("        return (drive, report)", "        yield (drive, report)", "Expr"),
        ("while True:", "while records:", "While"),
        ("def step", "def step(", "SyntaxError"),
    ],
)
def test_python_of_another_shape_is_refused(what: str, instead: str, found: str) -> None:
    result = changed_text(lambda text: text.replace(what, instead))
    assert isinstance(result, WrongForm)
    assert found in result.found


# --- JSON ----------------------------------------------------------------------------------------


def changed_json(change: Callable[[dict[str, list[dict[str, object]]]], None]) -> Result:
    of = compilation("allen")
    document = json.loads(to_json(of.clients))
    change(document)
    emitted_text = json.dumps(document)
    assert not isinstance(prove(of.program, of, json=emitted_text), EquivalenceProved)
    return prove_json(of.program, emitted_text)


def a_node(document: dict[str, list[dict[str, object]]], op: str) -> dict[str, object]:
    return next(node for node in document["nodes"] if node["op"] == op)


def test_json_of_its_own_is_held_against_the_network() -> None:
    of = compilation("allen")
    assert isinstance(prove_json(of.program, to_json(of.clients)), EquivalenceProved)
    unsimplified = to_json(of.traversal)
    assert unsimplified != to_json(of.clients)
    assert isinstance(prove_json(of.program, unsimplified), EquivalenceProved), (
        "other guards, but the same winners"
    )


def without_the_lowest(document: dict[str, object]) -> None:
    clients = document["actuators"]["drive"]["clients"]  # type: ignore[index]
    clients.pop()
    for client in clients:
        client["priority"] -= 1


@pytest.mark.parametrize(
    "change",
    [
        lambda d: a_node(d, "and").update(op="or"),
        lambda d: a_node(d, "recently").update(window_ns=1),
        without_the_lowest,
    ],
    ids=["a condition", "a time constant", "a client"],
)
def test_a_change_in_json_is_found(change: Callable[[dict[str, list[dict[str, object]]]], None]) -> None:
    assert isinstance(changed_json(change), WrongWinner)


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"nodes": [{"op": "not", "of": 0}]}', '{"nodes": 3}'])
def test_what_is_no_client_list_is_refused(text: str) -> None:
    assert isinstance(prove_json(compilation("allen").program, text), WrongForm)


# --- lowered code --------------------------------------------------------------------------------


def changed_code(change: Callable[[Code], Code]) -> Result:
    of = compilation("allen")
    return prove(of.program, of, sent=lambda: replace(of.compiled, code=change(of.compiled.code)))


def with_clients(change: Callable[[int, int], tuple[int, int]]) -> Callable[[Code], Code]:
    """`change` guard and exclusive guard of every client."""

    def over(code: Code) -> Code:
        actuators = []
        for actuator in code.actuators:
            clients = []
            for client in actuator.clients:
                guard, exclusive = change(client.guard, client.exclusive)
                clients.append(replace(client, guard=guard, exclusive=exclusive))
            actuators.append(replace(actuator, clients=tuple(clients)))
        return replace(code, actuators=tuple(actuators))

    return over


def test_lowered_guards_of_other_clients_are_found() -> None:
    found = changed_code(with_clients(lambda guard, exclusive: (guard - 1, exclusive)))
    assert isinstance(found, WrongWinner)
    assert found.form == "lowered code"


def test_a_window_of_lowered_code_is_found() -> None:
    def longer(code: Code) -> Code:
        ops = [Literal(op.value + 1) if op == Literal(600_000_000) else op for op in code.ops]
        return replace(code, ops=tuple(ops))

    assert isinstance(changed_code(longer), WrongWinner)


def test_an_operator_of_lowered_code_is_found() -> None:
    def other(code: Code) -> Code:
        guards = {client.guard for actuator in code.actuators for client in actuator.clients}
        ops = [
            Apply(Operator.OR, op.arguments)
            if at in guards and isinstance(op, Apply) and op.operator is Operator.AND
            else op
            for at, op in enumerate(code.ops)
        ]
        return replace(code, ops=tuple(ops))

    assert isinstance(changed_code(other), WrongWinner)


def test_memory_of_lowered_code_that_moves_otherwise_is_found() -> None:
    def frozen(code: Code) -> Code:
        cells = [
            replace(c, condition=code.actuators[0].clients[0].guard) if c.name.startswith("guard") else c
            for c in code.cells
        ]
        return replace(code, cells=tuple(cells))

    assert isinstance(changed_code(frozen), WrongWinner)
