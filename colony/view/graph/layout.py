"""The layout of a network's diagrams in rows and columns.

As in the figures of the colony literature, wires run to the right, one row per module, dominant side above.
A node is in the row of its inferior wire, which goes straight through it; the dominant wire ends in
a later column than anything between the two rows, and enters the node from above without crossing a wire.

A diagram is a tree. A graph is split into several trees. A node that is used more than once gets a diagram of
its own, which ends in the node's name; each use of it shows a reference, a box with that name. A module that
is used more than once is shown as a reference, too, except at its first use.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import dataclass

from colony.compile.network import ModuleLeaf, Network, NetworkNode


@dataclass(frozen=True, slots=True, kw_only=True)
class Vertex:
    """A module or reference (column 0), or a suppressor or inhibitor (column 1 and beyond).

    `name` is the text in a module or reference, or next to the wire that leaves a node, if it has a name.
    """

    node: int
    row: int
    column: int
    name: str
    is_reference: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Connection:
    """A wire between two vertices, by index: into the target from above if `dominant`, else straight."""

    source: int
    target: int
    dominant: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Diagram:
    """One tree, whose outgoing wire leads to an actuator or ends in the wire's name, `ends_in`.

    `root` is the index of the vertex that the wire leaves. `used` is false if the wire drives nothing.
    """

    ends_in: str
    actuator: bool
    used: bool
    vertices: tuple[Vertex, ...]
    connections: tuple[Connection, ...]
    root: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """Diagrams from top to bottom; rows are numbered across all of them."""

    diagrams: tuple[Diagram, ...]


def layout(network: Network) -> Layout:
    """Lay out actuators in order, then wires that are used several times, then wires that drive nothing."""
    return Layout(diagrams=tuple(_Drawing(network).diagrams()))


def inputs(node: NetworkNode) -> tuple[int, ...]:
    """Return the dominant and the inferior input, or an empty tuple for a module."""
    return () if isinstance(node, ModuleLeaf) else (node.dominant, node.inferior)


class _Drawing:
    def __init__(self, network: Network) -> None:
        self.nodes = network.nodes
        self.outputs = network.outputs
        uses = Counter(index for node in network.nodes for index in inputs(node))
        uses.update(index for _, index in network.outputs)
        self.unused = [index for index in range(len(self.nodes)) if not uses[index]]
        self.names = {index: name for name, index in reversed(network.wires)}
        shared = [
            index
            for index, node in enumerate(self.nodes)
            if uses[index] > 1 and not isinstance(node, ModuleLeaf)
        ]
        self.shared = set(shared)
        nameless = [index for index in (*shared, *self.unused) if index not in self.names]
        self.names |= {
            index: f"wire {i}" for i, index in enumerate(nameless, start=1) if inputs(self.nodes[index])
        }
        self.shared_queue: deque[int] = deque()
        self.drawn: set[int] = set()
        self.row = 0

    def diagrams(self) -> Iterator[Diagram]:
        for actuator, root in self.outputs:
            yield self.diagram(root, actuator, actuator=True, used=True)
        yield from self.shared_wires()
        for root in self.unused:
            node = self.nodes[root]
            if isinstance(node, ModuleLeaf) and root not in self.names:
                continue  # a module that no wire uses; a contract reads its activity
            yield self.diagram(root, self.names[root], actuator=False, used=False)
            yield from self.shared_wires()

    def shared_wires(self) -> Iterator[Diagram]:
        while self.shared_queue:
            root = self.shared_queue.popleft()
            yield self.diagram(root, self.names[root], actuator=False, used=True)

    def diagram(self, root: int, ends_in: str, *, actuator: bool, used: bool) -> Diagram:
        """Lay out one tree: rows from the dominant side down, each column after those of the inputs."""
        vertices: list[Vertex] = []
        connections: list[Connection] = []
        pending: list[int] = []  # vertices whose node is not laid out yet
        stack = [(root, False)]  # node, and True once its inputs are on the stack
        while stack:
            index, expanded = stack.pop()
            node = self.nodes[index]
            wire_name = self.names.get(index, "")
            if isinstance(node, ModuleLeaf) or (index in self.shared and (index != root or actuator)):
                vertices.append(self.leaf(index, node))
            elif not expanded:
                stack += ((index, True), (node.inferior, False), (node.dominant, False))
                continue
            else:
                inferior, dominant = pending.pop(), pending.pop()
                column = 1 + max(vertices[inferior].column, vertices[dominant].column)
                name = "" if index == root and not actuator else wire_name
                vertices.append(Vertex(node=index, row=vertices[inferior].row, column=column, name=name))
                target = len(vertices) - 1
                connections.append(Connection(source=dominant, target=target, dominant=True))
                connections.append(Connection(source=inferior, target=target, dominant=False))
            pending.append(len(vertices) - 1)
        return Diagram(
            ends_in=ends_in,
            actuator=actuator,
            used=used,
            vertices=tuple(vertices),
            connections=tuple(connections),
            root=pending.pop(),
        )

    def leaf(self, index: int, node: NetworkNode) -> Vertex:
        is_repeated = index in self.drawn
        self.drawn.add(index)
        if isinstance(node, ModuleLeaf):
            name, is_reference = node.module, is_repeated
        else:
            name, is_reference = self.names[index], True
            if not is_repeated:
                self.shared_queue.append(index)
        self.row += 1
        return Vertex(node=index, row=self.row - 1, column=0, name=name, is_reference=is_reference)
