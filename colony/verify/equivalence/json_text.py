"""A reader of `colony-clients/1`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from colony.compile.backends.json import FORMAT
from colony.compile.guards import (
    ActuatorClients,
    Always,
    And,
    Client,
    ClientList,
    Guard,
    ModuleActive,
    Never,
    Not,
    Or,
    Recently,
)
from colony.ir.version import SEMANTICS


class EmittedFormError(Exception):
    """The error that an emitted form is malformed: it has `found` instead of `expected`."""

    def __init__(self, found: str, expected: str) -> None:
        super().__init__(f"found {found}, expected {expected}")
        self.found = found
        self.expected = expected


def read_json(text: str) -> ClientList:
    """Return the clients in a text.

    Raises:
        EmittedFormError: the text is malformed.
    """
    try:
        document = json.loads(text)
        semantics = document.get("semantics", SEMANTICS)
        if document["format"] != FORMAT:
            raise ValueError(f"the format is not {FORMAT}")
        nodes = tuple(_guard(node, index) for index, node in enumerate(document["nodes"]))
        actuators = tuple(_clients(name, entry, len(nodes)) for name, entry in document["actuators"].items())
        observed = tuple(
            (name, _reference(index, len(nodes))) for name, index in document["observed"].items()
        )
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError) as problem:
        raise EmittedFormError(
            f"{type(problem).__name__}: {problem}", "clients in the format colony-clients/1"
        ) from None
    if semantics != SEMANTICS:
        found = f"clients of version {str(semantics)[:20]} of the semantics"
        raise EmittedFormError(found, f"version {SEMANTICS}: compile them again")
    return ClientList(guards=nodes, actuators=actuators, observed=observed)


def _clients(actuator: str, entry: Mapping[str, Any], nodes: int) -> ActuatorClients:
    clients = tuple(
        Client(
            module=_text(client["module"]),
            priority=_number(client["priority"]),
            guard=_reference(client["guard"], nodes),
            exclusive=_reference(client["exclusive"], nodes),
        )
        for client in _list(entry["clients"])
    )
    return ActuatorClients(actuator=actuator, clients=clients)


def _guard(node: Mapping[str, Any], index: int) -> Guard:
    match node["op"]:
        case "always":
            return Always()
        case "never":
            return Never()
        case "active":
            return ModuleActive(_text(node["module"]))
        case "not":
            return Not(_reference(node["of"], index))
        case "and":
            return And(_references(node["of"], index))
        case "or":
            return Or(_references(node["of"], index))
        case "recently":
            return Recently(_reference(node["of"], index), _number(node["window_ns"]))
        case other:
            raise ValueError(f"unknown node `{other}`")


def _references(value: object, limit: int) -> tuple[int, ...]:
    references = tuple(_reference(index, limit) for index in _list(value))
    if len(references) < 2:
        raise ValueError(f"{value!r} is not a list of two or more nodes")
    return references


def _reference(index: object, limit: int) -> int:
    number = _number(index)
    if number >= limit:
        raise ValueError(f"{number} is not a node before {limit}")
    return number


def _number(value: object) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise ValueError(f"{value!r} is not a non-negative whole number")
    return value


def _list(value: object) -> list[Any]:
    if not isinstance(value, list):
        raise ValueError(f"{value!r} is not a list")
    return value


def _text(value: object) -> str:
    if not isinstance(value, str):
        raise ValueError(f"{value!r} is not a string")
    return value
