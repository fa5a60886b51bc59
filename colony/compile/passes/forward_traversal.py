"""Forward traversal: from a suppression network to prioritized clients (thesis section 4.8.2).

Table 4.2 reads a suppression network as a binary tree: suppressors are interior nodes, the dominant link
is the right child and the inferior link the left one. A forward traversal (definition 4.1) visits left
before right, and the order of visit (definition 4.2) of a module is its priority: last is highest.

Wires that are used several times make the tree a graph, in which a module may be visited many times. It is
still one client, at the position of its *last* visit, and its guard is the condition that it gets through:

    through(root)     = true
    through(dominant) = through(suppressor) and gate                      for each use; these are or-ed
    through(inferior) = through(suppressor) and gate and not dominated

To find last visits without walking every path, the traversal is run backwards, dominant side first, where
the last visit comes first: a node that was visited already is not entered again.
docs/theory.md proves that the first client whose guard holds, the one client whose exclusive guard holds,
and the winner of the network are the same.
"""

from __future__ import annotations

from colony.compile.guards import ActuatorClients, Client, ClientList, GuardTable, ModuleActive
from colony.compile.network import GatedSuppressor, ModuleLeaf, NodeUse, SuppressionNetwork, SuppressionNode


def forward_traversal(suppression: SuppressionNetwork) -> ClientList:
    """Return one client per module and actuator, numbered by the order of visit, with both guards.

    A module with one path has the thesis's guard (its own activity and the gates on that path), one with
    several paths the exclusive guard.
    """
    table = GuardTable(suppression.guards)
    actuators = tuple(
        ActuatorClients(actuator=actuator, clients=_clients(suppression.nodes, root, table))
        for actuator, root in suppression.outputs
    )
    return ClientList(
        guards=table.freeze(),
        actuators=actuators,
        observed=suppression.observed,
        windows=suppression.windows,
    )


def _clients(nodes: tuple[SuppressionNode, ...], root: NodeUse, table: GuardTable) -> tuple[Client, ...]:
    """Return the clients of one output, highest priority first."""
    visits = backward_visits(nodes, root)
    conditions = _Conditions(root)
    for index in sorted(visits, reverse=True):  # nodes have higher references than their inputs
        node = nodes[index]
        if not isinstance(node, ModuleLeaf):
            conditions.record_uses(index, node, table)
    leaves = [(index, node) for index in visits if isinstance(node := nodes[index], ModuleLeaf)]
    clients = []
    for priority, (index, leaf) in zip(range(len(leaves), 0, -1), leaves, strict=True):
        active = table.add(ModuleActive(leaf.module))
        exclusive = table.conjunction((active, conditions.through(index, table)))
        gates = conditions.gates[index]
        guard = exclusive if gates is None else table.conjunction((active, gates))
        client = Client(
            module=leaf.module,
            priority=priority,
            guard=guard,
            exclusive=exclusive,
            has_several_paths=gates is None,
        )
        clients.append(client)
    return tuple(clients)


def backward_visits(nodes: tuple[SuppressionNode, ...], root: NodeUse) -> list[int]:
    """Return the nodes under `root` in the reverse of a forward traversal, each at its last visit there.

    Nodes come before their children, dominant before inferior ones.
    """
    visited: dict[int, None] = {}
    stack = [root.node]
    while stack:
        index = stack.pop()
        if index in visited:
            continue
        visited[index] = None
        node = nodes[index]
        if not isinstance(node, ModuleLeaf):
            stack += (node.inferior.node, node.dominant.node)
    return list(visited)


class _Conditions:
    """The conditions under which nodes get through to the root, each complete once all uses are recorded.

    Attributes:
        first_uses: the condition of each node's first use.
        other_uses: the conditions of its other uses, if any.
        gates: the gates on the path from the root to each node, None if there are several paths.
    """

    def __init__(self, root: NodeUse) -> None:
        self.first_uses: dict[int, int] = {root.node: root.gate}
        self.other_uses: dict[int, list[int]] = {}
        self.gates: dict[int, int | None] = {root.node: root.gate}

    def through(self, index: int, table: GuardTable) -> int:
        first, others = self.first_uses[index], self.other_uses.get(index)
        return first if others is None else table.disjunction((first, *others))

    def record_uses(self, index: int, node: GatedSuppressor, table: GuardTable) -> None:
        """Record the uses of nodes by the links of a suppressor."""
        through, gates = self.through(index, table), self.gates[index]
        undominated = table.negation(node.dominant.active)
        for link, passing in ((node.dominant, (through,)), (node.inferior, (through, undominated))):
            self._record_use(
                link.node,
                table.conjunction((*passing, link.gate)),
                None if gates is None else table.conjunction((gates, link.gate)),
            )

    def _record_use(self, index: int, through: int, gates: int | None) -> None:
        if index in self.first_uses:
            self.other_uses.setdefault(index, []).append(through)
            self.gates[index] = None
        else:
            self.first_uses[index] = through
            self.gates[index] = gates
