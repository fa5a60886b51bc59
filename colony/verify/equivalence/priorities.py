"""Proof that the first client whose guard holds is the one that the network lets through.

A single question to z3 would suffice, but would compare each module with all above it. The same follows, by
induction over the network, from facts that each concern one node and its inputs. Let `E(k)` state that one of
the first k clients wins (in the network), and `gates(n)` that no inhibitor or time constant is closed on the
only path from the actuator down to node n. Then z3 shows, for one node after the other:

    descent    what is active and through wins in the end: if a node is, so is one of its inputs
    reach      gates(n) implies through(n) or E(k), k being the clients above all modules that hang on n
    alone:
               where n is passed over for a dominant side, by `descent` a module of that side wins
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
from colony.verify.equivalence.network import Joint, NetworkFormulas, Root
from colony.verify.equivalence.solver import Clause, Solver
from colony.verify.equivalence.table import ClientFormulas


def gates_of(source: NetworkFormulas, root: Root, circuit: Circuit) -> Mapping[int, int]:
    """Return, for each node with one path from the actuator, that no inhibitor or time constant blocks it."""
    uses = _uses(source, root)
    gates: dict[int, int] = {root.node: TRUE}
    for at in range(root.node, -1, -1):
        node = source.nodes[at]
        if at not in gates or isinstance(node, str):
            continue
        if node.suppresses and uses[node.dominant] == 1:
            gates[node.dominant] = gates[at]
        if uses[node.inferior] == 1:
            closes = not node.suppresses or node.window_ns > 0
            closed = source.dominates[at] if closes else FALSE
            gates[node.inferior] = circuit.both(gates[at], closed ^ 1)
    for at, gate in gates.items():
        if isinstance(source.nodes[at], str):
            circuit.both(gate, source.active[at])  # the module's guard: this puts it into the index
    return gates


def _uses(source: NetworkFormulas, root: Root) -> Mapping[int, int]:
    """Count the uses of each node from which its command can reach the actuator."""
    uses = {root.node: 1}
    for at in range(root.node, -1, -1):
        node = source.nodes[at]
        if at not in uses or isinstance(node, str):
            continue
        for below in (node.dominant, node.inferior) if node.suppresses else (node.inferior,):
            uses[below] = uses.get(below, 0) + 1
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
class Induction:
    """The proof for one actuator; if it fails, the clients may still be right."""

    source: NetworkFormulas
    root: Root
    gates: Mapping[int, int]
    clients: Sequence[ClientFormulas]
    solver: Solver

    def is_proved(self) -> bool:
        """Return True if the order of the clients is proved."""
        positions = {client.module: i for i, client in enumerate(self.clients)}
        if positions.keys() != self.root.wins.keys():
            return False
        last, first = self._last(positions), self._first(positions)
        if not self._above(last, first) or not self._guards():
            return False
        return self.solver.refutes_each(chain(self._descent(), self._passage(), self._reach(first)))

    def _guards(self) -> bool:
        circuit = self.solver.circuit
        for client in self.clients:
            module = self.source.names[client.module]
            gated = [self.gates[module]] if module in self.gates else []
            expected = [circuit.both(gate, self.source.active[module]) for gate in gated]
            if client.guard not in (self.root.wins[client.module], *expected):
                return False
        return True

    def _joints(self) -> list[tuple[int, Joint]]:
        """Return the suppressors and inhibitors that pass a command, from the actuator down."""
        return [
            (at, node)
            for at in range(self.root.node, -1, -1)
            if at in self.root.through and isinstance(node := self.source.nodes[at], Joint)
        ]

    def _descent(self) -> Iterator[list[Clause]]:
        active, through = self.source.active, self.root.through
        for at, node in self._joints():
            inputs = (node.dominant, node.inferior) if node.suppresses else (node.inferior,)
            not_passed_on = [(active[below] ^ 1, through[below] ^ 1) for below in inputs]
            yield [(active[at],), (through[at],), *not_passed_on]

    def _passage(self) -> Iterator[list[Clause]]:
        through, gates = self.root.through, self.gates
        for at, node in self._joints():
            below = node.inferior
            if below in gates and at in gates:
                yield [(through[at] ^ 1, gates[at]), (through[below],), (gates[below] ^ 1,)]

    def _reach(self, first: Mapping[int, int]) -> Iterator[list[Clause]]:
        active, through, gates = self.source.active, self.root.through, self.gates
        for at, node in self._joints():
            below = node.inferior
            if below not in gates or below not in first:
                continue
            known = [(gates[at] ^ 1, through[at])]
            if node.suppresses:
                known.append((through[at] ^ 1, active[node.dominant] ^ 1))
            yield [*known, (gates[below],), (through[below] ^ 1,)]

    def _above(self, last: Mapping[int, int], first: Mapping[int, int]) -> bool:
        """Return True if modules of a dominant side are above those that depend on its inferior side only."""
        return all(
            last[node.dominant] < first[node.inferior]
            for _, node in self._joints()
            if node.suppresses and node.inferior in first
        )

    def _last(self, positions: Mapping[str, int]) -> Mapping[int, int]:
        """Return, by node, the lowest position of a module that can win through it."""
        last: dict[int, int] = {}
        for at in range(self.root.node + 1):
            node = self.source.nodes[at]
            if at not in self.root.through:
                continue
            if isinstance(node, str):
                last[at] = positions[node]
            else:
                below = (node.dominant, node.inferior) if node.suppresses else (node.inferior,)
                last[at] = max(last[i] for i in below)
        return last

    def _first(self, positions: Mapping[str, int]) -> Mapping[int, int]:
        """Return, by node, the highest position of a module that depends on it alone."""
        first: dict[int, int] = {}
        for at in range(self.root.node + 1):
            node = self.source.nodes[at]
            if at not in self.gates:
                continue
            if isinstance(node, str):
                first[at] = positions[node]
                continue
            below = (node.dominant, node.inferior) if node.suppresses else (node.inferior,)
            found = [first[i] for i in below if i in first and i in self.gates]
            if found:
                first[at] = min(found)
        return first
