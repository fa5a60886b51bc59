"""What each pass gives, as text for people: a node or a client a line; guards are read back from text."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from typing import assert_never

from colony.compile.backends.table import GuardText
from colony.compile.guards import (
    Always,
    And,
    ClientList,
    Guard,
    GuardTable,
    ModuleActive,
    Never,
    Not,
    Or,
    Recently,
)
from colony.compile.network import Inhibitor, ModuleLeaf, Network, NodeUse, SuppressionNetwork, Suppressor
from colony.text.wording import duration_text

MS = 1_000_000


def of_network(network: Network) -> str:
    """Return a node a line, then what it drives, names and shows."""
    return "\n".join(
        [f"{at} {_node(node)}" for at, node in enumerate(network.nodes)]
        + [f"drives {name}: {node}" for name, node in network.outputs]
        + [f"wire {name}: {node}" for name, node in network.wires]
        + [f"observed {name}: {node}" for name, node in network.observed]
    )


def _node(node: ModuleLeaf | Suppressor | Inhibitor) -> str:
    match node:
        case ModuleLeaf(module=module):
            return module
        case Suppressor() | Inhibitor():
            relation = "suppresses" if isinstance(node, Suppressor) else "inhibits"
            window = f"[{duration_text(node.window_ns)}]" if node.window_ns else ""
            return f"{node.dominant} {relation}{window} {node.inferior}"
        case _:
            assert_never(node)


def of_suppression(network: SuppressionNetwork) -> str:
    """Return a suppressor a line, with the gates of its inputs and when they are active."""
    guards = GuardText(network.guards)

    def link(one: NodeUse) -> str:
        gate = f" if {gate}" if (gate := guards.text(one.gate)) != "always" else ""
        return f"{one.node}{gate} (active: {guards.text(one.active)})"

    lines = [
        f"{at} {node.module}"
        if isinstance(node, ModuleLeaf)
        else f"{at} {link(node.dominant)} suppresses {link(node.inferior)}"
        for at, node in enumerate(network.nodes)
    ]
    lines += [f"drives {name}: {link(root)}" for name, root in network.outputs]
    for kind, named in (("wire", network.wires), ("observed", network.observed)):
        lines += [f"{kind} {name}: {guards.text(ref)}" for name, ref in named]
    return "\n".join(lines)


def clients_view(clients: ClientList) -> str:
    """Return a client a line, with its guard, and with the exclusive one where that is another."""
    guards = GuardText(clients.guards)

    def lines() -> Iterator[str]:
        for one in clients.actuators:
            yield f"{one.actuator}:"
            for client in one.clients:
                guard = guards.text(client.guard, client.module)
                exclusive = guards.text(client.exclusive, client.module)
                other = "" if client.guard == client.exclusive else f"; exclusively {exclusive}"
                yield f"  {client.priority} {client.module}: {guard}{other}"
        yield from (f"{name} = {text}" for name, text in guards.take_definitions())

    return "\n".join(lines())


def guards(text: str, *modules: str) -> tuple[Guard, ...]:
    """Return a table of guards, of these modules first and of the text last.

    The text is written as in Python, with `always`, `never` and `recently(GUARD, MILLISECONDS)`; parts that
    several share are defined before, as `NAME = GUARD;`.
    """
    table, known = GuardTable([ModuleActive(module) for module in modules]), dict[str, int]()
    *shared, last = (ast.parse(part.strip()).body[0] for part in text.split(";"))

    def add(node: ast.expr) -> int:
        match node:
            case ast.Name(id="always"):
                return table.add(Always())
            case ast.Name(id="never"):
                return table.add(Never())
            case ast.Name(id=name):
                return known[name] if name in known else table.add(ModuleActive(name))
            case ast.UnaryOp(operand=operand):
                return table.add(Not(add(operand)))
            case ast.BoolOp(op=op, values=several):
                return table.add((And if isinstance(op, ast.And) else Or)(tuple(map(add, several))))
            case ast.Call(args=[operand, ast.Constant(value=int() | float() as milliseconds)]):
                return table.add(Recently(add(operand), round(milliseconds * MS)))
        raise ValueError(ast.dump(node))

    for definition in shared:
        assert isinstance(definition, ast.Assign)
        known[ast.unparse(definition.targets[0])] = add(definition.value)
    assert isinstance(last, ast.Expr)
    root = add(last.value)
    return tuple(table.nodes[: root + 1])
