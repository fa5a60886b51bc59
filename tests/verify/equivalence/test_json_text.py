"""Whatever is wrong with a client list in JSON, and wherever: it is not read."""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator
from typing import Any

import pytest

from colony.verify.equivalence.json_text import EmittedFormError, read_json

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
    with pytest.raises(EmittedFormError) as caught:
        read_json(text)
    return caught.value.found


PLACES = list(places(WHOLE))


@pytest.mark.parametrize(("path", "value"), PLACES, ids=[shown(path) for path, _ in PLACES])
def test_a_value_of_another_kind(path: Path, value: object) -> None:
    for other in (None, 1.5, True, -1, [], {}, "x"):
        if type(other) is not type(value) or other == -1:
            assert problem(changed(path, other))


OPTIONAL = {("actuators",), ("observed",)}
MEMBERS = [path for path, _ in PLACES if path and isinstance(path[-1], str) and path[:-1] not in OPTIONAL]


@pytest.mark.parametrize("path", MEMBERS, ids=shown)
def test_a_member_that_is_missing(path: Path) -> None:
    assert problem(changed(path)) == f"KeyError: '{path[-1]}'"


def _reference(path: Path) -> bool:
    name = next(step for step in reversed(path) if isinstance(step, str))
    return (name in REFERENCES and path[-1] != "a") or path == ("observed", "a")


POINTING = [path for path, value in PLACES if isinstance(value, int) and _reference(path)]


@pytest.mark.parametrize("path", POINTING, ids=shown)
def test_a_reference_to_a_node_that_is_not_before(path: Path) -> None:
    """Of a node only nodes before it may be referred to, of a client and of what is observed all."""
    end = int(path[1]) if path[0] == "nodes" else len(WHOLE["nodes"])
    assert problem(changed(path, end)) == f"ValueError: {end} is not a node before {end}"
    read_json(changed(path, end - 1))


def test_a_list_of_one_node_and_a_kind_that_there_is_not() -> None:
    for at in (4, 5):
        assert (
            problem(changed(("nodes", at, "of"), [0])) == "ValueError: [0] is not a list of two or more nodes"
        )
    assert problem(changed(("nodes", 1, "op"), "xor")) == "ValueError: unknown node `xor`"


def test_the_document_is_read() -> None:
    clients = read_json(json.dumps(WHOLE))
    assert [len(one.clients) for one in clients.actuators] == [3, 0]
    assert clients.observed == (("wire", 2), ("a", 0))
