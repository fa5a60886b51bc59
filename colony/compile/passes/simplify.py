"""Simplification of guards: sound, local, near-linear. `inverter_graph` has the rules."""

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
"""Share of a size that a round of rewriting must save for another round to follow."""


def simplify(clients: ClientList) -> ClientList:
    """Return the same clients with simpler guards, in a table without unused nodes.

    Each guard holds in the same frames as before, whatever the modules do. Clients whose guard is never true
    stay in the list: their priorities are part of the compiled form, and lints report them.
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
    guards, moved = _unload(graph, literals)
    return _renumbered(clients, guards, dict(zip(references, moved, strict=True)))


def _references(clients: ClientList) -> list[int]:
    """Return the references that a client list makes into its table, each once."""
    found = dict.fromkeys(
        ref for actuator in clients.actuators for c in actuator.clients for ref in (c.guard, c.exclusive)
    )
    found |= dict.fromkeys(ref for _, ref in clients.observed)
    return list(found)


def _renumbered(clients: ClientList, guards: tuple[Guard, ...], to: dict[int, int]) -> ClientList:
    """Return the client list over another table, `to` giving the new reference of each old one."""
    actuators = []
    for one in clients.actuators:
        moved = [replace(c, guard=to[c.guard], exclusive=to[c.exclusive]) for c in one.clients]
        actuators.append(ActuatorClients(actuator=one.actuator, clients=tuple(moved)))
    observed = tuple((name, to[ref]) for name, ref in clients.observed)
    return ClientList(guards=guards, actuators=tuple(actuators), observed=observed)


def _load(guards: Sequence[Guard], references: Sequence[int]) -> tuple[InverterGraph, list[int]]:
    """Return the graph of all guards that the references need, and their literals."""
    used = bytearray(len(guards))
    for ref in references:
        used[ref] = 1
    for at in range(len(guards) - 1, -1, -1):
        if used[at]:
            for operand in operands(guards[at]):
                used[operand] = 1
    graph = InverterGraph()
    literals = zeros(len(guards))
    for at, guard in enumerate(guards):
        if used[at]:
            literals[at] = _literal(guard, graph, literals)
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
    flipped = _negated_conjunctions(graph, literals)
    guards: list[Guard] = []
    references = zeros(2 * len(flipped))  # by literal: one more than its place in the table

    def add(literal: int, guard: Guard) -> int:
        guards.append(guard)
        references[literal] = len(guards)
        return len(guards) - 1

    def reference(literal: int) -> int:
        at = references[literal] - 1
        if at >= 0:
            return at
        if literal <= FALSE:
            return add(literal, Always() if literal == TRUE else Never())
        return add(literal, Not(references[literal ^ 1] - 1))

    for node, (parts, flip) in enumerate(zip(graph.parts, flipped, strict=True)):
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
    moved = [reference(literal) for literal in literals]
    return tuple(guards), moved


def _negated_conjunctions(graph: InverterGraph, literals: Sequence[int]) -> array[int]:
    """Return 1 for conjunctions that are mostly used negated, as their users will be written; else 0.

    -1 for nodes that are not used.
    """
    balance, used = zeros(len(graph.parts)), bytearray(len(graph.parts))
    flipped = zeros(len(graph.parts))

    def use(literal: int) -> None:
        used[literal >> 1] = 1
        balance[literal >> 1] += 1 if literal & 1 else -1

    for literal in literals:
        use(literal)
    for node in range(len(used) - 1, -1, -1):
        if not used[node]:
            flipped[node] = -1
            continue
        parts = graph.parts[node]
        flip = flipped[node] = 1 if parts and balance[node] > 0 else 0
        for part in parts:
            use(part ^ flip)
        if node in graph.recently:
            use(graph.recently[node][0])
    return flipped
