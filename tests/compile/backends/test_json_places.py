"""Whatever is wrong with a client list in JSON, and wherever: the message says the place."""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator
from typing import Any

import pytest

from colony.compile.backends.json import BadFormat, from_json

WHOLE: dict[str, Any] = {
    "format": "colony-clients/1",
    "actuators": {
        "drive": {
            "clients": [
                {"priority": 3, "module": "a", "guard": 0, "exclusive": 0},
                {"priority": 2, "module": "b", "guard": 3, "exclusive": 4},
                {"priority": 1, "module": "c", "guard": 5, "exclusive": 6},
            ]
        },
        "arm": {"clients": []},
    },
    "observed": {"wire": 2, "a": 0},
    "nodes": [
        {"op": "active", "module": "a"},
        {"op": "always"},
        {"op": "never"},
        {"op": "not", "of": 0},
        {"op": "and", "of": [3, 1]},
        {"op": "or", "of": [0, 2, 4]},
        {"op": "recently", "of": 5, "window_ns": 7},
    ],
}
REFERENCES = ("guard", "exclusive", "of", "wire", "a")
KINDS = {dict: "an object", list: "a list", str: "a string", int: "a whole number from 0"}

Path = tuple[str | int, ...]


def places(value: object, path: Path = ()) -> Iterator[tuple[Path, object]]:
    """Every value in the document, with the way to it."""
    yield path, value
    if isinstance(value, dict | list):
        for key in value if isinstance(value, dict) else range(len(value)):
            yield from places(value[key], (*path, key))


def shown(path: Path) -> str:
    return "$" + "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in path)


def changed(path: Path, *value: object) -> str:
    """The document with another value at a place, or with none."""
    if not path:
        return json.dumps(value[0])
    whole = copy.deepcopy(WHOLE)
    at: Any = whole
    for step in path[:-1]:
        at = at[step]
    if value:
        at[path[-1]] = value[0]
    else:
        del at[path[-1]]
    return json.dumps(whole)


def problem(text: str) -> str:
    with pytest.raises(BadFormat) as caught:
        from_json(text)
    return str(caught.value)


PLACES = list(places(WHOLE))


@pytest.mark.parametrize(("path", "value"), PLACES, ids=[shown(path) for path, _ in PLACES])
def test_a_value_of_another_kind(path: Path, value: object) -> None:
    for other in (None, 1.5, True, -1, [], {}, "x"):
        if type(other) is not type(value) or other == -1:
            assert problem(changed(path, other)) == f"expected {KINDS[type(value)]} - at `{shown(path)}`"


OPTIONAL = {("actuators",), ("observed",)}
MEMBERS = [path for path, _ in PLACES if path and isinstance(path[-1], str) and path[:-1] not in OPTIONAL]


@pytest.mark.parametrize("path", MEMBERS, ids=shown)
def test_a_member_that_is_missing(path: Path) -> None:
    assert problem(changed(path)) == f"expected a member `{path[-1]}` - at `{shown(path[:-1])}`"


def _reference(path: Path) -> bool:
    name = next(step for step in reversed(path) if isinstance(step, str))
    return (name in REFERENCES and path[-1] != "a") or path == ("observed", "a")


POINTING = [path for path, value in PLACES if isinstance(value, int) and _reference(path)]


@pytest.mark.parametrize("path", POINTING, ids=shown)
def test_a_reference_to_a_node_that_is_not_before(path: Path) -> None:
    """Of a node only nodes before it may be referred to, of a client and of what is observed all."""
    end = int(path[1]) if path[0] == "nodes" else len(WHOLE["nodes"])
    assert problem(changed(path, end)) == f"expected a node before {end}, got {end} - at `{shown(path)}`"
    from_json(changed(path, end - 1))


@pytest.mark.parametrize("at", [0, 1, 2])
def test_a_priority_out_of_turn(at: int) -> None:
    path: Path = ("actuators", "drive", "clients", at, "priority")
    for wrong in (0, 3 - at + 1, 99):
        assert problem(changed(path, wrong)) == f"expected {3 - at}, got {wrong} - at `{shown(path)}`"


def test_a_list_of_one_node_and_a_kind_that_there_is_not() -> None:
    for at in (4, 5):
        found = problem(changed(("nodes", at, "of"), [0]))
        assert found == f"expected two nodes or more - at `$.nodes[{at}].of`"
    assert problem(changed(("nodes", 1, "op"), "xor")) == "`xor` is no kind of node - at `$.nodes[1].op`"


def test_the_document_is_read() -> None:
    clients = from_json(json.dumps(WHOLE))
    assert [len(one.clients) for one in clients.actuators] == [3, 0]
    assert clients.observed == (("wire", 2), ("a", 0))
