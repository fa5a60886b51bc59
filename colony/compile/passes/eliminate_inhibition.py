"""Inhibition elimination: Lemma 4.1 of thesis section 4.8.2, for networks with sharing and memory.

`A inhibits B` is B through a gate `not active(A)`. Beyond the lemma's two modules, this holds because:

- Where B is a network, the gate distributes over its suppressors, so that gating the link to B gates all
  modules in B; and B itself stays shared with the other nodes that use it.
- Where A is a network, its activity is a guard over its modules. Activities are computed once per node,
  from those of its inputs, in a hash-consed table: linear in the network.
- A time constant is activity with memory: the gate is `not recently(active(A), T)`; and a suppressor with
  one is a plain suppressor over an inhibitor, `A suppresses[T] B = A suppresses (A inhibits[T] B)`.

docs/theory.md has the proofs.
"""

from __future__ import annotations

from typing import assert_never

from colony.compile.guards import Always, GuardTable, ModuleActive
from colony.compile.network import (
    GatedSuppressor,
    Inhibitor,
    ModuleLeaf,
    Network,
    NodeUse,
    SuppressionNetwork,
    SuppressionNode,
    Suppressor,
)


def eliminate_inhibition(network: Network) -> SuppressionNetwork:
    """Return the same network with inhibitors and time constants replaced by gates on its links."""
    elimination = _Elimination()
    links: list[NodeUse] = []  # by node of the network
    for node in network.nodes:
        match node:
            case ModuleLeaf():
                links.append(elimination.leaf(node))
            case Inhibitor(dominant=dominant, inferior=inferior):
                links.append(elimination.inhibited(links[dominant], links[inferior], node))
            case Suppressor(dominant=dominant, inferior=inferior):
                links.append(elimination.suppressed(links[dominant], links[inferior], node))
            case _:
                assert_never(node)
    return SuppressionNetwork(
        nodes=tuple(elimination.nodes),
        guards=elimination.table.freeze(),
        outputs=tuple((actuator, links[node]) for actuator, node in network.outputs),
        wires=tuple((name, links[node].active) for name, node in network.wires),
        observed=tuple((name, links[node].active) for name, node in network.observed),
        windows=tuple(elimination.windows),
    )


class _Elimination:
    """The suppression network so far; `activities` holds the guard of each node's activity. Mutable."""

    def __init__(self) -> None:
        self.table = GuardTable()
        self.always = self.table.add(Always())
        self.nodes: list[SuppressionNode] = []
        self.activities: list[int] = []
        self.windows: list[tuple[str, int]] = []

    def leaf(self, leaf: ModuleLeaf) -> NodeUse:
        return self.add(leaf, self.table.add(ModuleActive(leaf.module)))

    def inhibited(self, dominant: NodeUse, inferior: NodeUse, node: Inhibitor | Suppressor) -> NodeUse:
        """Return the inferior link, closed while the dominant link dominates."""
        table = self.table
        dominating = table.recently(dominant.active, node.window_ns)
        if node.window_ns > 0:
            self.windows.append((node.memory_name, dominating))
        gate = table.conjunction((table.negation(dominating), inferior.gate))
        active = table.conjunction((gate, self.activities[inferior.node]))
        return NodeUse(node=inferior.node, gate=gate, active=active)

    def suppressed(self, dominant: NodeUse, inferior: NodeUse, node: Suppressor) -> NodeUse:
        if node.window_ns > 0:
            inferior = self.inhibited(dominant, inferior, node)
        active = self.table.disjunction((dominant.active, inferior.active))
        return self.add(GatedSuppressor(dominant=dominant, inferior=inferior), active)

    def add(self, node: SuppressionNode, active: int) -> NodeUse:
        self.nodes.append(node)
        self.activities.append(active)
        return NodeUse(node=len(self.nodes) - 1, gate=self.always, active=active)
