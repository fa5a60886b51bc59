"""Forward traversal: from a suppression network to prioritized clients (thesis section 4.8.2).

Table 4.2 reads a suppression network as a binary tree: suppressors are interior nodes, the dominant link
is the right child and the inferior link the left one. A forward traversal (definition 4.1) visits left
before right, and the order of visit (definition 4.2) of a module is its priority: last is highest.

Wires that are used in several places make the tree a graph, in which a module may be visited many times. It
is still one client, at the position of its *last* visit, and its guard is the condition that it gets through:

    through(root)     = true
    through(dominant) = through(suppressor) and gate                      for each use; several are or-ed
    through(inferior) = through(suppressor) and gate and not dominated

To find last visits without walking every path, the traversal is run backwards, dominant side first, where
the last visit comes first: a node that was visited already is not entered again.
docs/theory.md proves that the first client whose guard holds, the one client whose exclusive guard holds,
and the winner of the network are the same.
"""

from __future__ import annotations

from colony.compile.clients import ActuatorClients, Client, ClientList
from colony.compile.guards import GuardTable, ModuleActive
from colony.compile.network import ModuleLeaf
from colony.compile.suppression import GatedSuppressor, Link, SuppressionNetwork, SuppressionNode


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


def _clients(nodes: tuple[SuppressionNode, ...], root: Link, table: GuardTable) -> tuple[Client, ...]:
    """Return the clients of one output, highest priority first."""
    visits = backward_visits(nodes, root)
    reach = _Reach(root)
    for at in sorted(visits, reverse=True):  # users have higher references than what they use
        node = nodes[at]
        if not isinstance(node, ModuleLeaf):
            reach.pass_on(at, node, table)
    leaves = [(at, node) for at in visits if isinstance(node := nodes[at], ModuleLeaf)]
    clients = []
    for priority, (at, leaf) in zip(range(len(leaves), 0, -1), leaves, strict=True):
        active = table.add(ModuleActive(leaf.module))
        exclusive = table.conjunction((active, reach.through(at, table)))
        gates = reach.gates[at]
        guard = exclusive if gates is None else table.conjunction((active, gates))
        client = Client(
            module=leaf.module,
            priority=priority,
            guard=guard,
            exclusive=exclusive,
            several_ways=gates is None,
        )
        clients.append(client)
    return tuple(clients)


def backward_visits(nodes: tuple[SuppressionNode, ...], root: Link) -> list[int]:
    """Return the nodes under `root` in the reverse of a forward traversal, each at its last visit there.

    Nodes before their children, dominant before inferior.
    """
    visited: dict[int, None] = {}
    stack = [root.node]
    while stack:
        at = stack.pop()
        if at in visited:
            continue
        visited[at] = None
        node = nodes[at]
        if not isinstance(node, ModuleLeaf):
            stack += (node.inferior.node, node.dominant.node)
    return list(visited)


class _Reach:
    """The conditions under which nodes are reached from the root, each complete once all users are done.

    `gates` are those on the path to a node from the root, None if there are several paths.
    """

    def __init__(self, root: Link) -> None:
        self.first: dict[int, int] = {root.node: root.gate}  # when a node gets through by its first use
        self.further: dict[int, list[int]] = {}  # and by its others
        self.gates: dict[int, int | None] = {root.node: root.gate}

    def through(self, at: int, table: GuardTable) -> int:
        further = self.further.get(at)
        return self.first[at] if further is None else table.disjunction((self.first[at], *further))

    def pass_on(self, at: int, node: GatedSuppressor, table: GuardTable) -> None:
        """Pass the conditions of a suppressor on to the nodes that its links use."""
        through, gates = self.through(at, table), self.gates[at]
        undominated = table.negation(node.dominant.active)
        for link, passing in ((node.dominant, (through,)), (node.inferior, (through, undominated))):
            self._use(
                link.node,
                table.conjunction((*passing, link.gate)),
                None if gates is None else table.conjunction((gates, link.gate)),
            )

    def _use(self, at: int, through: int, gates: int | None) -> None:
        if at in self.first:
            self.further.setdefault(at, []).append(through)
            self.gates[at] = None
        else:
            self.first[at] = through
            self.gates[at] = gates
