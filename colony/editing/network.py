"""What the network does with each module: its priority, its guard, and what can keep it from driving."""

from __future__ import annotations

from typing import NamedTuple

from colony.compile.backends.table import GuardText
from colony.compile.pipeline import compile_program
from colony.ir.program import Chain, Program, Use, Wiring
from colony.text.wording import quoted

_MAX_NAMED = 12
"""Maximum number of modules that a fact names."""


class NetworkFacts(NamedTuple):
    """By module or actuator, what is known about it; by module, its priority and the number of clients."""

    facts: dict[str, tuple[str, ...]]
    priorities: dict[str, tuple[int, int]]


def network_facts(program: Program) -> NetworkFacts:
    """Return the facts about every module and actuator of a program."""
    clients = compile_program(program).clients
    guards = GuardText(clients.guards)
    facts: dict[str, list[str]] = {}
    priorities: dict[str, tuple[int, int]] = {}
    above = _dominators(program)
    for actuator in clients.actuators:
        count = len(actuator.clients)
        names = [client.module for client in actuator.clients]
        order = " > ".join(names[:_MAX_NAMED]) + (" > ..." if count > _MAX_NAMED else "")
        facts[actuator.actuator] = [f"driven by {order}"] if names else ["nothing drives it"]
        for client in actuator.clients:
            priorities[client.module] = (client.priority, count)
            own = facts.setdefault(client.module, [])
            own.append(f"priority {client.priority} of {count} for {actuator.actuator}")
            own.append(f"guard: `{guards.text(client.guard, client.module)}`")
            guards.take_definitions()
    for module in program.modules:
        own = facts.setdefault(module.name, [])
        if module.failsafe:
            own.append("failsafe: where it lacks a sensor it is active, with the idle command")
        for relation, word in (("suppresses", "suppressed"), ("inhibits", "inhibited")):
            names = [n for n, r in above.get(module.name, {}).items() if r == relation]
            if names:
                more = " and others" if len(names) > _MAX_NAMED else ""
                own.append(f"can be {word} by {quoted(names[:_MAX_NAMED])}{more}")
    return NetworkFacts({name: tuple(texts) for name, texts in facts.items()}, priorities)


def _dominators(program: Program) -> dict[str, dict[str, str]]:
    """Return, by module, the modules and wires that can keep it from its actuator, with their relation."""
    wires = {wire.name: wire for wire in program.wires}
    found: dict[str, dict[str, str]] = {}
    seen = set[tuple[str, tuple[tuple[str, str], ...]]]()
    for root in program.wires:
        if root.actuator is None:
            continue
        work: list[tuple[Wiring, tuple[tuple[str, str], ...]]] = [(root.wiring, ())]
        while work:
            wiring, above = work.pop()
            match wiring:
                case Use(name=name) if name in wires:
                    if (name, above) not in seen:
                        seen.add((name, above))
                        work.append((wires[name].wiring, above))
                case Use(name=name):
                    found.setdefault(name, {}).update(above)
                case Chain(relation=relation, operands=operands):
                    for i, operand in enumerate(operands):
                        before = tuple((_text(o), relation) for o in operands[: min(i, _MAX_NAMED + 1)])
                        if relation == "suppresses" or i == len(operands) - 1:
                            work.append((operand, (*above, *before)[: _MAX_NAMED + 1]))
    return found


def _text(wiring: Wiring) -> str:
    """Return the name of a part; of a chain, the name of its first operand."""
    while isinstance(wiring, Chain):
        wiring = wiring.operands[0]
    return wiring.name
