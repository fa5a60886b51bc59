"""Reads `colony-clients/1`, apart from the compiler's own reader."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from colony.compile.clients import ActuatorClients, Client, ClientList
from colony.compile.guards import Always, And, Guard, ModuleActive, Never, Not, Or, Recently


class Unreadable(Exception):
    """An emitted form is not what it should look like: `found`, and what was `expected`."""

    def __init__(self, found: str, expected: str) -> None:
        super().__init__(f"found {found}, expected {expected}")
        self.found = found
        self.expected = expected


def read_json(text: str) -> ClientList:
    """The clients that a text describes.

    Raises:
        Unreadable: it describes none.
    """
    try:
        whole = json.loads(text)
        nodes = tuple(_guard(node, at) for at, node in enumerate(whole["nodes"]))
        actuators = tuple(_clients(name, one, len(nodes)) for name, one in whole["actuators"].items())
        observed = tuple((name, _reference(at, len(nodes))) for name, at in whole["observed"].items())
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError) as problem:
        raise Unreadable(
            f"{type(problem).__name__}: {problem}", "clients in the form colony-clients/1"
        ) from None
    return ClientList(guards=nodes, actuators=actuators, observed=observed)


def _clients(actuator: str, one: Mapping[str, Any], nodes: int) -> ActuatorClients:
    clients = tuple(
        Client(
            module=str(client["module"]),
            priority=client["priority"],
            guard=_reference(client["guard"], nodes),
            exclusive=_reference(client["exclusive"], nodes),
        )
        for client in one["clients"]
    )
    return ActuatorClients(actuator=actuator, clients=clients)


def _guard(node: Mapping[str, Any], at: int) -> Guard:
    match node["op"]:
        case "always":
            return Always()
        case "never":
            return Never()
        case "active":
            return ModuleActive(str(node["module"]))
        case "not":
            return Not(_reference(node["of"], at))
        case "and":
            return And(tuple(_reference(of, at) for of in node["of"]))
        case "or":
            return Or(tuple(_reference(of, at) for of in node["of"]))
        case "recently":
            return Recently(_reference(node["of"], at), int(node["window_ns"]))
        case other:
            raise ValueError(f"no node is `{other}`")


def _reference(at: object, below: int) -> int:
    if isinstance(at, bool) or not isinstance(at, int) or not 0 <= at < below:
        raise ValueError(f"{at!r} is no node before {below}")
    return at
