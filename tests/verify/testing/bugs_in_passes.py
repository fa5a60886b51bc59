"""Mistakes in the passes over networks and clients: changes to what a pass of the pipeline gives."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import pytest

from colony.compile import pipeline
from colony.compile.guards import ActuatorClients, Always, And, Client, ClientList, Guard, ModuleActive, Or
from colony.compile.network import (
    GatedSuppressor,
    Inhibitor,
    ModuleLeaf,
    Network,
    NetworkNode,
    NodeUse,
    SuppressionNetwork,
    Suppressor,
)
from colony.ir.program import Chain, Program, Wiring

Plant = Callable[[pytest.MonkeyPatch], None]
"""Plants a mistake for as long as the monkeypatch lasts."""


def replace_pass(
    monkeypatch: pytest.MonkeyPatch, stage: str, change: Callable[[Callable[[Any], Any], Any], Any]
) -> None:
    """Have `change(pass, given)` in the place of a pass of the pipeline."""
    names = [one.__name__ for one in pipeline.PASSES]
    original = pipeline.PASSES[names.index(stage)]
    changed = functools.wraps(original)(lambda given: change(original, given))
    passes = tuple(changed if one is original else one for one in pipeline.PASSES)
    monkeypatch.setattr(pipeline, "PASSES", passes)


def after(stage: str, change: Callable[[Any], Any]) -> Plant:
    """`change` what a pass of the pipeline gives."""

    def plant(monkeypatch: pytest.MonkeyPatch) -> None:
        replace_pass(monkeypatch, stage, lambda original, given: change(original(given)))

    return plant


def before(stage: str, change: Callable[[Any], Any]) -> Plant:
    """`change` what a pass of the pipeline is given."""

    def plant(monkeypatch: pytest.MonkeyPatch) -> None:
        replace_pass(monkeypatch, stage, lambda original, given: original(change(given)))

    return plant


# --- wiring --------------------------------------------------------------------------------------


def rewired(change: Callable[[Chain], Wiring]) -> Plant:
    """`change` every chain of the program before it is elaborated."""

    def over(wiring: Wiring) -> Wiring:
        if not isinstance(wiring, Chain):
            return wiring
        return change(replace(wiring, operands=tuple(over(o) for o in wiring.operands)))

    def program(given: Program) -> Program:
        return replace(given, wires=tuple(replace(w, wiring=over(w.wiring)) for w in given.wires))

    return before("elaborate", program)


def left_associated(chain: Chain) -> Wiring:
    first, *rest = chain.operands
    for operand, window_ns in zip(rest, chain.windows_ns, strict=True):
        first = replace(chain, operands=(first, operand), windows_ns=(window_ns,))
    return first


def nodes(change: Callable[[Any], NetworkNode]) -> Plant:
    """`change` every suppressor and inhibitor of the network."""

    def network(given: Network) -> Network:
        return replace(given, nodes=tuple(n if isinstance(n, ModuleLeaf) else change(n) for n in given.nodes))

    return after("elaborate", network)


def swapped(node: Any) -> Any:
    return replace(node, dominant=node.inferior, inferior=node.dominant)


def window(change: Callable[[int], int], of: type = object) -> Plant:
    """`change` the time constants of nodes of one kind."""
    return nodes(
        lambda n: replace(n, window_ns=change(n.window_ns)) if n.window_ns and isinstance(n, of) else n
    )


def suppressing(node: Any) -> Any:
    return Suppressor(dominant=node.dominant, inferior=node.inferior, window_ns=node.window_ns)


def inhibiting_for_long(node: Any) -> Any:
    """A suppressor with a time constant that forgets to let its dominant side through."""
    if isinstance(node, Suppressor) and node.window_ns:
        return Inhibitor(dominant=node.dominant, inferior=node.inferior, window_ns=node.window_ns)
    return node


# --- inhibition elimination ----------------------------------------------------------------------


def links(change: Callable[[GatedSuppressor, SuppressionNetwork], GatedSuppressor]) -> Plant:
    """`change` every suppressor of the suppression network."""

    def network(given: SuppressionNetwork) -> SuppressionNetwork:
        given = replace(given, guards=(*given.guards, Always()))
        return replace(
            given,
            nodes=tuple(change(n, given) if isinstance(n, GatedSuppressor) else n for n in given.nodes),
        )

    return after("eliminate_inhibition", network)


def ungated(node: GatedSuppressor, network: SuppressionNetwork) -> GatedSuppressor:
    always = len(network.guards) - 1
    return replace(
        node, dominant=replace(node.dominant, gate=always), inferior=replace(node.inferior, gate=always)
    )


def gates_swapped(node: GatedSuppressor, network: SuppressionNetwork) -> GatedSuppressor:
    dominant, inferior = node.dominant, node.inferior
    return replace(
        node,
        dominant=replace(dominant, gate=inferior.gate),
        inferior=replace(inferior, gate=dominant.gate),
    )


def dominant_though_inhibited(node: GatedSuppressor, network: SuppressionNetwork) -> GatedSuppressor:
    """The inferior side yields to a module that is active but does not get through."""
    below = network.nodes[node.dominant.node]
    if not isinstance(below, ModuleLeaf):
        return node
    own = [i for i, g in enumerate(network.guards) if g == ModuleActive(below.module)]
    return replace(node, dominant=replace(node.dominant, active=own[0]))


def observed_shifted(given: SuppressionNetwork) -> SuppressionNetwork:
    names = [name for name, _ in given.observed]
    guards = [guard for _, guard in given.observed]
    return replace(given, observed=tuple(zip(names, guards[1:] + guards[:1], strict=True)))


# --- forward traversal ---------------------------------------------------------------------------


def numbered_at_first_visit(monkeypatch: pytest.MonkeyPatch) -> None:
    """A shared module gets the number of its first visit, its lowest place, not of its last."""

    def traverse(original: Callable[[Any], Any], given: SuppressionNetwork) -> ClientList:
        roots = dict(given.outputs)
        return in_order(original(given), lambda actuator: first_visits(given, roots[actuator]))

    replace_pass(monkeypatch, "forward_traversal", traverse)


def first_visits(given: SuppressionNetwork, root: NodeUse) -> list[str]:
    """Modules in the order of a forward traversal, each at its first visit."""
    visited: dict[str, None] = {}
    stack = [root.node]
    while stack:
        node = given.nodes[stack.pop()]
        if isinstance(node, ModuleLeaf):
            visited[node.module] = None
        else:
            stack += (node.dominant.node, node.inferior.node)
    return list(visited)


def in_order(clients: ClientList, visits: Callable[[str], list[str]]) -> ClientList:
    """The same clients, numbered by another order of visit."""
    actuators = []
    for actuator in clients.actuators:
        order = visits(actuator.actuator)
        by_priority = sorted(actuator.clients, key=lambda c: -order.index(c.module))
        actuators.append(replace(actuator, clients=renumbered(by_priority)))
    return replace(clients, actuators=tuple(actuators))


def renumbered(clients: Sequence[Client]) -> tuple[Client, ...]:
    return tuple(replace(c, priority=p) for p, c in zip(range(len(clients), 0, -1), clients, strict=True))


def lists(change: Callable[[ActuatorClients], ActuatorClients]) -> Plant:
    """`change` the clients of every actuator."""
    return after("simplify", lambda given: replace(given, actuators=tuple(map(change, given.actuators))))


def reversed_priorities(actuator: ActuatorClients) -> ActuatorClients:
    return replace(actuator, clients=renumbered(actuator.clients[::-1]))


def lowest_lost(actuator: ActuatorClients) -> ActuatorClients:
    return replace(actuator, clients=actuator.clients[:-1])


def not_exclusive(actuator: ActuatorClients) -> ActuatorClients:
    return replace(actuator, clients=tuple(replace(c, exclusive=c.guard) for c in actuator.clients))


def one_use_forgotten(given: ClientList) -> ClientList:
    """A client with several uses gets through by the first of them only."""
    guards = list(given.guards)
    for root in {ref for a in given.actuators for c in a.clients for ref in (c.guard, c.exclusive)}:
        top = guards[root]
        for part in top.operands if isinstance(top, And) else ():
            uses = guards[part]
            if isinstance(uses, Or):
                guards[part] = And((uses.operands[0], uses.operands[0]))
    return replace(given, guards=tuple(guards))


def table(change: Callable[[Guard], Guard], stage: str = "simplify") -> Plant:
    """`change` every guard of the table."""
    return after(stage, lambda given: replace(given, guards=tuple(map(change, given.guards))))


def last_part_dropped(guard: Guard, of: type[And] | type[Or]) -> Guard:
    if isinstance(guard, of) and len(guard.operands) > 1:
        return of(guard.operands[:-1])
    return guard
