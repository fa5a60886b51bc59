"""Proof that the first client whose guard holds is the one that the network lets through.

A single question to z3 would suffice, but would compare each module with all above it. The same follows, by
induction over the network, from facts that each concern one node and its inputs. Let `E(k)` state that one of
the first k clients wins (in the network), and `gates(n)` that no inhibitor or time constant is closed on the
only path from the actuator down to node n. Then z3 shows, for one node after the other:

    descent    if a node is active and through, so is one of its inputs; so in the end a module wins
    reach      gates(n) implies through(n) or E(k), where k is the number of clients above all modules that
               depend on n alone: where n is passed over for a dominant side, by `descent` a module of that
               side wins
    passage    through(n) implies gates(n)

and, for each module with only one path, that its guard is its activity and its gates. By `reach`, if the
guard holds, the module or one above it wins; by `passage`, if the module wins, the guard holds. The guard of
a module with several paths is its exclusive guard, which is shown to hold exactly when the module wins. As no
two modules win in one frame, the first guard in the list that holds is the winner's.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain

from colony.verify.equivalence.circuit import FALSE, TRUE, Circuit
from colony.verify.equivalence.network import InnerNode, NetworkFormulas, Root
from colony.verify.equivalence.solver import CircuitSolver, Clause
from colony.verify.equivalence.table import ClientFormulas


def gates_of(source: NetworkFormulas, root: Root, circuit: Circuit) -> Mapping[int, int]:
    """Return, for each node with one path, the formula that no inhibitor or time constant blocks the path."""
    uses = _uses(source, root)
    gates: dict[int, int] = {root.node: TRUE}
    for index in range(root.node, -1, -1):
        node = source.nodes[index]
        if index not in gates or isinstance(node, str):
            continue
        if node.suppresses and uses[node.dominant] == 1:
            gates[node.dominant] = gates[index]
        if uses[node.inferior] == 1:
            closes = not node.suppresses or node.window_ns > 0
            closed = source.dominates[index] if closes else FALSE
            gates[node.inferior] = circuit.both(gates[index], closed ^ 1)
    for index, gate in gates.items():
        if isinstance(source.nodes[index], str):
            circuit.both(gate, source.active[index])  # the module's guard: this puts it into the index
    return gates


def _uses(source: NetworkFormulas, root: Root) -> Mapping[int, int]:
    """Count the uses of each node from which its command can reach the actuator."""
    uses = {root.node: 1}
    for index in range(root.node, -1, -1):
        node = source.nodes[index]
        if index not in uses or isinstance(node, str):
            continue
        for child in (node.dominant, node.inferior) if node.suppresses else (node.inferior,):
            uses[child] = uses.get(child, 0) + 1
    return uses


def first_by_structure(clients: Sequence[ClientFormulas], wins: Mapping[str, int], circuit: Circuit) -> bool:
    """Return True if "its guard holds, and none above" is the network's own formula for every client."""
    above = FALSE
    for client in clients:
        if circuit.both(client.guard, above ^ 1) != wins.get(client.module, FALSE):
            return False
        above = circuit.either(above, client.guard)
    return True


@dataclass(frozen=True, slots=True)
class PriorityInduction:
    """The proof for one actuator; if it fails, the clients may still be right."""

    source: NetworkFormulas
    root: Root
    gates: Mapping[int, int]
    clients: Sequence[ClientFormulas]
    solver: CircuitSolver

    def is_proved(self) -> bool:
        """Return True if the order of the clients is proved."""
        positions = {client.module: i for i, client in enumerate(self.clients)}
        if positions.keys() != self.root.wins.keys():
            return False
        lowest, highest = self._lowest_positions(positions), self._highest_positions(positions)
        if not self._dominants_are_above(lowest, highest) or not self._has_expected_guards():
            return False
        return self.solver.refutes_each(chain(self._descent(), self._passage(), self._reach(highest)))

    def _has_expected_guards(self) -> bool:
        circuit = self.solver.circuit
        for client in self.clients:
            module = self.source.names[client.module]
            gated = [self.gates[module]] if module in self.gates else []
            expected = [circuit.both(gate, self.source.active[module]) for gate in gated]
            if client.guard not in (self.root.wins[client.module], *expected):
                return False
        return True

    def _inner_nodes(self) -> list[tuple[int, InnerNode]]:
        """Return the suppressors and inhibitors that pass a command, from the actuator down."""
        return [
            (index, node)
            for index in range(self.root.node, -1, -1)
            if index in self.root.through and isinstance(node := self.source.nodes[index], InnerNode)
        ]

    def _descent(self) -> Iterator[list[Clause]]:
        active, through = self.source.active, self.root.through
        for index, node in self._inner_nodes():
            inputs = (node.dominant, node.inferior) if node.suppresses else (node.inferior,)
            not_passed_on = [(active[child] ^ 1, through[child] ^ 1) for child in inputs]
            yield [(active[index],), (through[index],), *not_passed_on]

    def _passage(self) -> Iterator[list[Clause]]:
        through, gates = self.root.through, self.gates
        for index, node in self._inner_nodes():
            child = node.inferior
            if child in gates and index in gates:
                yield [(through[index] ^ 1, gates[index]), (through[child],), (gates[child] ^ 1,)]

    def _reach(self, highest: Mapping[int, int]) -> Iterator[list[Clause]]:
        active, through, gates = self.source.active, self.root.through, self.gates
        for index, node in self._inner_nodes():
            child = node.inferior
            if child not in gates or child not in highest:
                continue
            clauses = [(gates[index] ^ 1, through[index])]
            if node.suppresses:
                clauses.append((through[index] ^ 1, active[node.dominant] ^ 1))
            yield [*clauses, (gates[child],), (through[child] ^ 1,)]

    def _dominants_are_above(self, lowest: Mapping[int, int], highest: Mapping[int, int]) -> bool:
        """Return True if modules of a dominant side are above those that depend only on the inferior side."""
        return all(
            lowest[node.dominant] < highest[node.inferior]
            for _, node in self._inner_nodes()
            if node.suppresses and node.inferior in highest
        )

    def _lowest_positions(self, positions: Mapping[str, int]) -> Mapping[int, int]:
        """Return, by node, the lowest position of a module that can win through it."""
        lowest: dict[int, int] = {}
        for index in range(self.root.node + 1):
            node = self.source.nodes[index]
            if index not in self.root.through:
                continue
            if isinstance(node, str):
                lowest[index] = positions[node]
            else:
                inputs = (node.dominant, node.inferior) if node.suppresses else (node.inferior,)
                lowest[index] = max(lowest[i] for i in inputs)
        return lowest

    def _highest_positions(self, positions: Mapping[str, int]) -> Mapping[int, int]:
        """Return, by node, the highest position of a module that depends on it alone."""
        highest: dict[int, int] = {}
        for index in range(self.root.node + 1):
            node = self.source.nodes[index]
            if index not in self.gates:
                continue
            if isinstance(node, str):
                highest[index] = positions[node]
                continue
            inputs = (node.dominant, node.inferior) if node.suppresses else (node.inferior,)
            found = [highest[i] for i in inputs if i in highest and i in self.gates]
            if found:
                highest[index] = min(found)
        return highest
