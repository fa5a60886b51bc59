from __future__ import annotations

import json

import pytest
from hypothesis import given

from colony.compile.backends.json import to_json
from colony.compile.network import Network
from colony.compile.passes.eliminate_inhibition import eliminate_inhibition
from colony.compile.passes.forward_traversal import forward_traversal
from colony.compile.passes.simplify import simplify
from colony.compile.pipeline import compile_program
from colony.verify.equivalence.json_text import EmittedFormError, read_json
from tests.compile.passes.network_semantics import networks
from tests.networks import random_program
from tests.wiring import program

TEXT = to_json(
    compile_program(
        program("drive = back_off suppresses[50 ms] (docked inhibits cruise)\narm = grip")
    ).clients
)


def test_the_form() -> None:
    assert json.loads(TEXT) == {
        "format": "colony-clients/1",
        "semantics": 4,
        "failsafe": [],
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
    clients = simplify(forward_traversal(eliminate_inhibition(network)))
    assert read_json(to_json(clients)) == clients


def test_there_and_back_before_simplification() -> None:
    clients = compile_program(random_program(50, seed=2)).traversal
    assert read_json(to_json(clients)) == clients


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


@pytest.mark.parametrize(
    "text", ["{", "[" * 100_000, "9" * 10_000, "[]", "{}", changed(["format"], "colony-clients/2")]
)
def test_what_is_no_client_list_is_not_read(text: str) -> None:
    with pytest.raises(EmittedFormError):
        read_json(text)


def test_unknown_members_are_ignored() -> None:
    assert read_json(changed(["comment"], "hello")) == read_json(TEXT)
