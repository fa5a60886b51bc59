"""Reader of the form `colony-clients/1`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from colony.compile.backends.json import FORMAT
from colony.compile.clients import ActuatorClients, Client, ClientList
from colony.compile.guards import Always, And, Guard, ModuleActive, Never, Not, Or, Recently


class EmittedFormError(Exception):
    """A malformed emitted form: what was `found`, and what was `expected`."""

    def __init__(self, found: str, expected: str) -> None:
        super().__init__(f"found {found}, expected {expected}")
        self.found = found
        self.expected = expected


def read_json(text: str) -> ClientList:
    """Return the clients that a text describes.

    Raises:
        EmittedFormError: the text is malformed.
    """
    try:
        whole = json.loads(text)
        if whole["format"] != FORMAT:
            raise ValueError(f"another format than {FORMAT}")
        nodes = tuple(_guard(node, at) for at, node in enumerate(whole["nodes"]))
        actuators = tuple(_clients(name, one, len(nodes)) for name, one in whole["actuators"].items())
        observed = tuple((name, _reference(at, len(nodes))) for name, at in whole["observed"].items())
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError) as problem:
        raise EmittedFormError(
            f"{type(problem).__name__}: {problem}", "clients in the form colony-clients/1"
        ) from None
    return ClientList(guards=nodes, actuators=actuators, observed=observed)


def _clients(actuator: str, one: Mapping[str, Any], nodes: int) -> ActuatorClients:
    clients = tuple(
        Client(
            module=_text(client["module"]),
            priority=_number(client["priority"]),
            guard=_reference(client["guard"], nodes),
            exclusive=_reference(client["exclusive"], nodes),
        )
        for client in _list(one["clients"])
    )
    return ActuatorClients(actuator=actuator, clients=clients)


def _guard(node: Mapping[str, Any], at: int) -> Guard:
    match node["op"]:
        case "always":
            return Always()
        case "never":
            return Never()
        case "active":
            return ModuleActive(_text(node["module"]))
        case "not":
            return Not(_reference(node["of"], at))
        case "and":
            return And(_references(node["of"], at))
        case "or":
            return Or(_references(node["of"], at))
        case "recently":
            return Recently(_reference(node["of"], at), _number(node["window_ns"]))
        case other:
            raise ValueError(f"no node is `{other}`")


def _references(several: object, below: int) -> tuple[int, ...]:
    references = tuple(_reference(at, below) for at in _list(several))
    if len(references) < 2:
        raise ValueError(f"{several!r} are not two nodes or more")
    return references


def _reference(at: object, below: int) -> int:
    number = _number(at)
    if number >= below:
        raise ValueError(f"{number} is no node before {below}")
    return number


def _number(value: object) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise ValueError(f"{value!r} is no whole number from 0")
    return value


def _list(value: object) -> list[Any]:
    if not isinstance(value, list):
        raise ValueError(f"{value!r} is no list")
    return value


def _text(value: object) -> str:
    if not isinstance(value, str):
        raise ValueError(f"{value!r} is no text")
    return value
