from __future__ import annotations

import json

import pytest
from hypothesis import given

from colony.compile.backends.json import BadFormat, clients_to_json, from_json, to_json
from colony.compile.network import Network
from colony.compile.pipeline import compile_network, compile_program
from tests.compile.passes.network_semantics import networks
from tests.networks import random_program
from tests.wiring import program

TEXT = to_json(
    compile_program(program("drive = back_off suppresses[50 ms] (docked inhibits cruise)\narm = grip"))
)


def test_the_form() -> None:
    assert json.loads(TEXT) == {
        "format": "colony-clients/1",
        "actuators": {
            "drive": {
                "clients": [
                    {"priority": 2, "module": "back_off", "guard": 0, "exclusive": 0},
                    {"priority": 1, "module": "cruise", "guard": 7, "exclusive": 7},
                ]
            },
            "arm": {"clients": [{"priority": 1, "module": "grip", "guard": 4, "exclusive": 4}]},
        },
        "observed": {},
        "nodes": [
            {"op": "active", "module": "back_off"},
            {"op": "active", "module": "docked"},
            {"op": "active", "module": "cruise"},
            {"op": "recently", "of": 0, "window_ns": 50_000_000},
            {"op": "active", "module": "grip"},
            {"op": "not", "of": 1},
            {"op": "not", "of": 3},
            {"op": "and", "of": [5, 2, 6]},
        ],
    }


@given(network=networks())
def test_there_and_back(network: Network) -> None:
    clients = compile_network(network)
    assert from_json(clients_to_json(clients)) == clients


def test_there_and_back_before_simplification() -> None:
    clients = compile_program(random_program(50, seed=2)).traversal
    assert from_json(clients_to_json(clients)) == clients


def changed(path: list[str | int], value: object) -> str:
    whole = json.loads(TEXT)
    at = whole
    for step in path[:-1]:
        at = at[step]
    if value is None:
        del at[path[-1]]
    else:
        at[path[-1]] = value
    return json.dumps(whole)


CLIENT: list[str | int] = ["actuators", "drive", "clients", 0]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "not JSON"),
        ("[" * 100_000, "not JSON"),
        ("9" * 10_000, "not JSON"),
        ("[]", "expected an object - at `$`"),
        ("{}", "expected a member `format` - at `$`"),
        (changed(["format"], "colony-clients/2"), "expected `colony-clients/1` - at `$.format`"),
        (changed(["nodes"], None), "expected a member `nodes` - at `$`"),
        (changed(["nodes"], {}), "expected a list - at `$.nodes`"),
        (changed(["nodes", 0], {"op": "xor"}), "`xor` is no kind of node - at `$.nodes[0].op`"),
        (
            changed(["nodes", 0], {"op": "not", "of": 0}),
            "expected a node before 0, got 0 - at `$.nodes[0].of`",
        ),
        (changed(["nodes", 2], {"op": "and", "of": [0]}), "two nodes or more - at `$.nodes[2].of`"),
        (changed(["nodes", 2], {"op": "or", "of": [0, True]}), "whole number from 0 - at `$.nodes[2].of[1]`"),
        (changed(["nodes", 1], {"op": "recently", "of": 0}), "a member `window_ns` - at `$.nodes[1]`"),
        (changed(["nodes", 0], {"op": "active", "module": 3}), "expected a string - at `$.nodes[0].module`"),
        (changed([*CLIENT, "priority"], 3), "expected 2, got 3 - at `$.actuators.drive.clients[0].priority`"),
        (changed([*CLIENT, "guard"], 99), "got 99 - at `$.actuators.drive.clients[0].guard`"),
        (changed([*CLIENT, "exclusive"], -1), "at `$.actuators.drive.clients[0].exclusive`"),
        (changed([*CLIENT, "module"], None), "a member `module` - at `$.actuators.drive.clients[0]`"),
    ],
)
def test_what_is_wrong_is_said_with_its_place(text: str, message: str) -> None:
    with pytest.raises(BadFormat) as caught:
        from_json(text)
    assert message in str(caught.value)


def test_unknown_members_are_ignored() -> None:
    assert from_json(changed(["comment"], "hello")) == from_json(TEXT)
