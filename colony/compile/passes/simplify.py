"""Simplification of guards: sound, local and near-linear. The rules are in `inverter_graph`."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from dataclasses import replace
from typing import assert_never

from colony.compile.clients import ActuatorClients, ClientList
from colony.compile.guards import (
    Always,
    And,
    Guard,
    ModuleActive,
    Never,
    Not,
    Or,
    Recently,
    operands,
)
from colony.compile.passes.inverter_graph import FALSE, TRUE, InverterGraph, rewrite, size_in_use, zeros

WORTHWHILE = 0.01
"""Minimum relative reduction in size by a round of rewriting for another round to follow."""


def simplify(clients: ClientList) -> ClientList:
    """Return the same clients with simpler guards, in a table without unused nodes.

    Each guard holds in the same frames as before, whichever modules are active. Clients whose guard is never
    true stay in the list: their priorities are part of the compiled form, and lints report them.
    """
    references = _references(clients)
    graph, literals = rewrite(*_load(clients.guards, references))
    size, saved = size_in_use(graph, literals), 1.0
    while saved > WORTHWHILE:
        simpler, simpler_literals = rewrite(graph, literals)
        simpler_size = size_in_use(simpler, simpler_literals)
        saved = 1 - simpler_size / size
        if saved > 0:
            graph, literals, size = simpler, simpler_literals, simpler_size
    guards, new_references = _unload(graph, literals)
    return _renumbered(clients, guards, dict(zip(references, new_references, strict=True)))


def _references(clients: ClientList) -> list[int]:
    """Return the references of a client list into its table, each once."""
    unique = dict.fromkeys(
        ref for actuator in clients.actuators for c in actuator.clients for ref in (c.guard, c.exclusive)
    )
    unique |= dict.fromkeys(ref for _, ref in clients.observed)
    return list(unique)


def _renumbered(clients: ClientList, guards: tuple[Guard, ...], new: dict[int, int]) -> ClientList:
    """Return the client list over another table; `new` maps old references to new ones."""
    actuators = []
    for actuator in clients.actuators:
        new_references = [
            replace(c, guard=new[c.guard], exclusive=new[c.exclusive]) for c in actuator.clients
        ]
        actuators.append(ActuatorClients(actuator=actuator.actuator, clients=tuple(new_references)))
    observed = tuple((name, new[ref]) for name, ref in clients.observed)
    return ClientList(guards=guards, actuators=tuple(actuators), observed=observed)


def _load(guards: Sequence[Guard], references: Sequence[int]) -> tuple[InverterGraph, list[int]]:
    """Return the graph of all guards that the references need, and their literals."""
    used = bytearray(len(guards))
    for ref in references:
        used[ref] = 1
    for index in range(len(guards) - 1, -1, -1):
        if used[index]:
            for operand in operands(guards[index]):
                used[operand] = 1
    graph = InverterGraph()
    literals = zeros(len(guards))
    for index, guard in enumerate(guards):
        if used[index]:
            literals[index] = _literal(guard, graph, literals)
    return graph, [literals[ref] for ref in references]


def _literal(guard: Guard, graph: InverterGraph, literals: Sequence[int]) -> int:
    match guard:
        case And(operands=parts):
            return graph.raw_conjunction(tuple([literals[part] for part in parts]))
        case Or(operands=parts):
            return graph.raw_conjunction(tuple([literals[part] ^ 1 for part in parts])) ^ 1
        case Not(operand=operand):
            return literals[operand] ^ 1
        case ModuleActive(module=module):
            return graph.module(module)
        case Recently(operand=operand, window_ns=window_ns):
            return graph.recently_literal(literals[operand], window_ns)
        case Always():
            return TRUE
        case Never():
            return FALSE
        case _:
            assert_never(guard)


def _unload(graph: InverterGraph, literals: Sequence[int]) -> tuple[tuple[Guard, ...], list[int]]:
    """Return a table of guards for the graph, and references in place of the literals.

    A conjunction becomes an `And`, or the `Or` of the negated parts, whichever saves more negations.
    """
    flips = _negated_conjunctions(graph, literals)
    guards: list[Guard] = []
    references = zeros(2 * len(flips))  # by literal: one more than its index in the table

    def add(literal: int, guard: Guard) -> int:
        guards.append(guard)
        references[literal] = len(guards)
        return len(guards) - 1

    def reference(literal: int) -> int:
        index = references[literal] - 1
        if index >= 0:
            return index
        if literal <= FALSE:
            return add(literal, Always() if literal == TRUE else Never())
        return add(literal, Not(references[literal ^ 1] - 1))

    for node, (parts, flip) in enumerate(zip(graph.parts, flips, strict=True)):
        if flip < 0 or not node:
            continue
        if parts:
            refs = tuple([reference(part ^ flip) for part in parts])
            add(2 * node + flip, Or(refs) if flip else And(refs))
        elif node in graph.recently:
            literal, window_ns = graph.recently[node]
            add(2 * node, Recently(reference(literal), window_ns))
        else:
            add(2 * node, ModuleActive(graph.modules[node]))
    new_references = [reference(literal) for literal in literals]
    return tuple(guards), new_references


def _negated_conjunctions(graph: InverterGraph, literals: Sequence[int]) -> array[int]:
    """Return, by node, 1 for a conjunction that is mostly used negated, 0 for others, -1 if it is unused.

    Uses are counted in the form in which the using nodes will be written.
    """
    balance, used = zeros(len(graph.parts)), bytearray(len(graph.parts))
    flips = zeros(len(graph.parts))

    def use(literal: int) -> None:
        used[literal >> 1] = 1
        balance[literal >> 1] += 1 if literal & 1 else -1

    for literal in literals:
        use(literal)
    for node in range(len(used) - 1, -1, -1):
        if not used[node]:
            flips[node] = -1
            continue
        parts = graph.parts[node]
        flip = flips[node] = 1 if parts and balance[node] > 0 else 0
        for part in parts:
            use(part ^ flip)
        if node in graph.recently:
            use(graph.recently[node][0])
    return flips
