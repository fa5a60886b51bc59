"""The layout of a network's picture, in rows and columns.

As in the colony figures of the literature, wires run to the right, one row a module, the dominant side above.
A node is in the row of its inferior wire, which goes straight through it; the dominant wire ends in
a later column than anything between the two rows, and comes down into the node without crossing a wire.

This draws a tree. A graph is split into several trees: a node that is used in more than one place gets a
diagram of its own, which ends in its name, and each use is a stub with that name. A module that is used
several times is a stub as well, at all places but the first.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import dataclass

from colony.compile.network import ModuleLeaf, Network, NetworkNode


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """A module (column 0), a stub (column 0, `stub` set), or a node (column 1 and beyond).

    `name` is the text in a module or stub, or next to the wire that leaves a node, if it has a name.
    """

    node: int
    row: int
    column: int
    name: str
    stub: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Connection:
    """A wire from one place to another, by index: into the node from above, or straight."""

    source: int
    target: int
    dominant: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Diagram:
    """One tree, ending in an actuator, or in the name of a wire; `root` is the place whose wire that is.

    `used` is true if another diagram uses the wire; otherwise the wire drives nothing.
    """

    ends_in: str
    actuator: bool
    used: bool
    places: tuple[Place, ...]
    connections: tuple[Connection, ...]
    root: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """Diagrams from top to bottom, with rows numbered through all of them."""

    diagrams: tuple[Diagram, ...]


def layout(network: Network) -> Layout:
    """Lay out actuators in order, then wires that are used several times, then wires that drive nothing."""
    return Layout(diagrams=tuple(_Drawing(network).diagrams()))


def inputs(node: NetworkNode) -> tuple[int, ...]:
    """Return the dominant and the inferior input, or nothing for a module."""
    return () if isinstance(node, ModuleLeaf) else (node.dominant, node.inferior)


class _Drawing:
    def __init__(self, network: Network) -> None:
        self.nodes = network.nodes
        self.outputs = network.outputs
        uses = Counter(at for node in network.nodes for at in inputs(node))
        uses.update(at for _, at in network.outputs)
        self.unused = [at for at in range(len(self.nodes)) if not uses[at]]
        self.names = {at: name for name, at in reversed(network.wires)}
        shared = [
            at for at, node in enumerate(self.nodes) if uses[at] > 1 and not isinstance(node, ModuleLeaf)
        ]
        self.shared = set(shared)
        nameless = [at for at in (*shared, *self.unused) if at not in self.names]
        self.names |= {at: f"wire {i}" for i, at in enumerate(nameless, start=1) if inputs(self.nodes[at])}
        self.waiting: deque[int] = deque()
        self.seen: set[int] = set()
        self.row = 0

    def diagrams(self) -> Iterator[Diagram]:
        for actuator, root in self.outputs:
            yield self.diagram(root, actuator, actuator=True, used=True)
        yield from self.shared_wires()
        for root in self.unused:
            node = self.nodes[root]
            if isinstance(node, ModuleLeaf) and root not in self.names:
                continue  # a module that contracts observe, wired to nothing
            yield self.diagram(root, self.names[root], actuator=False, used=False)
            yield from self.shared_wires()

    def shared_wires(self) -> Iterator[Diagram]:
        while self.waiting:
            root = self.waiting.popleft()
            yield self.diagram(root, self.names[root], actuator=False, used=True)

    def diagram(self, root: int, ends_in: str, *, actuator: bool, used: bool) -> Diagram:
        """Lay out one tree, rows from the dominant side down, columns once the inputs have theirs."""
        places: list[Place] = []
        connections: list[Connection] = []
        done: list[int] = []  # places of inputs whose node is not laid out yet
        stack = [(root, False)]
        while stack:
            at, entered = stack.pop()
            node = self.nodes[at]
            named = self.names.get(at, "")
            if isinstance(node, ModuleLeaf) or (at in self.shared and (at != root or actuator)):
                places.append(self.leaf(at, node))
            elif not entered:
                stack += ((at, True), (node.inferior, False), (node.dominant, False))
                continue
            else:
                inferior, dominant = done.pop(), done.pop()
                column = 1 + max(places[inferior].column, places[dominant].column)
                name = "" if at == root and not actuator else named
                places.append(Place(node=at, row=places[inferior].row, column=column, name=name))
                here = len(places) - 1
                connections.append(Connection(source=dominant, target=here, dominant=True))
                connections.append(Connection(source=inferior, target=here, dominant=False))
            done.append(len(places) - 1)
        return Diagram(
            ends_in=ends_in,
            actuator=actuator,
            used=used,
            places=tuple(places),
            connections=tuple(connections),
            root=done.pop(),
        )

    def leaf(self, at: int, node: NetworkNode) -> Place:
        is_repeated = at in self.seen
        self.seen.add(at)
        if isinstance(node, ModuleLeaf):
            name, stub = node.module, is_repeated
        else:
            name, stub = self.names[at], True
            if not is_repeated:
                self.waiting.append(at)
        self.row += 1
        return Place(node=at, row=self.row - 1, column=0, name=name, stub=stub)
