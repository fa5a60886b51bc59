"""Reads `colony-clients/1`, of which `compile/backends/json.py` tells; the compiler itself reads none."""

from __future__ import annotations

import json

from colony.compile.clients import ActuatorClients, Client, ClientList
from colony.compile.guards import Always, And, Guard, ModuleActive, Never, Not, Or, Recently

FORMAT = "colony-clients/1"


class BadFormat(ValueError):
    """The text is no client list; the message says what was expected where, as a path from `$`."""


def read_json(text: str) -> ClientList:
    """Read `colony-clients/1`.

    Members that the format does not have are ignored, so that later versions may add some.

    Raises:
        BadFormat: it is no JSON, another format, or not well formed: a member missing or of the wrong type, a
            reference that is not to a node before (of clients: to a node), priorities that are not n, ..., 1.
    """
    try:
        whole = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise BadFormat(f"not JSON: {error}") from None
    if _string(_member(whole, "format", "$"), "$.format") != FORMAT:
        raise BadFormat(f"expected `{FORMAT}` - at `$.format`")
    nodes = _list(_member(whole, "nodes", "$"), "$.nodes")
    guards = tuple(_read_node(node, at) for at, node in enumerate(nodes))
    actuators = _object(_member(whole, "actuators", "$"), "$.actuators")
    observed = _object(_member(whole, "observed", "$"), "$.observed")
    return ClientList(
        guards=guards,
        actuators=tuple(_read_actuator(name, one, len(guards)) for name, one in actuators.items()),
        observed=tuple(
            (name, _integer(ref, f"$.observed.{name}", len(guards))) for name, ref in observed.items()
        ),
    )


def _read_actuator(name: str, value: object, guards: int) -> ActuatorClients:
    path = f"$.actuators.{name}"
    rows = _list(_member(value, "clients", path), f"{path}.clients")
    clients = []
    for at, row in enumerate(rows):
        here = f"{path}.clients[{at}]"
        priority = _integer(_member(row, "priority", here), f"{here}.priority")
        if priority != len(rows) - at:
            raise BadFormat(f"expected {len(rows) - at}, got {priority} - at `{here}.priority`")
        client = Client(
            module=_string(_member(row, "module", here), f"{here}.module"),
            priority=priority,
            guard=_integer(_member(row, "guard", here), f"{here}.guard", guards),
            exclusive=_integer(_member(row, "exclusive", here), f"{here}.exclusive", guards),
        )
        clients.append(client)
    return ActuatorClients(actuator=name, clients=tuple(clients))


def _read_node(value: object, at: int) -> Guard:
    path = f"$.nodes[{at}]"
    op = _string(_member(value, "op", path), f"{path}.op")
    match op:
        case "always":
            return Always()
        case "never":
            return Never()
        case "active":
            return ModuleActive(_string(_member(value, "module", path), f"{path}.module"))
        case "not":
            return Not(_integer(_member(value, "of", path), f"{path}.of", at))
        case "and" | "or":
            several = _list(_member(value, "of", path), f"{path}.of")
            if len(several) < 2:
                raise BadFormat(f"expected two nodes or more - at `{path}.of`")
            parts = tuple(_integer(part, f"{path}.of[{i}]", at) for i, part in enumerate(several))
            return And(parts) if op == "and" else Or(parts)
        case "recently":
            operand = _integer(_member(value, "of", path), f"{path}.of", at)
            return Recently(operand, _integer(_member(value, "window_ns", path), f"{path}.window_ns"))
        case _:
            raise BadFormat(f"`{op}` is no kind of node - at `{path}.op`")


# --- JSON values of a type, or BadFormat -----------------------------------------------------------


def _member(value: object, name: str, path: str) -> object:
    members = _object(value, path)
    if name not in members:
        raise BadFormat(f"expected a member `{name}` - at `{path}`")
    return members[name]


def _object(value: object, path: str) -> dict[str, object]:
    if not isinstance(value, dict):
        raise BadFormat(f"expected an object - at `{path}`")
    return value


def _list(value: object, path: str) -> list[object]:
    if not isinstance(value, list):
        raise BadFormat(f"expected a list - at `{path}`")
    return value


def _string(value: object, path: str) -> str:
    if not isinstance(value, str):
        raise BadFormat(f"expected a string - at `{path}`")
    return value


def _integer(value: object, path: str, below: int | None = None) -> int:
    """A whole number from 0 (bools are none); with `below`, the reference of one of so many nodes."""
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise BadFormat(f"expected a whole number from 0 - at `{path}`")
    if below is not None and value >= below:
        raise BadFormat(f"expected a node before {below}, got {value} - at `{path}`")
    return value
