"""Clients as JSON, `colony-clients/1`: what other programs read, and what a runtime may load.

    {"format": "colony-clients/1",
     "actuators": {"drive": {"clients": [
       {"priority": 2, "module": "back_off", "guard": 0, "exclusive": 0},
       {"priority": 1, "module": "cruise", "guard": 1, "exclusive": 3}]}},
     "observed": {},
     "nodes": [
       {"op": "active", "module": "back_off"},
       {"op": "active", "module": "cruise"},
       {"op": "not", "of": 0},
       {"op": "and", "of": [1, 2]}]}

Actuators are in the order in which the robot declares them, clients highest priority first. Guards are
references into `nodes`, and nodes refer to nodes before them: one pass from the front evaluates all. A node's
`op` is

    always, never    true, false
    active           the module `module` puts a command on its output
    not              not the node `of`
    and, or          all, any of the nodes in the list `of`, two or more
    recently         true from a frame in which the node `of` is, until, and not including, `window_ns`
                     nanoseconds after the last one; it has memory, which moves on in every frame

`observed` gives, by name, when the wires and modules are active that contracts and examples ask for.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import assert_never

from colony.compile.clients import ActuatorClients, Client, ClientList
from colony.compile.guards import Always, And, Guard, ModuleActive, Never, Not, Or, Recently
from colony.compile.pipeline import Compiled

FORMAT = "colony-clients/1"


class BadFormat(ValueError):
    """The text is no client list; the message says what was expected where, as a path from `$`."""


def to_json(compiled: Compiled) -> str:
    """The clients of a compiled program, one client and one node a line."""
    return clients_to_json(compiled.clients)


def clients_to_json(clients: ClientList) -> str:
    """A client list as `colony-clients/1`; `from_json` gives an equal one back."""
    actuators = _braced((one.actuator, _actuator_json(one)) for one in clients.actuators)
    observed = json.dumps(dict(clients.observed))
    nodes = ",\n".join(f"    {json.dumps(_node_json(guard))}" for guard in clients.guards)
    return (
        f'{{\n  "format": "{FORMAT}",\n  "actuators": {actuators},\n'
        f'  "observed": {observed},\n  "nodes": [\n{nodes}\n  ]\n}}\n'
    )


def _braced(members: Iterable[tuple[str, str]]) -> str:
    text = ",\n".join(f"    {json.dumps(name)}: {value}" for name, value in members)
    return f"{{\n{text}\n  }}" if text else "{}"


def _actuator_json(one: ActuatorClients) -> str:
    clients = ",\n".join(f"      {json.dumps(_client_json(client))}" for client in one.clients)
    return f'{{"clients": [\n{clients}\n    ]}}'


def _client_json(client: Client) -> dict[str, object]:
    return {
        "priority": client.priority,
        "module": client.module,
        "guard": client.guard,
        "exclusive": client.exclusive,
    }


def _node_json(guard: Guard) -> dict[str, object]:
    match guard:
        case Always():
            return {"op": "always"}
        case Never():
            return {"op": "never"}
        case ModuleActive(module=module):
            return {"op": "active", "module": module}
        case Not(operand=operand):
            return {"op": "not", "of": operand}
        case And(operands=parts):
            return {"op": "and", "of": parts}
        case Or(operands=parts):
            return {"op": "or", "of": parts}
        case Recently(operand=operand, window_ns=window_ns):
            return {"op": "recently", "of": operand, "window_ns": window_ns}
        case _:
            assert_never(guard)


def from_json(text: str) -> ClientList:
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
