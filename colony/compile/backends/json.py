"""Clients as JSON (`colony-clients/1`) for other programs; the runtime itself reads `.colonyc` files.

    {"format": "colony-clients/1", "semantics": 2, "failsafe": ["back_off"],
     "actuators": {"drive": {"clients": [
       {"priority": 2, "module": "back_off", "guard": 0, "exclusive": 0},
       {"priority": 1, "module": "cruise", "guard": 1, "exclusive": 3}]}},
     "observed": {},
     "nodes": [
       {"op": "active", "module": "back_off"},
       {"op": "active", "module": "cruise"},
       {"op": "not", "of": 0},
       {"op": "and", "of": [1, 2]}]}

`format` says how the text is laid out, `semantics` is the version of what the program means
(`colony.ir.version`). The modules in `failsafe` are active, without a command, also where something that they
read is missing. Actuators are in the order in which the robot declares them, clients highest priority
first. Guards are references into `nodes`, and nodes refer only to earlier nodes, so one pass evaluates them
all. A node's `op` is

    always, never    true, false
    active           true while the module `module` puts a command on its output
    not              the negation of the node `of`
    and, or          all, any of the nodes in the list `of`, which has two or more
    recently         true from a frame in which the node `of` is true until, but not including, `window_ns`
                     nanoseconds after the last such frame; its memory is updated in every frame

`observed` gives, by name, the node for the activity of each wire or module that contracts and tests name.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from typing import assert_never

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

FORMAT = "colony-clients/1"


def to_json(clients: ClientList, failsafe_modules: Sequence[str] = ()) -> str:
    """Return a client list as `colony-clients/1`, one client or node per line."""
    failsafe = json.dumps(failsafe_modules)
    actuators = _braced((actuator.actuator, _actuator_json(actuator)) for actuator in clients.actuators)
    observed = json.dumps(dict(clients.observed))
    nodes = ",\n".join(f"    {json.dumps(_node_json(guard))}" for guard in clients.guards)
    return (
        f'{{\n  "format": "{FORMAT}",\n  "semantics": {SEMANTICS},\n  "failsafe": {failsafe},\n'
        f'  "actuators": {actuators},\n'
        f'  "observed": {observed},\n  "nodes": [\n{nodes}\n  ]\n}}\n'
    )


def _braced(members: Iterable[tuple[str, str]]) -> str:
    text = ",\n".join(f"    {json.dumps(name)}: {value}" for name, value in members)
    return f"{{\n{text}\n  }}" if text else "{}"


def _actuator_json(actuator: ActuatorClients) -> str:
    clients = ",\n".join(f"      {json.dumps(_client_json(client))}" for client in actuator.clients)
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
